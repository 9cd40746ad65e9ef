//! Sums of one pass over the rows, by cell: Gram matrices of training and of held-out rows, and ranges.

use std::collections::BTreeMap;

use faer::MatRef;
use fleetfoot_stats::{
    Fold, Gram,
    scan::{RegionGrams, RegionRanges, widen},
};

/// The cells of a chunk's rows, of every training set.
pub(crate) struct CellPart {
    grams: Vec<RegionGrams>,
    /// In the cells of all rows.
    ranges: RegionRanges,
}

impl CellPart {
    /// No rows yet; how many cells every training set has.
    pub(crate) fn new(cells: &[usize], regressors: usize) -> Self {
        let all = cells.first().copied().unwrap_or(0);
        Self {
            grams: cells.iter().map(|&cells| RegionGrams::new(cells)).collect(),
            ranges: RegionRanges::new(all, regressors),
        }
    }

    /// Adds rows at a place in cross-validation in their cells of every training set. Regressors and targets are in the
    /// preconditioner's coordinates; the raw regressors follow.
    pub(crate) fn add<'c>(
        &mut self,
        (z, weights, fold): (MatRef<'_, f64>, Option<&[f64]>, Fold),
        cells: impl Fn(usize) -> &'c [u32],
        regressors: &[&[f64]],
    ) {
        for (set, grams) in self.grams.iter_mut().enumerate() {
            if Use::of(set, fold).is_some() {
                grams.add(z, weights, Some(cells(set)));
            }
        }
        self.ranges.add(regressors, Some(cells(0)));
    }
}

/// Use of a row in a training set.
enum Use {
    Trains,
    Tests(usize),
}

impl Use {
    /// `None` for rows beside those that are held out.
    fn of(set: usize, fold: Fold) -> Option<Self> {
        match set.checked_sub(1) {
            None => Some(Self::Trains),
            Some(held) if usize::from(fold.held_out) == held => Some(Self::Tests(held)),
            Some(held) => fold.trains(held as u16).then_some(Self::Trains),
        }
    }
}

/// The cells of all rows.
pub(crate) struct CellSums {
    training: Vec<RegionGrams>,
    testing: Vec<RegionGrams>,
    ranges: RegionRanges,
    /// Columns of a Gram matrix.
    width: usize,
}

impl CellSums {
    /// No rows yet, of so many cells of every training set, and so many regressors.
    pub(crate) fn new(cells: &[usize], (regressors, width): (usize, usize)) -> Self {
        let CellPart { grams, ranges } = CellPart::new(cells, regressors);
        let testing = cells.iter().skip(1).map(|&cells| RegionGrams::new(cells)).collect();
        Self { training: grams, testing, ranges, width }
    }

    /// Adds a chunk.
    pub(crate) fn add(&mut self, fold: Fold, part: CellPart) {
        for (set, grams) in part.grams.into_iter().enumerate() {
            match Use::of(set, fold) {
                Some(Use::Trains) => self.training[set].merge(grams),
                Some(Use::Tests(held)) => self.testing[held].merge(grams),
                None => {}
            }
        }
        self.ranges.merge(&part.ranges);
    }

    /// Ranges of the cells of all rows.
    pub(crate) fn cell_ranges(&self) -> RegionRanges {
        self.ranges.clone()
    }

    /// All rows, and the training rows and held-out rows of every fold.
    pub(crate) fn sets(self) -> Sets {
        let width = self.width;
        let of = |grams: RegionGrams| {
            let mut cells = vec![Gram::new(width); grams.regions()];
            grams.into_regions().for_each(|(cell, gram)| cells[cell as usize] = gram);
            cells
        };
        let (training, testing) = (self.training.into_iter().map(of), self.testing.into_iter().map(of));
        Sets { training: training.collect(), testing: testing.collect() }
    }
}

/// Gram matrices of the cells of every training set: of all rows, then for every fold of those that train.
pub(crate) struct Sets {
    training: Vec<Vec<Gram>>,
    /// For every fold those of the rows that it holds out, in the cells of its training rows.
    testing: Vec<Vec<Gram>>,
}

impl Sets {
    /// The cells of a set of training rows.
    pub(crate) fn training(&self, set: usize) -> &[Gram] {
        &self.training[set]
    }

    /// The cells of the rows that a fold holds out.
    pub(crate) fn testing(&self, fold: u16) -> &[Gram] {
        &self.testing[usize::from(fold)]
    }
}

/// Gram matrices of the regions that cells are joined to; regions without rows are missing.
pub(crate) fn joined(cells: &[Gram], table: &[u32]) -> BTreeMap<u32, Gram> {
    let mut regions: BTreeMap<u32, Gram> = BTreeMap::new();
    for (gram, &region) in cells.iter().zip(table).filter(|(gram, _)| gram.weight > 0.0) {
        match regions.get_mut(&region) {
            Some(all) => all.merge(gram),
            None => {
                regions.insert(region, gram.clone());
            }
        }
    }
    regions
}

/// Ranges of the regions that cells are joined to.
pub(crate) fn joined_ranges(cells: &RegionRanges, table: &[u32]) -> RegionRanges {
    let regions = table.iter().max().map_or(0, |&last| last as usize + 1);
    let mut joined = RegionRanges::new(regions, cells.0.first().map_or(0, Vec::len));
    for (cell, &region) in cells.0.iter().zip(table) {
        widen(&mut joined.0[region as usize], cell);
    }
    joined
}

//! What one pass over the rows keeps of cells: Gram matrices by place in cross-validation, and ranges.

use std::collections::BTreeMap;

use faer::MatRef;
use fleetfoot_stats::{
    Fold, Gram,
    scan::{RegionGrams, RegionRanges, widen},
};

/// The cells of a chunk's rows.
pub(crate) struct CellPart {
    grams: RegionGrams,
    ranges: RegionRanges,
}

impl CellPart {
    pub(crate) fn new(cells: usize, regressors: usize) -> Self {
        Self { grams: RegionGrams::new(cells), ranges: RegionRanges::new(cells, regressors) }
    }

    /// Adds rows in their cells: regressors and targets in the preconditioner's coordinates, and the regressors as they are.
    pub(crate) fn add(&mut self, z: MatRef<'_, f64>, weights: Option<&[f64]>, cells: &[u32], regressors: &[&[f64]]) {
        self.grams.add(z, weights, Some(cells));
        self.ranges.add(regressors, Some(cells));
    }
}

/// The cells of all rows.
pub(crate) struct CellSums {
    by_fold: BTreeMap<Fold, RegionGrams>,
    ranges: RegionRanges,
    /// Columns of a Gram matrix.
    width: usize,
}

impl CellSums {
    /// No rows yet, of so many cells and regressors.
    pub(crate) fn new(cells: usize, (regressors, width): (usize, usize)) -> Self {
        Self { by_fold: BTreeMap::new(), ranges: RegionRanges::new(cells, regressors), width }
    }

    /// Adds a chunk.
    pub(crate) fn add(&mut self, fold: Fold, part: CellPart) {
        let cells = part.grams.regions();
        self.by_fold.entry(fold).or_insert_with(|| RegionGrams::new(cells)).merge(part.grams);
        self.ranges.merge(&part.ranges);
    }

    /// Ranges of regions that cells are joined to.
    pub(crate) fn ranges(&self, table: &[u32]) -> RegionRanges {
        let regions = table.iter().max().map_or(0, |&last| last as usize + 1);
        let mut joined = RegionRanges::new(regions, self.ranges.0.first().map_or(0, Vec::len));
        for (own, &region) in self.ranges.0.iter().zip(table) {
            widen(&mut joined.0[region as usize], own);
        }
        joined
    }

    /// All rows, and the training rows and held-out rows of every fold.
    pub(crate) fn sets(&self, folds: u16) -> Sets {
        let total = |wanted: &dyn Fn(&Fold) -> bool| -> Vec<Gram> {
            let mut sums = vec![Gram::new(self.width); self.ranges.0.len()];
            for (_, grams) in self.by_fold.iter().filter(|(fold, _)| wanted(fold)) {
                grams.iter().for_each(|(cell, gram)| sums[cell as usize].merge(gram));
            }
            sums
        };
        let mut training = vec![total(&|_| true)];
        training.extend((0..folds).map(|held| total(&|fold: &Fold| fold.trains(held))));
        let testing = (0..folds).map(|held| total(&|fold: &Fold| fold.own == held)).collect();
        Sets { training, testing }
    }
}

/// Gram matrices of the cells: of all rows, then for every fold of those that train.
pub(crate) struct Sets {
    training: Vec<Vec<Gram>>,
    /// For every fold those of the rows that it holds out.
    testing: Vec<Vec<Gram>>,
}

impl Sets {
    /// How many sets of training rows there are.
    pub(crate) fn count(&self) -> usize {
        self.training.len()
    }

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

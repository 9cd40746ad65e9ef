//! What one pass over the rows keeps of cells: Gram matrices by place in cross-validation, and ranges.

use std::collections::BTreeMap;

use faer::MatRef;
use fleetfoot_stats::{Fold, Gram};

/// Least and greatest value of every regressor.
type Ranges = Vec<[f64; 2]>;

/// The cells of a chunk's rows.
#[derive(Clone)]
pub(crate) struct CellPart {
    grams: Vec<Option<Gram>>,
    ranges: Vec<Option<Ranges>>,
}

impl CellPart {
    pub(crate) fn new(cells: usize) -> Self {
        Self { grams: vec![None; cells], ranges: vec![None; cells] }
    }

    /// Adds rows in their cells: regressors and targets in the preconditioner's coordinates, and the regressors as they are.
    pub(crate) fn add(&mut self, z: MatRef<'_, f64>, weights: Option<&[f64]>, cells: &[u32], regressors: &[&[f64]]) {
        for (cell, gram) in Gram::by_region(z, weights, cells, self.grams.len()) {
            match &mut self.grams[cell as usize] {
                Some(total) => total.merge(&gram),
                empty => *empty = Some(gram),
            }
        }
        for (row, &cell) in cells.iter().enumerate() {
            let Some(own) = self.ranges.get_mut(cell as usize) else { continue };
            let own = own.get_or_insert_with(|| nothing(regressors.len()));
            for (range, column) in own.iter_mut().zip(regressors) {
                *range = [range[0].min(column[row]), range[1].max(column[row])];
            }
        }
    }
}

fn nothing(regressors: usize) -> Ranges {
    vec![[f64::INFINITY, f64::NEG_INFINITY]; regressors]
}

/// The cells of all rows.
pub(crate) struct CellSums {
    by_fold: BTreeMap<Fold, Vec<Option<Gram>>>,
    ranges: Vec<Ranges>,
    /// Columns of a Gram matrix.
    width: usize,
}

impl CellSums {
    /// No rows yet, of so many cells and regressors.
    pub(crate) fn new(cells: usize, (regressors, width): (usize, usize)) -> Self {
        Self { by_fold: BTreeMap::new(), ranges: vec![nothing(regressors); cells], width }
    }

    /// Adds a chunk.
    pub(crate) fn add(&mut self, fold: Fold, part: CellPart) {
        let all = self.by_fold.entry(fold).or_insert_with(|| vec![None; part.grams.len()]);
        for (all, gram) in all.iter_mut().zip(part.grams) {
            match (all, gram) {
                (Some(all), Some(gram)) => all.merge(&gram),
                (empty @ None, Some(gram)) => *empty = Some(gram),
                (_, None) => {}
            }
        }
        for (all, own) in self.ranges.iter_mut().zip(part.ranges) {
            for (all, own) in all.iter_mut().zip(own.into_iter().flatten()) {
                *all = [all[0].min(own[0]), all[1].max(own[1])];
            }
        }
    }

    /// Ranges of regions that cells are joined to.
    pub(crate) fn ranges(&self, table: &[u32]) -> Vec<Ranges> {
        let regions = table.iter().max().map_or(0, |&last| last as usize + 1);
        let mut joined = vec![nothing(self.ranges.first().map_or(0, Vec::len)); regions];
        for (own, &region) in self.ranges.iter().zip(table) {
            for (all, own) in joined[region as usize].iter_mut().zip(own) {
                *all = [all[0].min(own[0]), all[1].max(own[1])];
            }
        }
        joined
    }

    /// All rows, and the training rows and held-out rows of every fold.
    pub(crate) fn sets(&self, folds: u16) -> Sets {
        let total = |wanted: &dyn Fn(&Fold) -> bool| -> Vec<Gram> {
            let mut sums = vec![Gram::new(self.width); self.ranges.len()];
            for (_, grams) in self.by_fold.iter().filter(|(fold, _)| wanted(fold)) {
                for (sum, gram) in sums.iter_mut().zip(grams) {
                    gram.iter().for_each(|gram| sum.merge(gram));
                }
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

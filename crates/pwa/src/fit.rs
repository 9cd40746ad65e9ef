//! Regression (paper, II-E.2): an affine model for every region, for all rows and for the training rows of every fold.
//!
//! Nothing here sees a row: all follows from the statistic. A region that saw nothing falls back on the one-region model.

use std::collections::BTreeMap;

use fleetfoot_model::{Partition, Rule};
use fleetfoot_stats::{Gram, Key, Preconditioner, SquareRoot, Stats, least_squares, ridge};
use fleetfoot_sums::system::SystemScan;

use crate::{
    Specification,
    lattice::{Sets, joined},
    region_model::{Base, RegionModel},
    segmentation::Candidate,
};

/// Square-root forms of the rows that train and are held out, whoever summed them.
pub(crate) trait Roots {
    /// All rows that train for `held`; of all without it. `None` when there are no rows.
    fn whole(&self, held: Option<u16>) -> Option<SquareRoot>;

    /// Training rows of the regions of a partition; regions without any are missing.
    fn training(&self, partition: usize, held: Option<u16>) -> BTreeMap<u32, SquareRoot>;

    /// Held-out rows of the regions of a partition; regions without any are missing.
    fn testing(&self, partition: usize, fold: u16) -> BTreeMap<u32, SquareRoot>;

    /// The one-region model of the rows that train for `held`. `None` when there are no rows.
    fn base(&self, held: Option<u16>) -> Option<Base> {
        self.whole(held).map(Base::new)
    }
}

/// Solves on a statistic, with and without a fold held out.
pub(crate) struct Solver<'a> {
    pub(crate) stats: &'a Stats,
    pub(crate) preconditioner: &'a Preconditioner,
    /// The partitions; those joined of cells have their sums in `cells`.
    pub(crate) partitions: &'a [Partition],
    pub(crate) cells: Option<&'a Sets>,
    /// The statistic of every partition that is made on all rows, where it has one.
    pub(crate) statistics: &'a [Option<SystemScan>],
}

impl Roots for Solver<'_> {
    fn whole(&self, held: Option<u16>) -> Option<SquareRoot> {
        if let (None, Some(Some(statistic))) = (held, self.statistics.first()) {
            return Some(statistic.root(0));
        }
        let gram = self.stats.total(|key| key.partition == 0 && trains(key, held))?;
        Some(self.preconditioner.square_root(&gram))
    }

    fn training(&self, partition: usize, held: Option<u16>) -> BTreeMap<u32, SquareRoot> {
        match (held, self.statistics.get(partition)) {
            (None, Some(Some(statistic))) => {
                let roots = (0..statistic.regions()).map(|region| (region as u32, statistic.root(region)));
                roots.filter(|(_, root)| root.weight > 0.0).collect()
            }
            _ => self.factored(self.grams(partition, held)),
        }
    }

    fn testing(&self, partition: usize, fold: u16) -> BTreeMap<u32, SquareRoot> {
        match self.joined(partition) {
            Some((table, cells)) => self.factored(joined(cells.testing(fold), table)),
            None => self.factored(self.stats.totals(|key| {
                (usize::from(key.partition) == partition && key.fold.held_out == fold).then_some(key.region)
            })),
        }
    }
}

impl Solver<'_> {
    /// Gram matrices, in the preconditioner's coordinates, of the regions of a partition that train for `held`; regions without rows are missing.
    pub(crate) fn grams(&self, partition: usize, held: Option<u16>) -> BTreeMap<u32, Gram> {
        match self.joined(partition) {
            Some((table, cells)) => joined(cells.training(held.map_or(0, |held| 1 + usize::from(held))), table),
            None => match (held, self.statistics.get(partition)) {
                // The one region's may be in other coordinates.
                (None, Some(Some(statistic))) if partition > 0 => {
                    let grams = (0..statistic.regions()).map(|region| (region as u32, statistic.gram(region)));
                    grams.filter(|(_, gram)| gram.weight > 0.0).collect()
                }
                _ => self
                    .stats
                    .totals(|key| (usize::from(key.partition) == partition && trains(key, held)).then_some(key.region)),
            },
        }
    }

    fn factored(&self, regions: BTreeMap<u32, Gram>) -> BTreeMap<u32, SquareRoot> {
        regions.into_iter().map(|(region, gram)| (region, self.preconditioner.square_root(&gram))).collect()
    }

    /// The region of every cell and the cells' sums, of a partition that is joined of cells.
    fn joined(&self, partition: usize) -> Option<(&[u32], &Sets)> {
        match (&self.partitions[partition].rule, self.cells) {
            (Rule::Joined { regions, .. }, Some(cells)) => Some((regions, cells)),
            _ => None,
        }
    }
}

/// The models of all `count` regions of a candidate, from the training statistics of its regions.
///
/// `shrinkage` is in rows. The region behaves as if it had seen that many more rows of standardised, independent
/// regressors that obey the one-region model: `min 1/(2n) rss + s/(2n) |D (beta - beta_average)|^2` with D the standard
/// deviations over all training rows.
pub(crate) fn region_models(
    candidate: &Candidate,
    count: usize,
    base: &Base,
    training: &BTreeMap<u32, SquareRoot>,
    shrinkage: f64,
) -> Vec<RegionModel> {
    match candidate.specification {
        Specification::Null => vec![base.null.clone()],
        Specification::Average => vec![base.average.clone()],
        _ => (0..count as u32)
            .map(|region| match training.get(&region) {
                None => base.average.clone(),
                Some(root) if shrinkage > 0.0 => {
                    let lambda = shrinkage / root.weight;
                    RegionModel::new(ridge(root, &base.scale, lambda, Some(base.average.coefficients.as_ref())))
                }
                Some(root) => RegionModel::new(least_squares(root, &base.scale)),
            })
            .collect(),
    }
}

/// Sum of squared errors of each target on held-out statistics.
pub(crate) fn held_out_error(models: &[RegionModel], testing: &BTreeMap<u32, SquareRoot>, targets: usize) -> Vec<f64> {
    let mut total = vec![0.0; targets];
    for (&region, root) in testing {
        let model = &models[(region as usize).min(models.len() - 1)];
        let error = root.error(model.coefficients.as_ref(), &model.intercept);
        total.iter_mut().zip(error).for_each(|(sum, error)| *sum += error);
    }
    total
}

fn trains(key: &Key, held: Option<u16>) -> bool {
    held.is_none_or(|held| key.fold.trains(held))
}

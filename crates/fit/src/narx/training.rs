//! Inputs of a fit: recipe, options, candidates, and the training rows or their sums.

use fleetfoot_data::Progress;
use fleetfoot_model::Partition;
use fleetfoot_recipe::Recipe;
use fleetfoot_sums::system::{System, SystemPlan, SystemScan};
use fleetfoot_task::{EquationTask, Provenance};

use super::{NarxOptions, TermRule, summed::Evidence, task::NarxBase};
use crate::{constant::refuse_constant_targets, error::Error, folds::smoothed_rows};

/// Inputs that all ways to a model share.
pub(crate) struct Fit<'a> {
    pub(crate) recipe: &'a Recipe,
    pub(crate) options: &'a NarxOptions,
    pub(crate) base: &'a NarxBase,
    /// The rows that train, or their sums.
    pub(crate) evidence: Evidence<'a>,
    pub(crate) step: f64,
    /// True to keep the other models of the front.
    pub(crate) rivals: bool,
}

impl Fit<'_> {
    /// Rows over which the logs were smoothed before.
    pub(crate) fn smoothed(&self) -> usize {
        smoothed_rows(self.options.smoothed, self.step)
    }

    /// The statistic of the training rows.
    pub(crate) fn scan(
        &self,
        task: &EquationTask,
        partition: Option<&Partition>,
        progress: &dyn Progress,
    ) -> Result<SystemScan, Error> {
        match self.evidence {
            Evidence::Rows(source) => {
                progress.stage("scan");
                let system = System { partition: partition.cloned(), ..task.system() };
                Ok(SystemPlan::new(system, None, source)?.scan(source, progress)?)
            }
            Evidence::Sums(sums) => sums.scan(task, partition),
        }
    }

    /// Refuses to fit more terms than there are rows.
    pub(crate) fn check(&self, whole: &SystemScan, candidates: usize) -> Result<(), Error> {
        let counts = whole.counts();
        let needed = match self.options.terms {
            TermRule::All => candidates,
            TermRule::Count(count) => count,
            TermRule::Auto(_) => 1,
        };
        if counts.complete as usize > needed {
            return refuse_constant_targets(&self.base.task, whole.also());
        }
        Err(Error::too_few_rows(
            counts.complete,
            needed as u64 + 1,
            format!(
                "{} rows have all lags ({} lack them at the border of their episode, {} miss a value), an equation has {needed} terms; give longer episodes, fewer lags \
             or fewer terms",
                counts.complete, counts.at_border, counts.incomplete
            ),
        ))
    }

    pub(crate) fn provenance(&self, partition: Option<&Partition>, seed: u64) -> Provenance {
        let regions = partition.map_or_else(String::new, |partition| format!(" {}", partition.specification));
        Provenance {
            method: format!("narx{regions}"),
            recipe: self.recipe.to_toml(),
            seed,
            step: self.step,
            episodes: self.evidence.episodes(),
        }
    }
}

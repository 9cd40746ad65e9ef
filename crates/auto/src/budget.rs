//! The candidates that an effort allows. Work is counted in operations and never in seconds: the same rows have the same candidates on every machine.

use fleetfoot_data::setting::EFFORT;
use fleetfoot_data::{Silent, Work};
use fleetfoot_dataset::Logs;
use fleetfoot_fit::{FitRequest, Narx, Network, Sindy, plan};
use fleetfoot_recipe::{Effort, Lags};

use crate::candidates::{Kind, Rows, Trial};

/// Operations of refined regions and of trees, for every row and regressor: measured beside fits of equations, whose
/// plans have estimates.
const OF_REGIONS: f64 = 3e4;
/// Operations of a linear model, for every row and pair of regressors: factors of all rows, of their folds and for the intervals.
const OF_LINEAR: f64 = 20.0;
/// Candidates of the largest size that all together may take.
const TOGETHER: f64 = 6.0;

/// Operations of every candidate, and whether they are borne.
pub(crate) struct Budget {
    operations: Vec<f64>,
    borne: Vec<bool>,
}

impl Budget {
    /// The candidates in their order, until the effort is used up.
    pub(crate) fn of(trials: &[Trial], rows: &Rows, logs: &Logs) -> Self {
        let most = match rows.effort {
            Effort::Low => 3e8,
            Effort::Normal => 1.2e9,
            Effort::High => 1e11,
        };
        let operations: Vec<f64> = trials.iter().map(|trial| operations(trial, rows, logs)).collect();
        let mut sum = 0.0;
        let borne = operations.iter().zip(trials).map(|(&cost, trial)| {
            // A network comes last: what the others leave is its.
            let of_one = if trial.kind == Kind::Network { TOGETHER * most } else { most };
            let borne = cost <= of_one && sum + cost <= TOGETHER * most;
            sum += if borne { cost } else { 0.0 };
            borne
        });
        Self { borne: borne.collect(), operations }
    }

    /// The operations of the candidates that will be tried.
    pub(crate) fn work(&self) -> Work {
        let borne = self.operations.iter().zip(&self.borne).filter(|(_, borne)| **borne);
        Work {
            operations: borne.map(|(cost, _)| cost).sum(),
            parts: 2,
            mend: format!(
                "{given_effort} makes it shorter; Ctrl-C writes the best so far",
                given_effort = EFFORT.to("low")
            ),
        }
    }

    /// Why a candidate is not tried; `None` where it is.
    pub(crate) fn refusal(&self, at: usize) -> Option<String> {
        (!self.borne[at])
            .then(|| format!("not tried: {:.0e} operations; {} tries it", self.operations[at], EFFORT.to("high")))
    }
}

/// Operations of a candidate, about. 0 for a cheap one, and for one that cannot be planned: its fit reports the reason.
fn operations(trial: &Trial, rows: &Rows, logs: &Logs) -> f64 {
    let request = FitRequest::default();
    match trial.kind {
        Kind::Sindy => plan::<Sindy>(&trial.recipe, &request, logs, &Silent).map_or(0.0, |plan| plan.work.operations),
        Kind::Narx => plan::<Narx>(&trial.recipe, &request, logs, &Silent).map_or(0.0, |plan| plan.work.operations),
        Kind::Network => {
            plan::<Network>(&trial.recipe, &request, logs, &Silent).map_or(0.0, |plan| plan.work.operations)
        }
        Kind::Parameters => 0.0,
        Kind::Pwa => {
            let partition = trial.recipe.model.partition.as_deref().unwrap_or_default();
            let lags = trial.recipe.model.lags.into_iter().flat_map(Lags::steps).count();
            let (regressors, training) = (rows.columns * (lags + 1), rows.training / trial.every);
            match partition.starts_with("refined") || partition.starts_with("tree") {
                true => OF_REGIONS * (training * regressors) as f64,
                false => OF_LINEAR * (training * regressors * regressors) as f64,
            }
        }
    }
}

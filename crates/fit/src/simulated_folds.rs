//! Simulations of every fold's held-out rows by models fitted to the other folds, for the comparison of different
//! methods.

use fleetfoot_data::{Progress, Silent, Source};
use fleetfoot_dynamics::{Baseline, Horizon, Method as Integration, RolloutOptions, Starts};
use fleetfoot_model::Model;

use crate::{
    error::Error,
    folds::smoothed_rows,
    method::{Data, Method},
    rollout_choice::{HeldOut, RolloutRule},
};

/// Simulations of models on held-out rows. They begin at the same rows for all models of the same recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Simulations {
    /// Folds, steps, and the most simulations of a fold.
    pub rule: RolloutRule,
    /// Rows in front of every start: a model that looks further back cannot be compared.
    pub before: usize,
    /// A model that errs more on the rows that trained it is not fitted to the folds: it cannot err less on others.
    pub limit: Option<f64>,
}

/// Simulations of a model on the folds, or why there are none.
#[derive(Debug, Clone, PartialEq)]
pub enum FoldSimulations {
    /// The folds, each simulated by a model of the other folds.
    HeldOut(Vec<SimulatedFold>),
    /// Error of the model on the rows that trained it, which is beyond the limit ([`Simulations::limit`]).
    BeyondLimit(f64),
}

/// Simulations of every fold that show whether a model is beyond the limit.
const FEW: usize = 10;

/// Errors of the simulations of one fold.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedFold {
    /// The states.
    pub states: Vec<String>,
    /// Root of the mean squared error over all steps, by state; a simulation that ended early stays at its last good state.
    pub model: Vec<f64>,
    /// The same of persistence.
    pub persistence: Vec<f64>,
    /// Simulations that ended early.
    pub ended: usize,
    /// Simulations.
    pub starts: usize,
}

impl SimulatedFold {
    /// Error over that of persistence, mean over the states that move; infinite where a simulation ended early.
    pub fn error(&self) -> f64 {
        let ratios = self.model.iter().zip(&self.persistence).filter(|(_, still)| **still > 0.0);
        let ratios: Vec<f64> = ratios.map(|(model, still)| model / still).collect();
        if self.ended > 0 || ratios.is_empty() {
            return f64::INFINITY;
        }
        ratios.iter().sum::<f64>() / ratios.len() as f64
    }
}

/// Root of the mean over all steps of the squared error, by state; of a table of steps x states.
pub fn over_steps(rmse: &[f64], states: usize) -> Vec<f64> {
    let of = |state: usize| {
        let known = rmse.iter().skip(state).step_by(states).filter(|value| value.is_finite());
        let (sum, count) = known.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
        (sum / count).sqrt()
    };
    (0..states).map(of).collect()
}

/// Errors of a model and of persistence over a horizon, by state.
pub fn against_persistence(horizon: &Horizon) -> (Vec<f64>, Vec<f64>) {
    let states = horizon.states.len();
    let still = horizon.baselines.iter().find(|(baseline, _)| *baseline == Baseline::Persistence);
    let still = still.map_or_else(|| vec![f64::NAN; states], |(_, score)| over_steps(&score.rmse, states));
    (over_steps(&horizon.model.rmse, states), still)
}

/// Options of `auto`'s simulations; models of derivatives take Runge-Kutta steps of the fourth order.
pub fn simulation_options(horizon: usize) -> RolloutOptions {
    let mut options = RolloutOptions::new(horizon);
    options.method = Integration::Rk4;
    // A large error counts as one; what has no number any more has diverged.
    options.divergence = 1e6;
    options
}

/// Rows of the longest span that every one of so many folds holds out: an upper limit of the horizon.
///
/// # Errors
/// Too few rows for the folds.
pub fn fold_room(rows: &dyn Source, folds: usize, smoothed: Option<f64>, step: f64) -> Result<usize, Error> {
    let rule = RolloutRule { folds, ..RolloutRule::new(1) };
    Ok(HeldOut::new((rows, smoothed_rows(smoothed, step)), rule, "auto")?.room())
}

/// The chosen candidate fitted to the training rows of every fold, and simulated on the others.
pub(crate) fn simulated_folds<M: Method>(
    method: &M,
    data: Data<'_, M::Task>,
    solution: &M::Solution,
    wanted: &Simulations,
    progress: &dyn Progress,
) -> Result<FoldSimulations, Error> {
    let smoothed = smoothed_rows(data.recipe.time.smoothed, data.step);
    let held = HeldOut::new((data.rows()?, smoothed), wanted.rule, "auto")?;
    if let Some(limit) = wanted.limit {
        let few = Simulations { rule: RolloutRule { starts: FEW, ..wanted.rule }, ..*wanted };
        let mut errors = Vec::with_capacity(wanted.rule.folds);
        progress.stage("simulations");
        held.each(|_, kept| {
            errors.push(simulated(M::model(solution), kept, &few)?.error());
            Ok(())
        })?;
        let error = errors.iter().sum::<f64>() / errors.len() as f64;
        if error > limit {
            return Ok(FoldSimulations::BeyondLimit(error));
        }
    }
    let mut folds = Vec::with_capacity(wanted.rule.folds);
    held.each(|train, kept| {
        let model = method.same_terms(Data { rows: Some(train), kept: None, ..data }, solution, progress)?;
        progress.stage("simulations");
        folds.push(simulated(&model, kept, wanted)?);
        Ok(())
    })?;
    Ok(FoldSimulations::HeldOut(folds))
}

/// Simulates a model on rows that did not train it.
fn simulated(model: &Model, kept: &dyn Source, wanted: &Simulations) -> Result<SimulatedFold, Error> {
    let RolloutRule { horizon, starts, .. } = wanted.rule;
    let starts = Starts::At(Starts::Even(starts).choose(kept, horizon, wanted.before, horizon + 1)?);
    let rollout = fleetfoot_dynamics::rollout(model, kept, &starts, &simulation_options(horizon), &Silent)?;
    let (model, persistence) = against_persistence(&rollout.horizon);
    Ok(SimulatedFold {
        states: rollout.horizon.states.clone(),
        model,
        persistence,
        ended: rollout.diverged() + rollout.without_region(),
        starts: rollout.outcomes.len(),
    })
}

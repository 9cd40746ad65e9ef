//! Held-out error of a model with parameters: refitted without a fold, and simulated over it.

use fleetfoot_data::setting::FOLDS;
use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{Method, RolloutOptions, Starts};
use fleetfoot_model::Model;
use fleetfoot_task::ParametersTask;

use super::{EstimateOptions, ParametersHeldOut, again, closed, report::Estimate};
use crate::{
    error::Error,
    rollout_choice::{HeldOut, RolloutRule, USUAL_HORIZON},
};

/// Rollouts of the common folds; a note in their place where the logs are too short for them.
pub(super) fn held_out(
    task: &ParametersTask,
    open: &Model,
    estimate: &Estimate,
    (source, smoothed): (&dyn Source, usize),
    options: &EstimateOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Option<ParametersHeldOut>, Error> {
    if options.folds == 0 {
        notes.push("no rows are held out (folds = 0): all errors are in-sample".into());
        return Ok(None);
    }
    match rollouts(task, open, estimate, (source, smoothed), options, progress) {
        Ok(held_out) => Ok(Some(held_out)),
        Err(Error::Cancelled(cancelled)) => Err(cancelled.into()),
        Err(error) => {
            notes.push(format!("no rows are held out, so all errors are in-sample: {error}"));
            Ok(None)
        }
    }
}

fn rollouts(
    task: &ParametersTask,
    open: &Model,
    estimate: &Estimate,
    (source, smoothed): (&dyn Source, usize),
    options: &EstimateOptions,
    progress: &dyn Progress,
) -> Result<ParametersHeldOut, Error> {
    let rule = RolloutRule { folds: options.folds, ..RolloutRule::new(USUAL_HORIZON) };
    let held = HeldOut::new((source, smoothed), rule, FOLDS.to_string())?;
    let mut shares = Vec::with_capacity(rule.folds);
    let (mut ended, mut starts) = (0, 0);
    held.each(|train, rows| {
        // Nothing of the held-out rows corrects the simulations of any method.
        let refitted = again(task, open, train, options, estimate, progress)?;
        let mut simulation = RolloutOptions::new(rule.horizon);
        // As the parameters were fitted.
        simulation.method = Method::Rk4;
        let rollouts = held.simulated(&closed(open, task, &refitted), rows, &Starts::Even(rule.starts), &simulation)?;
        shares.push(rollouts.share);
        ended += rollouts.ended;
        starts += rollouts.starts;
        Ok(())
    })?;
    Ok(ParametersHeldOut { horizon: rule.horizon, folds: shares, ended, starts })
}

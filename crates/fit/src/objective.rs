//! Objective of the coefficients: one step, or simulations of several steps. Held-out rows decide between the two
//! models.

mod held;
mod report;

use fleetfoot_data::setting::OBJECTIVE;
use fleetfoot_data::{Progress, Silent, Source};
use fleetfoot_dynamics::{
    Coefficient, Error as DynamicsError, Method, RolloutOptions, ScoreOptions, Scores, Simulator, Starts, score,
};
use fleetfoot_estimate::{EstimateError, Hold, Simulated, SimulationOptions, WHOLE_COEFFICIENTS, simulation_errors};
use fleetfoot_model::Model;
use fleetfoot_recipe::{MOST_STEPS, Objective};
pub(crate) use held::Bound;
pub(crate) use report::Coefficients;
use serde::{Deserialize, Serialize};

use crate::{
    error::Error,
    model_file::refuse_not_finite,
    rollout_choice::{HeldOut, RolloutRule, SAME},
};

/// Rollouts of every fold, at most, by which the two models are compared.
const STARTS: usize = 200;
/// Numbers that the derivatives of a segment may take if its length is not given: 128 MiB, of which every chunk in
/// flight has one.
const DERIVATIVES: usize = 1 << 24;
/// Factor of the second, longer horizon of the comparison: a model fitted to N steps may diverge later.
const FAR: usize = 10;

/// Rule by which rollouts compare the model of the simulations with that of one step; `None` for one step. A free run
/// counts `free` steps.
pub(crate) fn rule(objective: Objective, free: usize) -> Option<RolloutRule> {
    let steps = match objective {
        Objective::OneStep => return None,
        Objective::Steps(steps) => steps as usize,
        Objective::FreeRun => free,
    };
    Some(RolloutRule { starts: STARTS, ..RolloutRule::new(steps) })
}

/// Passes over the rows that it takes beside those of the fit, at most; `fit` passes make a model of one step. `many`: of more than 2,000 coefficients, or of maps that are bounded.
pub(crate) fn passes(objective: Objective, fit: usize, many: bool) -> usize {
    rule(objective, 1).map_or(0, |rule| {
        let passes = SimulationOptions::new(rule.horizon).passes(0, many);
        // The training rows of a fold are fewer, so that its passes are less than the fit's own.
        passes + rule.folds * (fit + passes)
    })
}

/// Cost of a job, for people; `None` for the objective of one step. `bounded`: true if the maps are bounded.
pub fn simulation_cost(objective: Objective, fit: usize, bounded: bool) -> Option<String> {
    let rule = rule(objective, 1)?;
    let steps = match objective {
        Objective::FreeRun => "as many steps as they have room for".to_owned(),
        _ => format!("{} steps", rule.horizon),
    };
    let more = match bounded {
        true => String::new(),
        false => format!(", {} of more than {WHOLE_COEFFICIENTS} coefficients", passes(objective, fit, true)),
    };
    Some(format!(
        "{given_objective}: at most {} more passes over the rows{more}, with {} x {} rollouts of {steps} on rows that did not train",
        passes(objective, fit, bounded),
        2 * rule.folds,
        rule.starts,
        given_objective = OBJECTIVE.to(objective)
    ))
}

/// Note if a model has no coefficients to fit to simulations.
pub(crate) fn note(objective: Objective, refinement: Option<&Refinement>) -> Option<String> {
    let nothing = objective != Objective::OneStep && refinement.is_none();
    nothing.then(|| {
        format!("objective = \"{objective}\": the model has no coefficients that could be fitted to simulations")
    })
}

/// Refuses an objective that needs rows for a statistic, which has none.
pub(crate) fn refuse_statistic(objective: Objective) -> Result<(), Error> {
    match objective {
        Objective::OneStep => Ok(()),
        Objective::Steps(_) | Objective::FreeRun => Err(Error::needs_rows(format!(
            "objective = \"{objective}\" simulates the rows of logs, and a statistic has none: fit on the logs, or remove it"
        ))),
    }
}

/// A model that was fitted to its simulations, beside the one of one step.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Refinement {
    /// Steps of a segment and of the rollouts, and folds.
    pub rule: RolloutRule,
    /// The fit to the simulations of all rows.
    pub fitted: Simulated,
    /// The fitted model one step ahead, on the rows that it was fitted to.
    pub training: Scores,
    /// Steps of the longer rollouts, at most ten times those of the segments.
    pub far: usize,
    /// Both models on the rows of every fold, fitted on those of the others.
    pub folds: Vec<RefinedFold>,
    /// Held-out errors of each weight of the prior, the heaviest first. Empty for few coefficients, which have no
    /// prior.
    pub weights: Vec<WeightErrors>,
    /// Contraction of the fitted model's maps; `None` without a bound.
    pub bound: Option<Bounded>,
    /// True if the model of the simulations is written: it has the lower error in held-out rollouts, and no higher one
    /// in the longer ones.
    pub written: bool,
}

/// A weight of the prior, on rows that did not train: means over the folds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct WeightErrors {
    /// The weight, in squares of the steps ([`fleetfoot_estimate::ManyOptions::weights`]).
    pub weight: f64,
    /// As [`HeldOutErrors::rollouts`].
    pub rollouts: f64,
    /// As [`HeldOutErrors::far`].
    pub far: f64,
}

/// Contraction of the maps of a fitted model: the greatest value over its regions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Bounded {
    /// The bound of the norms.
    pub bound: f64,
    /// Spectral radius.
    pub radius: f64,
    /// Norm in the metric of the fit of one step.
    pub norm: f64,
    /// Energy that the maps give at their ports, over the allowed energy; `None` unless they are passive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passive_norm: Option<f64>,
}

/// Two models on rows that trained neither.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct RefinedFold {
    /// Fitted to one step.
    pub one_step: HeldOutErrors,
    /// Fitted to simulations.
    pub simulated: HeldOutErrors,
}

/// Errors of a model on rows that did not train it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct HeldOutErrors {
    /// Squared error of rollouts over that of persistence, its root, the mean over the states; a rollout that ended early with its last good state.
    pub rollouts: f64,
    /// The same of the longer rollouts.
    pub far: f64,
    /// Rollouts, of [`Refinement::rule`]'s steps, that ended early.
    pub ended: usize,
    /// Rollouts.
    pub starts: usize,
    /// One step ahead.
    pub one_step: Scores,
}

impl HeldOutErrors {
    fn of(model: &Model, held: &dyn Source, rule: &HeldOut<'_>, far: usize) -> Result<Self, Error> {
        let simulated = |steps: usize| {
            let mut options = RolloutOptions::new(steps);
            // As the coefficients were fitted.
            options.method = Method::Rk4;
            rule.simulated(model, held, &Starts::Even(rule.rule().starts), &options)
        };
        let refined = simulated(rule.rule().horizon)?;
        Ok(Self {
            rollouts: refined.share,
            far: if far > rule.rule().horizon { simulated(far)?.share } else { refined.share },
            ended: refined.ended,
            starts: refined.starts,
            one_step: score(model, held, &ScoreOptions::default(), &Silent)?,
        })
    }

    /// Mean absolute error one step ahead over that of the null model, the mean over the targets.
    pub fn over_null(&self) -> f64 {
        let shares: Vec<f64> = self.one_step.targets.iter().map(|target| target.mae_over_null.value).collect();
        shares.iter().sum::<f64>() / shares.len() as f64
    }
}

/// A model of one step, and the set in which a fit to simulations has to keep it.
pub(crate) type Beginning = (Model, Option<Box<dyn Hold>>);

/// Fits to simulations, one a weight of the prior if there is one, up to so many. A recording that is too short is
/// refused, with the remedy.
fn fitted(
    objective: Objective,
    (model, hold): &Beginning,
    (steps, weights): (usize, usize),
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Vec<Simulated>, Error> {
    let mut options = SimulationOptions::new(steps);
    options.many.weights.truncate(weights);
    simulation_errors(model, source, &options, hold.as_deref(), progress).map_err(|error| match error {
        EstimateError::Dynamics(error @ DynamicsError::TooShort { .. }) => Error::undetermined(format!(
            "{given_objective}: {error}: ask for fewer steps, or give longer logs",
            given_objective = OBJECTIVE.to(objective)
        )),
        error => error.into(),
    })
}

/// The weight of least error over the steps of the segments, among those whose error over more steps is no higher than
/// that of the one-step model. If all are higher, the one of the least such error.
fn chosen(weights: &[WeightErrors], one_far: f64) -> usize {
    let key = |at: &usize| {
        let weight = &weights[*at];
        if weight.far <= one_far { (0, weight.rollouts) } else { (1, weight.far) }
    };
    let least = |a: &usize, b: &usize| {
        let (a, b) = (key(a), key(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    };
    (0..weights.len()).min_by(least).unwrap_or(0)
}

/// Fits a model to its simulations. `None` for the objective of one step, and for a model without coefficients
/// ([`Objective::note`]). `fit` makes a model of one step of some rows. `smoothed`: rows over which the source was
/// smoothed before.
///
/// Many coefficients, and bounded ones, have a prior. Its weight is the one with the lowest held-out error.
///
/// # Errors
/// Those of `fit` and of fitting; held-out spans shorter than the simulations.
pub(crate) fn refine(
    objective: Objective,
    beginning: &Beginning,
    (source, smoothed): (&dyn Source, usize),
    progress: &dyn Progress,
    mut fit: impl FnMut(&dyn Source) -> Result<Beginning, Error>,
) -> Result<Option<Refinement>, Error> {
    let model = &beginning.0;
    if Coefficient::support(model).is_empty() {
        return Ok(None);
    }
    let Some(judged) = rule(objective, 1) else { return Ok(None) };
    let mut held = HeldOut::new(
        (source, smoothed),
        judged,
        format!("{given_objective}", given_objective = OBJECTIVE.to(objective)),
    )?
    .mended("ask for fewer steps");
    let mut before: Vec<Beginning> = Vec::with_capacity(judged.folds);
    held.each(|train, _| {
        before.push(fit(train)?);
        Ok(())
    })?;
    if objective == Objective::FreeRun {
        // The models of folds may reach further back than the model of all rows.
        let models = before.iter().map(|(model, _)| model).chain([model]);
        let reach: Vec<usize> = models.map(|model| longest(model, source, held.room())).collect::<Result<_, _>>()?;
        held.reach(reach.into_iter().min().unwrap_or(1));
    }
    let rule = held.rule();
    let far = held.far(FAR * rule.horizon);
    let most = SimulationOptions::new(rule.horizon).many.weights.len();
    let mut trials: Vec<Trial> = Vec::with_capacity(rule.folds);
    held.each(|train, rows| {
        let before = &before[trials.len()];
        progress.stage(&format!("simulation error, without fold {} of {}", trials.len() + 1, rule.folds));
        let after = match Coefficient::support(&before.0).is_empty() {
            true => vec![(None, before.0.clone())],
            false => fitted(objective, before, (rule.horizon, most), train, progress)?
                .into_iter()
                .map(|refinement| (refinement.weight, refinement.model))
                .collect(),
        };
        let errors = |model: &Model| HeldOutErrors::of(model, rows, &held, far);
        let simulated =
            after.iter().map(|(weight, model)| Ok((*weight, errors(model)?))).collect::<Result<_, Error>>()?;
        trials.push(Trial { one_step: errors(&before.0)?, simulated });
        Ok(())
    })?;
    let weights = weights(&trials);
    let one_far = trials.iter().map(|trial| trial.one_step.far).sum::<f64>() / trials.len() as f64;
    let chosen = chosen(&weights, one_far);
    let folds = trials.into_iter().map(|trial| trial.fold(chosen)).collect();
    progress.stage("simulation error");
    let fitted = fitted(objective, beginning, (rule.horizon, chosen + 1), source, progress)?.pop();
    let Some(fitted) = fitted else { return Ok(None) };
    refuse_not_finite(&fitted.model)?;
    let changed = fitted.model.latents != model.latents;
    let training = score(&fitted.model, source, &ScoreOptions::default(), progress)?;
    let mut refinement = Refinement { rule, far, fitted, training, folds, weights, bound: None, written: false };
    let ([one_step, simulated], [one_far, simulated_far]) = (refinement.rollouts(), refinement.far_rollouts());
    refinement.written = changed && simulated < one_step * (1.0 - SAME) && simulated_far <= one_far;
    Ok(Some(refinement))
}

/// Steps of a free run through so many rows, limited by the memory of its derivatives.
fn longest(model: &Model, source: &dyn Source, rows: usize) -> Result<usize, Error> {
    let simulator = Simulator::for_source(model, source, RolloutOptions::new(1).step)?;
    let taken = |steps: usize| {
        let needed = simulator.needed_rows(steps);
        needed.before + 1 + needed.after
    };
    let room = (2..=rows).rev().find(|&steps| taken(steps) <= rows).ok_or_else(|| {
        Error::undetermined(format!(
            "{given_objective}: the longest of the held-out spans have {rows} rows, too few for a simulation: give longer logs", given_objective = OBJECTIVE.to("free-run")
        ))
    })?;
    let numbers = Coefficient::support(model).len() * simulator.states().len();
    // Every chunk of rows is read with a segment's behind it: no free run is longer than segments that are asked for may be.
    Ok(room.min(DERIVATIVES / numbers.max(1)).clamp(1, MOST_STEPS as usize))
}

/// The models of a fold, on the rows that it holds out.
struct Trial {
    one_step: HeldOutErrors,
    /// By the weight of the prior, where there is one.
    simulated: Vec<(Option<f64>, HeldOutErrors)>,
}

impl Trial {
    /// With the weight that was chosen.
    fn fold(mut self, chosen: usize) -> RefinedFold {
        let simulated = self.simulated.swap_remove(chosen.min(self.simulated.len() - 1)).1;
        RefinedFold { one_step: self.one_step, simulated }
    }
}

/// Means over the folds; none where a fold has no prior.
fn weights(trials: &[Trial]) -> Vec<WeightErrors> {
    let count = trials.iter().map(|trial| trial.simulated.len()).min().unwrap_or(0);
    let mean = |at: usize, of: fn(&HeldOutErrors) -> f64| {
        trials.iter().map(|trial| of(&trial.simulated[at].1)).sum::<f64>() / trials.len() as f64
    };
    let of = |at: usize| {
        let weight = trials.first().and_then(|trial| trial.simulated[at].0)?;
        Some(WeightErrors { weight, rollouts: mean(at, |errors| errors.rollouts), far: mean(at, |errors| errors.far) })
    };
    (0..count).map_while(of).collect()
}

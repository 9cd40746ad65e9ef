//! What coefficients are fitted to: one step, or simulations of several; and whether rows that did not train find the second better.

mod report;

pub(crate) use report::coefficient;

use fleetfoot_data::{Progress, Silent, Source};
use fleetfoot_dynamics::{
    Coefficient, Error as DynamicsError, Method, RolloutOptions, ScoreOptions, Scores, Starts, score,
};
use fleetfoot_estimate::{EstimateError, Simulated, SimulationOptions, simulation_error};
use fleetfoot_model::Model;

use crate::{
    Error, Objective, RolloutRule,
    output::refuse_not_finite,
    rollout_choice::{HeldOut, SAME},
};

/// Rollouts of every fold, at most, by which the two models are compared.
const STARTS: usize = 200;
/// How much longer the second horizon is by which they are compared: what is fitted to N steps may run away later.
const FAR: usize = 10;

impl Objective {
    /// How the model of the simulations is compared with that of one step, where there is one.
    pub fn rule(self) -> Option<RolloutRule> {
        match self {
            Self::OneStep => None,
            Self::Steps(steps) => Some(RolloutRule { starts: STARTS, ..RolloutRule::new(steps as usize) }),
        }
    }

    /// Passes over the rows that it takes beside those of the fit, at most; `fit` passes make a model of one step.
    pub fn passes(self, fit: usize) -> usize {
        self.rule().map_or(0, |rule| {
            let own = SimulationOptions::new(rule.horizon).passes();
            // The training rows of a fold are fewer, so that its passes are less than the fit's own.
            own + rule.folds * (fit + own)
        })
    }

    /// What a job will cost, for people; nothing where the objective is one step.
    pub fn in_words(self, fit: usize) -> Option<String> {
        let rule = self.rule()?;
        Some(format!(
            "--objective {self}: at most {} passes over the rows more, with {} x {} rollouts of {} steps on rows that did not train",
            self.passes(fit),
            2 * rule.folds,
            rule.starts,
            rule.horizon
        ))
    }

    /// What to know where nothing came of it.
    pub(crate) fn note(self, refinement: Option<&Refinement>) -> Option<String> {
        let nothing = self != Self::OneStep && refinement.is_none();
        nothing.then(|| {
            format!("objective = \"{self}\": the model has no coefficients that could be fitted to simulations")
        })
    }

    /// Refuses what needs rows where there are none.
    pub(crate) fn refuse_statistic(self) -> Result<(), Error> {
        match self {
            Self::OneStep => Ok(()),
            Self::Steps(_) => Err(Error::needs_rows(format!(
                "objective = \"{self}\" simulates the rows of logs, and a statistic has none: fit on the logs, or leave it away"
            ))),
        }
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
    /// Whether the model of the simulations is the better one in rollouts of rows that did not train, and not worse in the longer ones: then it is the one that
    /// is written.
    pub written: bool,
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
        let found = simulated(rule.rule().horizon)?;
        Ok(Self {
            rollouts: found.share,
            far: if far > rule.rule().horizon { simulated(far)?.share } else { found.share },
            ended: found.ended,
            starts: found.starts,
            one_step: score(model, held, &ScoreOptions::default(), &Silent)?,
        })
    }

    /// Mean absolute error one step ahead over that of the null model, the mean over the targets.
    pub fn over_null(&self) -> f64 {
        let shares: Vec<f64> = self.one_step.targets.iter().map(|target| target.mae_over_null.value).collect();
        shares.iter().sum::<f64>() / shares.len() as f64
    }
}

/// A fit to simulations; what is too short for it is told with the mend.
fn fitted(
    objective: Objective,
    model: &Model,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Simulated, Error> {
    let steps = objective.rule().map_or(1, |rule| rule.horizon);
    simulation_error(model, source, &SimulationOptions::new(steps), progress).map_err(|error| match error {
        EstimateError::Dynamics(error @ DynamicsError::TooShort { .. }) => {
            Error::undetermined(format!("--objective {objective}: {error}: ask for fewer steps, or give longer logs"))
        }
        error => error.into(),
    })
}

/// Fits a model to its simulations as the objective says; `None` for one step, and for a model without coefficients ([`Objective::note`]). `fit` makes a model of one
/// step of some rows; `smoothed`: rows over which the source was smoothed before.
///
/// # Errors
/// Those of `fit` and of fitting; held-out spans shorter than the simulations.
pub(crate) fn refine(
    objective: Objective,
    model: &Model,
    (source, smoothed): (&dyn Source, usize),
    progress: &dyn Progress,
    mut fit: impl FnMut(&dyn Source) -> Result<Model, Error>,
) -> Result<Option<Refinement>, Error> {
    let Some(rule) = objective.rule().filter(|_| !Coefficient::support(model).is_empty()) else { return Ok(None) };
    let held = HeldOut::new((source, smoothed), rule, format!("--objective {objective}"))?;
    let far = held.far(FAR * rule.horizon);
    let mut folds = Vec::with_capacity(rule.folds);
    held.each(|train, rows| {
        let before = fit(train)?;
        progress.stage("simulation error, without a fold");
        let after = match Coefficient::support(&before).is_empty() {
            true => before.clone(),
            false => fitted(objective, &before, train, progress)?.model,
        };
        let errors = |model: &Model| HeldOutErrors::of(model, rows, &held, far);
        folds.push(RefinedFold { one_step: errors(&before)?, simulated: errors(&after)? });
        Ok(())
    })?;
    progress.stage("simulation error");
    let fitted = fitted(objective, model, source, progress)?;
    refuse_not_finite(&fitted.model)?;
    let changed = fitted.model.latents != model.latents;
    let training = score(&fitted.model, source, &ScoreOptions::default(), progress)?;
    let mut refinement = Refinement { rule, far, fitted, training, folds, written: false };
    let ([one_step, simulated], [one_far, simulated_far]) = (refinement.rollouts(), refinement.far_rollouts());
    refinement.written = changed && simulated < one_step * (1.0 - SAME) && simulated_far <= one_far;
    Ok(Some(refinement))
}

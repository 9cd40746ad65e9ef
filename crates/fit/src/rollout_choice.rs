//! Choice of models by rollouts of rows that did not train.
//!
//! One-step errors say little about a simulation: errors of a derivative add up. Here every candidate is fitted on the
//! training rows of each fold, and simulated over the held-out spans.

use fleetfoot_data::setting::{HORIZON, SELECT};
use fleetfoot_data::{Progress, Silent, Source};
use fleetfoot_dynamics::{Baseline, Error as DynamicsError, Horizon, RolloutOptions, Starts, rollout};
use fleetfoot_model::Model;
use fleetfoot_recipe::{Derivative, Recipe};
use serde::{Serialize, Serializer};

use crate::{error::Error, spans::Spans};

/// Rule by which rollouts compare candidates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct RolloutRule {
    /// Steps of a rollout.
    pub horizon: usize,
    /// Folds whose spans are held out in turn.
    pub folds: usize,
    /// Rollouts of every fold, at most.
    pub starts: usize,
}

/// Steps of a rollout where none are given.
pub const USUAL_HORIZON: usize = 50;

impl RolloutRule {
    /// Rollouts of so many steps, 50 in each of five folds.
    pub fn new(horizon: usize) -> Self {
        Self { horizon, folds: 5, starts: 50 }
    }
}

/// Spans that `over = "auto"` compares, rows; a central difference competes with them.
pub(crate) const SPANS: [u32; 5] = [2, 5, 10, 20, 50];

/// A candidate of a choice by rollouts.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct RolloutCandidate {
    /// The partition, as the user wrote it; `average` for one region.
    pub partition: String,
    /// Rows of the mean slopes where the span was open; `None`: central differences.
    pub over: Option<u32>,
    /// Regions, or terms: of candidates whose errors are the same the smallest is taken.
    #[serde(rename = "terms")]
    pub size: usize,
    /// Squared error of the rollouts over that of persistence, its root, the mean over the states, of every fold. Infinite where one diverged.
    pub folds: Vec<f64>,
}

impl RolloutCandidate {
    /// Mean over the folds.
    pub fn error(&self) -> f64 {
        self.folds.iter().sum::<f64>() / self.folds.len() as f64
    }
}

/// Candidate chosen by rollouts.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RolloutChoice {
    /// Rule of the comparison.
    pub rule: RolloutRule,
    /// Compared candidates.
    pub candidates: Vec<RolloutCandidate>,
    /// Index of the one that was taken.
    pub chosen: usize,
}

/// Errors that differ by less count as equal.
pub(crate) const SAME: f64 = 1e-3;

impl RolloutChoice {
    /// The least error; of errors within a thousandth of it the smallest model.
    ///
    /// # Errors
    /// Every candidate diverges.
    pub(crate) fn new(rule: RolloutRule, candidates: Vec<RolloutCandidate>) -> Result<Self, Error> {
        let least = candidates.iter().map(RolloutCandidate::error).filter(|error| error.is_finite());
        let Some(least) = least.min_by(f64::total_cmp) else {
            return Err(Error::undetermined(format!(
                "{given_select}: all {} candidates diverge within {} steps on rows that did not train; give a shorter {HORIZON}, or other candidates",
                candidates.len(),
                rule.horizon,
                given_select = SELECT.to("rollout")
            )));
        };
        let equal = |&at: &usize| candidates[at].error() <= least * (1.0 + SAME);
        let key = |&at: &usize| (candidates[at].size, candidates[at].over.unwrap_or(0));
        let chosen = (0..candidates.len()).filter(equal).min_by_key(key).unwrap_or(0);
        Ok(Self { rule, candidates, chosen })
    }

    /// The rule of the choice, in words.
    pub fn in_words(&self) -> String {
        let RolloutRule { horizon, folds, starts } = self.rule;
        format!(
            "least error of rollouts of {horizon} steps on spans that did not train ({folds} folds, up to {starts} rollouts each), as a share of persistence's; \
             of errors within 0.1 % the smallest model"
        )
    }
}

impl Serialize for RolloutChoice {
    /// Writes the rule, the candidates and the chosen index.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Choice<'a> {
            horizon: usize,
            folds: usize,
            starts: usize,
            chosen: usize,
            candidates: Vec<Compared<'a>>,
        }
        #[derive(Serialize)]
        struct Compared<'a> {
            #[serde(flatten)]
            candidate: &'a RolloutCandidate,
            error_over_persistence: f64,
        }
        let compared = |candidate| Compared { candidate, error_over_persistence: RolloutCandidate::error(candidate) };
        Choice {
            horizon: self.rule.horizon,
            folds: self.rule.folds,
            starts: self.rule.starts,
            chosen: self.chosen,
            candidates: self.candidates.iter().map(compared).collect(),
        }
        .serialize(serializer)
    }
}

/// The rows cut into spans that train and spans that are simulated.
pub(crate) struct HeldOut<'a> {
    cut: Spans<'a>,
    fold_of: Vec<usize>,
    rule: RolloutRule,
    /// The option that asks for it.
    option: String,
    /// Remedy for rollouts that are too long.
    mend: String,
}

/// Rollouts of a model over spans that did not train it.
pub(crate) struct HeldOutRollouts {
    /// Squared error over that of persistence, its root, the mean over the states; a rollout that ended early with its last good state.
    pub(crate) share: f64,
    /// Rollouts that ended early.
    pub(crate) ended: usize,
    /// Rollouts.
    pub(crate) starts: usize,
}

impl<'a> HeldOut<'a> {
    /// Cuts a source, smoothed over `smoothed` rows before, by the one fold rule.
    pub(crate) fn new(
        (source, smoothed): (&'a dyn Source, usize),
        rule: RolloutRule,
        option: impl Into<String>,
    ) -> Result<Self, Error> {
        let (cut, fold_of) = Spans::folds(source, rule.folds, smoothed)?;
        Ok(Self { cut, fold_of, rule, option: option.into(), mend: format!("give a shorter {HORIZON} (fewer steps)") })
    }

    /// With another setting that makes rollouts shorter than the horizon.
    pub(crate) fn mended(self, mend: impl Into<String>) -> Self {
        Self { mend: mend.into(), ..self }
    }

    pub(crate) fn rule(&self) -> RolloutRule {
        self.rule
    }

    /// Rows of the longest span of every fold, the least of them.
    pub(crate) fn room(&self) -> usize {
        let spans = || self.cut.episodes().iter().zip(&self.fold_of);
        let longest =
            |fold: usize| spans().filter(|(_, fold_of_span)| **fold_of_span == fold).map(|(span, _)| span.rows).max();
        (0..self.rule.folds).filter_map(longest).min().unwrap_or(0)
    }

    /// Rollouts of so many steps from now on.
    pub(crate) fn reach(&mut self, steps: usize) {
        self.rule.horizon = steps;
    }

    /// A horizon of so many steps, shortened to half of the room in every fold; that of the rule at least.
    pub(crate) fn far(&self, steps: usize) -> usize {
        steps.min(self.room() / 2).max(self.rule.horizon)
    }

    /// The spans that train in a fold, or those that are held out. Differences and lags do not reach over their borders.
    fn part(&self, fold: usize, held: bool) -> Result<Spans<'_>, Error> {
        let rows = |span: usize| (span, 0..self.cut.episodes()[span].rows);
        let members = (0..self.fold_of.len()).filter(|&span| (self.fold_of[span] == fold) == held);
        Ok(Spans::new(&self.cut, members.map(rows).collect(), 1)?)
    }

    /// Fits on the training spans of every fold by `fit` and simulates the held-out ones: errors by model, then by fold.
    pub(crate) fn errors(
        &self,
        progress: &dyn Progress,
        mut fit: impl FnMut(&dyn Source) -> Result<Vec<Model>, Error>,
    ) -> Result<Vec<Vec<f64>>, Error> {
        let mut errors: Vec<Vec<f64>> = Vec::new();
        self.each(|train, held| {
            let models = fit(train)?;
            progress.stage("rollouts");
            errors.resize(models.len().max(errors.len()), Vec::new());
            for (model, errors) in models.iter().zip(&mut errors) {
                errors.push(self.error(model, held)?);
            }
            Ok(())
        })?;
        Ok(errors)
    }

    /// Hands on the rows that train and those that are held out, fold by fold.
    pub(crate) fn each(
        &self,
        mut fold: impl FnMut(&dyn Source, &dyn Source) -> Result<(), Error>,
    ) -> Result<(), Error> {
        (0..self.rule.folds).try_for_each(|at| fold(&self.part(at, false)?, &self.part(at, true)?))
    }

    /// Error of a model's rollouts over that of persistence; infinite where one ended early.
    fn error(&self, model: &Model, held: &dyn Source) -> Result<f64, Error> {
        let options = RolloutOptions::new(self.rule.horizon);
        let outcome = self.simulated(model, held, &Starts::Even(self.rule.starts), &options)?;
        Ok(if outcome.ended > 0 { f64::INFINITY } else { outcome.share })
    }

    /// Rolls a model out over spans that did not train it.
    pub(crate) fn simulated(
        &self,
        model: &Model,
        held: &dyn Source,
        starts: &Starts,
        options: &RolloutOptions,
    ) -> Result<HeldOutRollouts, Error> {
        let outcome = match rollout(model, held, starts, options, &Silent) {
            Ok(rollout) => rollout,
            Err(error @ DynamicsError::TooShort { .. }) => {
                return Err(Error::undetermined(format!(
                    "{}: {error}; the held-out spans of {} folds are shorter than the rollouts: {}, or give longer logs",
                    self.option, self.rule.folds, self.mend
                )));
            }
            Err(error) => return Err(error.into()),
        };
        let ended = outcome.diverged() + outcome.without_region();
        Ok(HeldOutRollouts { share: over_persistence(&outcome.horizon), ended, starts: outcome.outcomes.len() })
    }
}

/// Squared error of rollouts over that of persistence, its root, the mean over the states that move.
fn over_persistence(horizon: &Horizon) -> f64 {
    let persistence = horizon.baselines.iter().find(|(baseline, _)| *baseline == Baseline::Persistence);
    let Some((_, persistence)) = persistence else { return f64::INFINITY };
    let states = horizon.states.len();
    let squares = |rmse: &[f64], state: usize| -> f64 {
        rmse.iter().skip(state).step_by(states).filter(|value| value.is_finite()).map(|value| value * value).sum()
    };
    let moving = (0..states).filter(|&state| squares(&persistence.rmse, state) > 0.0);
    let shares: Vec<f64> =
        moving.map(|state| (squares(&horizon.model.rmse, state) / squares(&persistence.rmse, state)).sqrt()).collect();
    shares.iter().sum::<f64>() / shares.len() as f64
}

/// Coefficients of a model that are not zero.
pub(crate) fn terms(model: &Model) -> usize {
    model.latents.iter().map(|latent| latent.map.parameters()).sum()
}

/// States whose span is open: `derivative = { over = "auto" }`.
pub(crate) fn open_spans(recipe: &Recipe) -> Vec<String> {
    let open = recipe.states.iter().filter(|(_, state)| state.derivative.as_ref().is_some_and(Derivative::is_open));
    open.map(|(name, _)| name.clone()).collect()
}

/// The recipe with its open spans settled; `None`: central differences.
pub(crate) fn settled(recipe: &Recipe, over: Option<u32>) -> Recipe {
    let mut recipe = recipe.clone();
    let open = recipe.states.values_mut().filter(|state| state.derivative.as_ref().is_some_and(Derivative::is_open));
    open.for_each(|state| {
        state.derivative = Some(over.map_or_else(|| Derivative::Text("central".into()), Derivative::over))
    });
    recipe
}

/// Spans to compare: one that is open is a central difference, or a mean slope.
pub(crate) fn candidates(recipe: &Recipe) -> Vec<Option<u32>> {
    if open_spans(recipe).is_empty() {
        return vec![None];
    }
    std::iter::once(None).chain(SPANS.map(Some)).collect()
}

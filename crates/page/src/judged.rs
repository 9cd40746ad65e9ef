//! A model with its scores and simulations on the logs.

use fleetfoot_data::Progress;
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_dynamics::{Error as DynamicsError, Estimate, Horizon, RolloutOptions, Starts};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_recipe::{Cause, Recipe, RequestError};
use fleetfoot_run::{RolledOut, Scored, opened_to_roll, roll_rows, score_rows};

use crate::{
    ReportOptions,
    rolled_on::{RolledOn, Wanted},
    starts::{Place, common, places},
};

/// Steps of a simulation where none are given, and the share of the longest episode that they are at most.
const HORIZON: usize = 200;
const SHARE: usize = 4;

/// A model, its scores and its simulations; or why there are none.
pub(crate) struct Judged<'a> {
    pub(crate) name: &'a str,
    pub(crate) model: &'a Model,
    /// `None` without logs.
    pub(crate) scores: Option<Result<Scored, String>>,
    /// `None` without logs.
    pub(crate) rollouts: Option<Result<RolledOut, String>>,
    /// Starts of its simulations.
    pub(crate) starts: Vec<Place>,
    /// A stretch of a recording with the simulations on it; `None` where nothing could be simulated.
    pub(crate) on_stretch: Option<RolledOn>,
}

impl<'a> Judged<'a> {
    pub(crate) fn new(
        name: &'a str,
        model: &'a Model,
        changes: &Recipe,
        logs: Option<(&Logs, &Dataset)>,
        wanted: &Wanted<'_>,
        options: &ReportOptions,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let Some((logs, dataset)) = logs else {
            return Ok(Self { name, model, scores: None, rollouts: None, starts: Vec::new(), on_stretch: None });
        };
        let scores = error_as_text(score_rows(model, dataset, progress))?;
        let longest = dataset.episodes().iter().map(|episode| episode.rows).max().unwrap_or(0);
        let horizon = options.horizon.unwrap_or_else(|| HORIZON.min(longest / SHARE).max(1));
        let mut long = RolloutOptions::new(horizon);
        options.paths.apply(model, &mut long)?;
        let closed_by = options.controller.as_ref();
        // A controller may read columns that the model does not.
        let opened = closed_by.map(|_| opened_to_roll(model, changes, logs, closed_by, progress)).transpose()?;
        let (simulated, rows) = opened.as_ref().map_or((model, dataset), |(model, rows)| (model, rows));
        let roll = |starts: &Starts, long: &RolloutOptions| {
            error_as_text(roll_rows(simulated, rows, starts, long, closed_by, progress))
        };
        let common = match wanted.several {
            true => common(rows, horizon, options.starts, wanted.reach, wanted.starts)?,
            false => None,
        };
        let of_all = common.map(|starts| roll(&starts, &long)).transpose()?.filter(Result::is_ok);
        let rollouts = of_all.map_or_else(|| roll(&Starts::Even(options.starts), &long), Ok)?;
        let on_stretch = match &rollouts {
            Ok(rolled) => RolledOn::of(simulated, rows, rolled, wanted, &long, roll)?,
            Err(_) => None,
        };
        let starts = rollouts.as_ref().map_or_else(|_| Vec::new(), |rolled| places(rows, rolled));
        Ok(Self { name, model, scores: Some(scores), rollouts: Some(rollouts), starts, on_stretch })
    }

    pub(crate) fn scored(&self) -> Option<&Scored> {
        self.scores.as_ref()?.as_ref().ok()
    }

    pub(crate) fn rolled(&self) -> Option<&RolledOut> {
        self.rollouts.as_ref()?.as_ref().ok()
    }

    pub(crate) fn horizon(&self) -> Option<&Horizon> {
        self.rolled().map(|rolled| &rolled.rollouts.horizon)
    }

    /// The mean over these targets of the error over the null model's, where it is a number.
    pub(crate) fn mean_over_null(&self, of: &[&str]) -> Option<f64> {
        let targets = self.scored()?.scores.targets.iter().filter(|target| of.contains(&target.name.as_str()));
        let mean = targets.map(|target| target.mae_over_null.value).sum::<f64>() / of.len() as f64;
        mean.is_finite().then_some(mean)
    }
}

/// Separates failures to score or simulate, which the page reports, from failures to read, which are errors.
fn error_as_text<T>(result: Result<T, Error>) -> Result<Result<T, String>, Error> {
    match result {
        Ok(scored) => Ok(Ok(scored)),
        Err(error @ Error::Request(RequestError { cause: Cause::TooFewRows { .. }, .. })) => Ok(Err(error.to_string())),
        Err(error @ Error::Dynamics(DynamicsError::Data(_) | DynamicsError::NoHorizon)) => Err(error),
        Err(error @ Error::Dynamics(_)) => Ok(Err(error.to_string())),
        Err(error) => Err(error),
    }
}

/// An estimate for a figure.
pub(crate) fn interval(estimate: &Estimate) -> fleetfoot_report::Interval {
    fleetfoot_report::Interval { value: estimate.value, low: estimate.low, high: estimate.high }
}

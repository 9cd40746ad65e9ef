//! Errors of the baselines of a fit: the mean of each target, and persistence (the previous row).

use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{Baseline, Error as DynamicsError, ScoreOptions, TargetScore, score};
use fleetfoot_model::Model;
use serde::Serialize;

use crate::{error::Error, spans::Spans};

/// Rows that are looked at, about: blocks over all episodes where there are more.
const ROWS: usize = 100_000;
/// Rows of a block.
const BLOCK: usize = 4_096;

/// One-step errors of the mean of a target and of persistence (the previous row). Neither is fitted, so both are free of in-sample bias.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TargetBaselines {
    /// The left side of the equation.
    pub target: String,
    /// Root mean squared error of the mean.
    pub mean_rmse: f64,
    /// Root mean squared error of persistence; NaN where no row has one before it.
    pub persistence_rmse: f64,
    /// Mean absolute error of persistence over that of the mean.
    pub persistence_over_mean: f64,
}

impl TargetBaselines {
    fn new(target: &TargetScore) -> Self {
        let of = |wanted: Baseline| target.baselines.iter().find(|one| one.baseline == wanted && one.rows > 0);
        let rmse = |wanted: Baseline| of(wanted).map_or(f64::NAN, |one| one.rmse);
        let mae = |wanted: Baseline| of(wanted).map_or(f64::NAN, |one| one.mae);
        Self {
            target: target.name.clone(),
            mean_rmse: rmse(Baseline::Null),
            persistence_rmse: rmse(Baseline::Persistence),
            persistence_over_mean: mae(Baseline::Persistence) / mae(Baseline::Null),
        }
    }

    /// Squared error of persistence over that of the mean.
    pub fn loss(&self) -> f64 {
        (self.persistence_rmse / self.mean_rmse).powi(2)
    }
}

/// The baselines of the fitted equations of a model; none where rows do not have the targets that it predicts.
pub(crate) fn baselines(
    model: &Model,
    rows: &dyn Source,
    progress: &dyn Progress,
) -> Result<Vec<TargetBaselines>, Error> {
    let every = rows.rows().div_ceil(ROWS).max(1);
    let blocks = rows.episodes().iter().enumerate().flat_map(|(at, episode)| {
        let starts = (0..episode.rows).step_by(BLOCK).step_by(every);
        starts.map(move |first| (at, first..(first + BLOCK).min(episode.rows)))
    });
    let sample = Spans::new(rows, blocks.collect(), 1)?;
    let seen: &dyn Source = if every == 1 { rows } else { &sample };
    match score(model, seen, &ScoreOptions::default(), progress) {
        Ok(scores) => Ok(scores.targets.iter().map(TargetBaselines::new).collect()),
        Err(error @ DynamicsError::Data(_)) => Err(error.into()),
        // Models that cannot be scored row by row have no baseline.
        Err(_) => Ok(Vec::new()),
    }
}

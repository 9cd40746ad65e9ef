//! Scores of one-step predictions.

use fleetfoot_dataset::json::report;
use fleetfoot_dynamics::{BaselineScore, CalibrationBin, EpisodeScore, TargetScore};
use fleetfoot_fit::{FileRuns, Interval, interval_in_words};
use serde::Serialize;
use serde_json::Value;

use crate::Scored;

impl Scored {
    /// The scores for programs.
    pub fn to_json(&self) -> Value {
        let scores = &self.scores;
        report(Content {
            rows: scores.rows,
            episodes: self.episodes,
            in_sample_episodes: &self.in_sample,
            intervals: interval_in_words(&scores.basis),
            skipped: Skipped {
                border: scores.skipped.border,
                missing: scores.skipped.missing,
                no_region: scores.skipped.no_region,
                non_finite: scores.skipped.non_finite,
            },
            rows_outside_region: scores.outside_region,
            rows_outside_training: scores.outside_training,
            mahalanobis: (&scores.mahalanobis).into(),
            mahalanobis_measured: scores.mahalanobis_measured,
            targets: scores.targets.iter().map(Target::from).collect(),
            calibration: scores.calibration.iter().map(Bin::from).collect(),
            by_episode: scores.episodes.iter().map(Episode::from).collect(),
            free_runs: (!self.free_runs.is_empty()).then_some(&self.free_runs),
            notes: &self.notes,
        })
    }
}

#[derive(Serialize)]
struct Content<'a> {
    rows: u64,
    episodes: usize,
    in_sample_episodes: &'a [String],
    intervals: String,
    skipped: Skipped,
    rows_outside_region: u64,
    rows_outside_training: u64,
    mahalanobis: Interval,
    mahalanobis_measured: f64,
    targets: Vec<Target<'a>>,
    calibration: Vec<Bin>,
    by_episode: Vec<Episode<'a>>,
    free_runs: Option<&'a FileRuns>,
    notes: &'a [String],
}

#[derive(Serialize)]
struct Skipped {
    border: u64,
    missing: u64,
    no_region: u64,
    non_finite: u64,
}

#[derive(Serialize)]
struct Target<'a> {
    name: &'a str,
    unit: Option<&'a str>,
    mae: Interval,
    mae_over_null: Interval,
    mae_over_sigma: f64,
    rmse: f64,
    r2: f64,
    explained_variance: f64,
    bias: f64,
    max: f64,
    sigma: f64,
    baselines: Vec<Beside>,
    #[serde(skip_serializing_if = "Option::is_none")]
    raw: Option<Raw>,
}

/// Errors against raw measurements.
#[derive(Serialize)]
struct Raw {
    rows: u64,
    mae: f64,
    rmse: f64,
}

impl<'a> From<&'a TargetScore> for Target<'a> {
    fn from(target: &'a TargetScore) -> Self {
        Self {
            name: &target.name,
            unit: target.unit.as_deref(),
            mae: (&target.mae).into(),
            mae_over_null: (&target.mae_over_null).into(),
            mae_over_sigma: target.mae_over_sigma,
            rmse: target.rmse,
            r2: target.r2,
            explained_variance: target.explained_variance,
            bias: target.bias,
            max: target.max,
            sigma: target.deviation,
            baselines: target.baselines.iter().map(Beside::from).collect(),
            raw: target.raw.map(|raw| Raw { rows: raw.rows, mae: raw.mae, rmse: raw.rmse }),
        }
    }
}

/// A baseline, and the model on the rows that the baseline has.
#[derive(Serialize)]
struct Beside {
    name: &'static str,
    rows: u64,
    mae: f64,
    rmse: f64,
    model_mae: f64,
    model_rmse: f64,
}

impl From<&BaselineScore> for Beside {
    fn from(baseline_score: &BaselineScore) -> Self {
        Self {
            name: baseline_score.baseline.name(),
            rows: baseline_score.rows,
            mae: baseline_score.mae,
            rmse: baseline_score.rmse,
            model_mae: baseline_score.model_mae,
            model_rmse: baseline_score.model_rmse,
        }
    }
}

/// Error against distance from the training rows.
#[derive(Serialize)]
struct Bin {
    rows: u64,
    input: f64,
    output: f64,
}

impl From<&CalibrationBin> for Bin {
    fn from(bin: &CalibrationBin) -> Self {
        Self { rows: bin.rows, input: bin.input, output: bin.output }
    }
}

#[derive(Serialize)]
struct Episode<'a> {
    name: &'a str,
    id: String,
    rows: u64,
    in_training: bool,
    mae_over_null: &'a [f64],
    rmse: &'a [f64],
    mahalanobis: f64,
}

impl<'a> From<&'a EpisodeScore> for Episode<'a> {
    fn from(episode_score: &'a EpisodeScore) -> Self {
        Self {
            name: &episode_score.name,
            id: episode_score.id.to_string(),
            rows: episode_score.rows,
            in_training: episode_score.in_training,
            mae_over_null: &episode_score.mae_over_null,
            rmse: &episode_score.rmse,
            mahalanobis: episode_score.mahalanobis,
        }
    }
}

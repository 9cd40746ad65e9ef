//! Scores of one-step predictions.

use serde_json::{Value, json};

use super::{FORMAT, estimate, interval_in_words, real};
use crate::Scored;

impl Scored {
    /// The scores for programs.
    pub fn to_json(&self) -> Value {
        let scores = &self.scores;
        json!({
            "format": FORMAT, "rows": scores.rows, "episodes": self.episodes, "in_sample_episodes": self.in_sample, "intervals": interval_in_words(&scores.basis),
            "skipped": { "border": scores.skipped.border, "missing": scores.skipped.missing,
                         "no_region": scores.skipped.no_region, "non_finite": scores.skipped.non_finite },
            "rows_outside_region": scores.outside_region, "rows_outside_training": scores.outside_training,
            "mahalanobis": estimate(&scores.mahalanobis), "mahalanobis_measured": real(scores.mahalanobis_measured),
            "targets": scores.targets.iter().map(|target| json!({
                "name": target.name, "unit": target.unit, "mae": estimate(&target.mae), "mae_over_null": estimate(&target.mae_over_null),
                "mae_over_sigma": real(target.mae_over_sigma), "rmse": real(target.rmse), "r2": real(target.r2), "bias": real(target.bias),
                "max": real(target.max), "sigma": real(target.deviation),
                "baselines": target.baselines.iter().map(|b| json!({
                    "name": b.baseline.name(), "rows": b.rows, "mae": real(b.mae), "rmse": real(b.rmse),
                    "model_mae": real(b.model_mae), "model_rmse": real(b.model_rmse) })).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
            "calibration": scores.calibration.iter().map(|bin| json!({
                "rows": bin.rows, "input": real(bin.input), "output": real(bin.output) })).collect::<Vec<_>>(),
            "by_episode": scores.episodes.iter().map(|episode| json!({
                "name": episode.name, "id": episode.id.to_string(), "rows": episode.rows, "in_training": episode.in_training,
                "mae_over_null": episode.mae_over_null.iter().map(|&v| real(v)).collect::<Vec<_>>(),
                "rmse": episode.rmse.iter().map(|&v| real(v)).collect::<Vec<_>>(), "mahalanobis": real(episode.mahalanobis),
            })).collect::<Vec<_>>(),
            "free_runs": (!self.free_runs.is_empty()).then(|| self.free_runs.to_json()),
            "notes": self.notes,
        })
    }
}

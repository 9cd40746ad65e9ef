//! The report of a structured sparse fit.

use serde_json::{Value, json};

use super::{FORMAT, real, reals};
use crate::{LeaveOneOutReport, SparseReport};

impl SparseReport {
    /// Tasks, latents, lambda and certificates for programs.
    pub fn to_json(&self) -> Value {
        let validation = self.lambda.validation.as_ref().map(|validation| {
            json!({
                "folds": self.lambda.folds, "fold_rule": self.lambda.fold_rule, "lambdas": reals(&validation.lambdas), "error": reals(&validation.mean),
                "standard_error": reals(&validation.standard_error), "features": reals(&validation.features),
            })
        });
        json!({
            "format": FORMAT, "rows": real(self.rows), "episodes": self.episodes,
            "rows_at_border": self.left_out[0], "rows_incomplete": self.left_out[1],
            "lambda": { "value": real(self.lambda.value), "how": self.lambda.how, "largest": real(self.lambda.largest), "validation": validation },
            "path": self.path.as_ref().map(|path| json!({
                "lambdas": reals(&path.lambdas), "entered": path.entered,
                "functions": path.functions.iter().map(|(name, along)| json!({ "function": name, "coefficients": reals(along) })).collect::<Vec<_>>(),
            })),
            "selection": self.selection,
            "certificate": { "kkt": real(self.certificate.kkt), "gap": real(self.certificate.gap), "objective": real(self.certificate.objective) },
            "worst_replicate_kkt": self.worst_replicate.map(real),
            "condition": real(self.condition), "confounded": self.confounded,
            "tasks": self.tasks.iter().map(|task| json!({
                "name": task.name, "prior": task.prior, "scale": real(task.scale), "weight": real(task.weight),
                "rms": real(task.rms), "r2": real(task.r2), "held_out_rms": real(task.held_out),
            })).collect::<Vec<_>>(),
            "latents": self.latents.iter().map(|latent| json!({
                "name": latent.name,
                "functions": latent.candidates.iter().map(|candidate| json!({
                    "function": candidate.function, "selected": candidate.selected, "coefficient": real(candidate.coefficient),
                    "lasso": real(candidate.lasso), "standard_error": real(candidate.standard_error),
                    "frequency": candidate.frequency.map(real),
                    "lasso_interval": candidate.interval.map(|interval| interval.map(real)),
                })).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
            "influence": self.influence.as_ref().map(influence_json),
            "notes": self.notes,
        })
    }
}

fn influence_json(influence: &LeaveOneOutReport) -> Value {
    let episodes = influence.episodes.iter().map(|episode| {
        let change = episode.largest_change.as_ref();
        json!({
            "name": episode.name, "share": real(episode.share), "cooks_distance": real(episode.distance),
            "held_out_rms": real(episode.held_out), "in_sample_rms": real(episode.in_sample),
            "largest_change": change.map(|(name, change)| json!({ "coefficient": name, "standard_errors": real(*change) })),
        })
    });
    json!({
        "held_out_rms": real(influence.held_out), "in_sample_rms": real(influence.in_sample),
        "episodes": episodes.collect::<Vec<_>>(),
    })
}

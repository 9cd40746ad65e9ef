//! The report of a piecewise-affine fit.

use serde_json::{Value, json};

use fleetfoot_pwa::Score;

use super::{FORMAT, estimate, interval_in_words, real, reals};
use crate::{Fitted, RolloutChoice};

impl RolloutChoice {
    /// What was compared, and what was taken, for programs.
    pub fn to_json(&self) -> Value {
        json!({
            "horizon": self.rule.horizon, "folds": self.rule.folds, "starts": self.rule.starts, "chosen": self.chosen,
            "candidates": self.candidates.iter().map(|candidate| json!({
                "partition": candidate.partition, "over": candidate.over, "terms": candidate.size,
                "error_over_persistence": real(candidate.error()), "folds": reals(&candidate.folds),
            })).collect::<Vec<_>>(),
        })
    }
}

impl Fitted {
    /// Scores and candidates for programs.
    pub fn to_json(&self) -> Value {
        let found = &self.identification;
        let mut report = json!({
            "format": FORMAT, "hash": found.model.hash(),
            "rows": found.rows, "episodes": self.episodes, "files": self.files,
            "effective_rows": real(found.effective_rows),
            "rows_at_border": found.at_border, "rows_incomplete": found.incomplete,
            "targets": found.targets, "sigma": reals(&found.sigma),
            "held_out": found.held_out, "fold_rule": found.fold_rule, "condition": real(found.condition), "preconditioned_condition": real(found.preconditioned),
            "chosen": found.chosen, "chosen_by": found.rule, "intervals": interval_in_words(&found.basis),
            "candidates": found.candidates.iter().map(candidate).collect::<Vec<_>>(),
            "rollouts": self.rollouts.as_ref().map(RolloutChoice::to_json),
            "notes": self.notes,
        });
        if let Some(refinement) = &self.refinement {
            report["objective"] = refinement.to_json();
        }
        report
    }
}

fn candidate(score: &Score) -> Value {
    let mut told = json!({
                "partition": score.specification.to_string(), "regions": score.regions, "shrinkage": real(score.shrinkage),
                "mae_over_null": reals(&score.over_null),
                "mae_over_null_intervals": score.over_null_interval.iter().map(estimate).collect::<Vec<_>>(),
                "mae_over_sigma": reals(&score.over_sigma), "r2": reals(&score.r2),
                "mahalanobis": real(score.mahalanobis), "loss": real(score.loss), "standard_error": real(score.standard_error),
                "fold_losses": reals(&score.losses), "bic": real(score.bic),
    });
    if let (false, Some(told)) = (score.objective.is_empty(), told.as_object_mut()) {
        told.insert("objective_by_pass".into(), reals(&score.objective).into());
    }
    told
}

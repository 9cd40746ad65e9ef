//! Scores of rollouts by horizon.

use fleetfoot_dynamics::{Estimate, HorizonScore, RolloutSummary, StepSpan};
use serde_json::{Value, json};

use super::{FORMAT, estimate, interval_in_words, real};
use crate::RolledOut;

impl RolledOut {
    /// The scores for programs; trajectories are not among them.
    pub fn to_json(&self) -> Value {
        let rollouts = &self.rollouts;
        let horizon = &rollouts.horizon;
        let score = |score: &HorizonScore| {
            let table = |values: &[f64]| {
                values
                    .chunks(horizon.states.len().max(1))
                    .map(|row| row.iter().map(|&v| real(v)).collect::<Vec<_>>())
                    .collect::<Vec<_>>()
            };
            json!({
                "rmse": table(&score.rmse), "mae": table(&score.mae),
                "mahalanobis": triples(&score.mahalanobis), "summary": summary(&score.summary),
                "displacement": triples(&score.displacement), "displacement_summary": score.displacement_summary.as_ref().map(summary),
            })
        };
        json!({
            "format": FORMAT, "rollouts": rollouts.outcomes.len(), "missing": rollouts.missing, "diverged": rollouts.diverged(),
            "without_region": rollouts.without_region(), "left_domain": rollouts.left_domain(), "ended_outside": rollouts.ended_outside(),
            "episodes": self.episodes, "in_sample_episodes": self.in_sample,
            "states": horizon.states, "replayed": rollouts.replayed,
            "driven_inputs": rollouts.driven_inputs,
            "time": horizon.time, "model": score(&horizon.model),
            "baselines": horizon.baselines.iter()
                .map(|(baseline, s)| (baseline.name().to_owned(), score(s))).collect::<serde_json::Map<_, _>>(),
            "ended": horizon.ended, "intervals": interval_in_words(&horizon.basis),
            "useful_horizon": {
                "steps": horizon.useful.steps, "seconds": real(horizon.useful.seconds),
                "beaten_by": horizon.useful.beaten_by.map(|b| b.name()), "compared_steps": horizon.useful.compared,
                "better_than_all": spans(&horizon.useful.spans),
                "better_than": horizon.better.iter()
                    .map(|(baseline, own)| (baseline.name().to_owned(), spans(own))).collect::<serde_json::Map<_, _>>(),
            },
            "notes": self.notes,
        })
    }
}

/// Values with the ends of their intervals.
fn triples(estimates: &[Estimate]) -> Value {
    estimates.iter().map(|e| json!([real(e.value), real(e.low), real(e.high)])).collect()
}

fn summary(summary: &RolloutSummary) -> Value {
    json!({
        "average": estimate(&summary.average), "last": estimate(&summary.last), "drift_per_second": estimate(&summary.drift),
    })
}

/// Steps at which something holds.
fn spans(spans: &[StepSpan]) -> Value {
    let span = |span: &StepSpan| json!({ "first_step": span.first, "last_step": span.last, "from": real(span.from), "to": real(span.to) });
    spans.iter().map(span).collect()
}

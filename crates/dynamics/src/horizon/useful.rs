//! Steps up to which a model is better than the baselines.

use super::{HorizonScore, StepSpan, UsefulHorizon};
use crate::Baseline;

/// Returns true if the model is better at a step; `None` without a measurement or a baseline. A score that is not a
/// number beats nothing.
pub(super) fn beats(model: &HorizonScore, k: usize, other: Option<(Baseline, f64)>) -> Option<bool> {
    let (_, other) = other.filter(|(_, value)| value.is_finite())?;
    Some(model.mahalanobis[k].value.partial_cmp(&other) == Some(std::cmp::Ordering::Less))
}

/// The best baseline of a step.
pub(super) fn best(baselines: &[(Baseline, HorizonScore)], k: usize) -> Option<(Baseline, f64)> {
    let scores = baselines.iter().map(|(baseline, score)| (*baseline, score.mahalanobis[k].value));
    scores.filter(|(_, value)| value.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The steps at which a condition holds, in spans; steps without an answer belong to the span around them.
pub(super) fn spans(time: &[f64], holds: impl Fn(usize) -> Option<bool>) -> Vec<StepSpan> {
    let mut spans: Vec<StepSpan> = Vec::new();
    let mut open = false;
    for (k, &seconds) in time.iter().enumerate() {
        match (holds(k), spans.last_mut()) {
            (Some(true), Some(last)) if open => (last.last, last.to) = (k + 1, seconds),
            (Some(true), _) => {
                spans.push(StepSpan { first: k + 1, last: k + 1, from: seconds, to: seconds });
                open = true;
            }
            (Some(false), _) => open = false,
            (None, _) => {}
        }
    }
    spans
}

pub(super) fn useful_horizon(
    time: &[f64],
    model: &HorizonScore,
    baselines: &[(Baseline, HorizonScore)],
) -> UsefulHorizon {
    let better = |k: usize| beats(model, k, best(baselines, k));
    let compared: Vec<usize> = (0..time.len()).filter(|&k| better(k).is_some()).collect();
    let lost = compared.iter().position(|&k| better(k) == Some(false));
    // Up to the last step that was compared and won.
    let steps = match lost {
        Some(0) => 0,
        Some(at) => compared[at - 1] + 1,
        None => compared.last().map_or(0, |k| k + 1),
    };
    UsefulHorizon {
        steps,
        seconds: steps.checked_sub(1).map_or(0.0, |k| time[k]),
        beaten_by: lost.and_then(|at| best(baselines, compared[at])).map(|(baseline, _)| baseline),
        spans: spans(time, better),
        compared: compared.len(),
    }
}

//! Scores of rollouts by horizon.

use std::collections::BTreeMap;

use fleetfoot_dataset::json::report;
use fleetfoot_dynamics::{
    Estimate, Horizon, HorizonScore, PathScores, RawHorizon, ReferencePair, RolloutSummary, StepSpan,
};
use fleetfoot_fit::{Interval, interval_in_words};
use serde::Serialize;
use serde_json::Value;

use super::by_baseline;
use crate::RolledOut;

impl RolledOut {
    /// The scores for programs; trajectories are not among them.
    pub fn to_json(&self) -> Value {
        let rollouts = &self.rollouts;
        let horizon = &rollouts.horizon;
        let states = horizon.states.len();
        report(Content {
            rollouts: rollouts.outcomes.len(),
            missing: rollouts.missing,
            diverged: rollouts.diverged(),
            without_region: rollouts.without_region(),
            left_domain: rollouts.left_domain(),
            ended_outside: rollouts.ended_outside(),
            episodes: self.episodes,
            in_sample_episodes: &self.in_sample,
            states: &horizon.states,
            replayed: &rollouts.replayed,
            driven_inputs: &rollouts.driven_inputs,
            time: &horizon.time,
            model: Curves::new(&horizon.model, states),
            raw: horizon.raw.as_ref().map(|raw| Raw::new(raw, states)),
            baselines: by_baseline(&horizon.baselines, |score| Curves::new(score, states)),
            beside_reference: horizon.beside_reference.as_ref().map(Pair::from),
            ended: &horizon.ended,
            intervals: interval_in_words(&horizon.basis),
            useful_horizon: Useful::from(horizon),
            notes: &self.notes,
        })
    }
}

#[derive(Serialize)]
struct Content<'a> {
    rollouts: usize,
    missing: usize,
    diverged: usize,
    without_region: usize,
    left_domain: usize,
    ended_outside: usize,
    episodes: usize,
    in_sample_episodes: &'a [String],
    states: &'a [String],
    replayed: &'a [String],
    driven_inputs: &'a [String],
    time: &'a [f64],
    model: Curves,
    #[serde(skip_serializing_if = "Option::is_none")]
    raw: Option<Raw>,
    baselines: BTreeMap<&'static str, Curves>,
    #[serde(skip_serializing_if = "Option::is_none")]
    beside_reference: Option<Pair>,
    ended: &'a [f64],
    intervals: String,
    useful_horizon: Useful,
    notes: &'a [String],
}

/// Scores by step: errors steps x states, and estimates with the ends of their intervals.
#[derive(Serialize)]
struct Curves {
    rmse: Vec<Vec<f64>>,
    mae: Vec<Vec<f64>>,
    mahalanobis: Vec<[f64; 3]>,
    summary: Summary,
    displacement: Vec<[f64; 3]>,
    displacement_summary: Option<Summary>,
    #[serde(skip_serializing_if = "Option::is_none")]
    path: Option<Path>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    orientation: Vec<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    average_orientation: Option<Interval>,
    explained_variance: Vec<Interval>,
    explained_variance_by_step: Vec<Vec<f64>>,
}

/// Direction, growth of the distance and time warping of paths.
#[derive(Serialize)]
struct Path {
    alignment: Vec<[f64; 3]>,
    average_alignment: Interval,
    propagated_error: Interval,
    warping_distance: Interval,
}

impl From<&PathScores> for Path {
    fn from(scores: &PathScores) -> Self {
        Self {
            alignment: triples(&scores.alignment),
            average_alignment: (&scores.average_alignment).into(),
            propagated_error: (&scores.propagated_error).into(),
            warping_distance: (&scores.warping_distance).into(),
        }
    }
}

/// The model beside the reference.
#[derive(Serialize)]
struct Pair {
    displacement_summary: Summary,
    path: Path,
}

impl From<&ReferencePair> for Pair {
    fn from(pair: &ReferencePair) -> Self {
        Self { displacement_summary: (&pair.displacement).into(), path: (&pair.path).into() }
    }
}

/// Estimates with the ends of their intervals.
fn triples(all: &[Estimate]) -> Vec<[f64; 3]> {
    all.iter().map(|estimate| [estimate.value, estimate.low, estimate.high]).collect()
}

/// Errors against raw measurements, steps x states.
#[derive(Serialize)]
struct Raw {
    rmse: Vec<Vec<f64>>,
    mae: Vec<Vec<f64>>,
}

impl Raw {
    fn new(raw: &RawHorizon, states: usize) -> Self {
        Self { rmse: by_step(&raw.rmse, states), mae: by_step(&raw.mae, states) }
    }
}

/// Values steps x states, step by step.
fn by_step(values: &[f64], states: usize) -> Vec<Vec<f64>> {
    values.chunks(states.max(1)).map(<[f64]>::to_vec).collect()
}

impl Curves {
    fn new(score: &HorizonScore, states: usize) -> Self {
        Self {
            rmse: by_step(&score.rmse, states),
            mae: by_step(&score.mae, states),
            mahalanobis: triples(&score.mahalanobis),
            summary: (&score.summary).into(),
            displacement: triples(&score.displacement),
            displacement_summary: score.displacement_summary.as_ref().map(Summary::from),
            path: score.path.as_ref().map(Path::from),
            orientation: triples(&score.orientation),
            average_orientation: score.average_orientation.as_ref().map(Interval::from),
            explained_variance: score.explained_variance.iter().map(Interval::from).collect(),
            explained_variance_by_step: by_step(&score.explained_variance_by_step, states),
        }
    }
}

/// Over whole rollouts.
#[derive(Serialize)]
struct Summary {
    average: Interval,
    last: Interval,
    drift_per_second: Interval,
}

impl From<&RolloutSummary> for Summary {
    fn from(summary: &RolloutSummary) -> Self {
        Self {
            average: (&summary.average).into(),
            last: (&summary.last).into(),
            drift_per_second: (&summary.drift).into(),
        }
    }
}

/// From when to when the model is the best.
#[derive(Serialize)]
struct Useful {
    steps: usize,
    seconds: f64,
    beaten_by: Option<&'static str>,
    compared_steps: usize,
    better_than_all: Vec<Span>,
    better_than: BTreeMap<&'static str, Vec<Span>>,
}

impl From<&Horizon> for Useful {
    fn from(horizon: &Horizon) -> Self {
        let spans = |steps: &[StepSpan]| steps.iter().map(Span::from).collect::<Vec<_>>();
        Self {
            steps: horizon.useful.steps,
            seconds: horizon.useful.seconds,
            beaten_by: horizon.useful.beaten_by.map(|baseline| baseline.name()),
            compared_steps: horizon.useful.compared,
            better_than_all: spans(&horizon.useful.spans),
            better_than: by_baseline(&horizon.better, |steps| spans(steps)),
        }
    }
}

/// Steps at which something holds.
#[derive(Serialize)]
struct Span {
    first_step: usize,
    last_step: usize,
    from: f64,
    to: f64,
}

impl From<&StepSpan> for Span {
    fn from(span: &StepSpan) -> Self {
        Self { first_step: span.first, last_step: span.last, from: span.from, to: span.to }
    }
}

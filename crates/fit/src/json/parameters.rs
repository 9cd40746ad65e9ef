//! The report of estimated parameters.

use fleetfoot_recipe::EstimateMethod;
use serde::{Serialize, Serializer};

use crate::{
    limit_report::LimitReport,
    method::FitReport,
    parameters::{ConfoundedPair, GainInterval, ParameterInterval, ParametersReport},
    summary::FitSummary,
};

impl FitReport for ParametersReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }
}

impl Serialize for ParametersReport {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Content {
            method: self.method,
            rows: self.rows,
            files: self.summary.files,
            parameters: &self.parameters,
            confounded: &self.confounded,
            noise: self
                .noise
                .iter()
                .enumerate()
                .map(|(at, (of, deviation))| Noise {
                    of,
                    deviation: *deviation,
                    free_deviation: self.free_noise.get(at).copied(),
                })
                .collect(),
            limits: &self.limits,
            gains: &self.gains,
            innovations: &self.innovations,
            segments: self.segments.map(|segments| segments[0]),
            missing_segments: self.segments.map(|segments| segments[1]),
            correlated_rows: self.memory,
            condition: self.condition,
            gradient: self.gradient,
            converged: self.converged,
            held_out: self.held_out.as_ref().map(|held| HeldOut {
                horizon: held.horizon,
                over_persistence: held.share(),
                folds: &held.folds,
                ended: held.ended,
                starts: held.starts,
            }),
            equations: &self.equations,
            warnings: self.warnings(),
            summary: &self.summary,
        }
        .serialize(serializer)
    }
}

#[derive(Serialize)]
struct Content<'a> {
    method: EstimateMethod,
    rows: u64,
    files: usize,
    parameters: &'a [ParameterInterval],
    confounded: &'a [ConfoundedPair],
    noise: Vec<Noise<'a>>,
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    limits: &'a [LimitReport],
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    gains: &'a [GainInterval],
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    innovations: &'a [Vec<f64>],
    segments: Option<usize>,
    missing_segments: Option<usize>,
    correlated_rows: Option<usize>,
    condition: f64,
    gradient: f64,
    converged: bool,
    held_out: Option<HeldOut<'a>>,
    equations: &'a [String],
    warnings: Vec<String>,
    #[serde(flatten)]
    summary: &'a FitSummary,
}

#[derive(Serialize)]
struct Noise<'a> {
    of: &'a str,
    deviation: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    free_deviation: Option<f64>,
}

#[derive(Serialize)]
struct HeldOut<'a> {
    horizon: usize,
    over_persistence: f64,
    folds: &'a [f64],
    ended: usize,
    starts: usize,
}

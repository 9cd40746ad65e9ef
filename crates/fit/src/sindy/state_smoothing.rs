//! Report of equations that alternated with smoothed states.

use serde::Serialize;

use super::words::short;

/// Equations found in turn with the states.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct StateSmoothing {
    /// Rows whose states are smoothed.
    pub rows: usize,
    /// Segments between gaps.
    pub segments: usize,
    /// Candidates of all equations together.
    pub candidates: usize,
    /// Errors of measurement and equation, one entry a state.
    pub noise: Vec<StateNoise>,
    /// Twice the objective plus the price of the terms, at the same variances: with the first terms, and with the last.
    pub value: [f64; 2],
    /// Price of a term in it.
    pub price: f64,
    /// Supports that were tried, and taken.
    pub tried: usize,
    /// Those of lower value than the ones before.
    pub taken: usize,
    /// The certificate: reduction of the objective by another step, to first order.
    pub promise: f64,
    /// True if the promise is within a billionth of the objective.
    pub converged: bool,
    /// Folds that are held out in turn.
    pub folds: usize,
    /// Mean squared deviation of smoothed trajectories from the held-out rows, with the equations' own errors, in
    /// variances of the measurements. The first is that of the equations without smoothing, the second of these; both
    /// have the same training rows.
    pub held_out: [f64; 2],
    /// True if these equations are written: they have the lower held-out deviation.
    pub written: bool,
    #[serde(skip)]
    pub(super) windows: Vec<[f64; 2]>,
}

/// Errors of a state.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct StateNoise {
    /// The state.
    pub state: String,
    /// Standard deviation of its measurements.
    pub measurement: f64,
    /// Standard deviation of its equation over a step.
    pub process: f64,
}

impl StateSmoothing {
    /// The smoothing and its effect, in sentences.
    pub fn in_words(&self) -> String {
        let deviation = |state_noise: &StateNoise| format!("{} {}", state_noise.state, short(state_noise.measurement));
        let noise: Vec<String> = self.noise.iter().map(deviation).collect();
        let [before, after] = self.value;
        let [plain, smoothed] = self.held_out;
        let from = if before.is_finite() { format!("from {before:.1} ") } else { String::new() };
        let verdict = match self.written {
            true => "These equations are written: smoothed trajectories follow rows that did not train more closely.",
            false => {
                "The equations without smoothing are written: the smoothed ones do not follow held-out rows more closely."
            }
        };
        format!(
            "states smoothed under the equations: {} rows in {}; noise {}\n\
             terms with the states free: {} of {} supports taken; twice the objective and {:.1} a term, {from}to {after:.1}{}\n\
             held out ({} folds), squared distance of smoothed trajectories from the rows, in variances of the noise, without and with: {plain:.4} and {smoothed:.4}\n{verdict}",
            self.rows,
            if self.segments == 1 { "1 segment".to_owned() } else { format!("{} segments", self.segments) },
            noise.join(", "),
            self.taken,
            self.tried,
            self.price,
            if self.converged { "" } else { "; not at the minimum" },
            self.folds,
        )
    }
}

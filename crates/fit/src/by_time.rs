//! Rows held out by time: the last of the recording, which no span beside them trained.
//!
//! Spans that are held out in turn have neighbours on both sides, and a motion that repeats or drifts is in those too. The end of a recording has none behind it.

use fleetfoot_dynamics::{Baseline, TargetScore};
use serde::Serialize;

/// Errors one step ahead on the last rows, of the chosen model fitted to the rows before them.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ByTime {
    /// Rows that were held out.
    pub rows: u64,
    /// The fitted equations.
    pub targets: Vec<TargetByTime>,
}

/// The errors of one equation.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TargetByTime {
    /// The left side of the equation.
    pub target: String,
    /// Root mean squared error.
    pub rmse: f64,
    /// Squared error over that of the mean of the training rows.
    pub share: f64,
}

impl TargetByTime {
    pub(crate) fn new(target: &TargetScore) -> Self {
        let mean = target
            .baselines
            .iter()
            .find(|baseline| baseline.baseline == Baseline::Null)
            .map_or(f64::NAN, |baseline| baseline.rmse);
        Self { target: target.name.clone(), rmse: target.rmse, share: (target.rmse / mean).powi(2) }
    }
}

impl ByTime {
    /// The errors beside those of spans that were held out in turn, each a share of the squared error of the mean, and the worse of both.
    pub fn in_words(&self, by_spans: impl Fn(&str) -> Option<f64>) -> String {
        let sentence = |by_target: &TargetByTime| match by_spans(&by_target.target).filter(|share| share.is_finite()) {
            Some(spans) => {
                let worse = short(by_target.share.max(spans));
                format!("{} {} (spans {}; the worse {worse})", by_target.target, short(by_target.share), short(spans))
            }
            None => format!("{} {}", by_target.target, short(by_target.share)),
        };
        format!(
            "held out by time, the last {} rows, squared error over that of the mean: {}",
            self.rows,
            self.targets.iter().map(sentence).collect::<Vec<_>>().join(", ")
        )
    }
}

/// Three digits.
fn short(share: f64) -> String {
    if (1e-3..1e3).contains(&share) { format!("{share:.3}") } else { format!("{share:.1e}") }
}

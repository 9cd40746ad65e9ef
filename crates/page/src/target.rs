//! Sums of a target over the rows: its values over time, its errors, and its residuals.

use fleetfoot_data::Episode;
use fleetfoot_dynamics::Predicted;
use fleetfoot_model::Model;
use fleetfoot_report::Bins;

use crate::{coverage::Coverage, leftover::Leftover};

/// Targets that are drawn.
const TARGETS: usize = 6;
/// Of these, targets that stand unfolded.
pub(crate) const SHOWN: usize = 2;
/// Bins along the time of a log, for targets that stand unfolded and for the others, and along the errors.
const TIMES: [usize; 2] = [160, 80];
pub(crate) const ERRORS: usize = 64;
/// Errors are drawn up to so many standard deviations of the target.
pub(crate) const REACH: f64 = 2.0;

/// One target.
#[derive(Clone)]
pub(crate) struct Target {
    pub(crate) name: String,
    pub(crate) unit: Option<String>,
    /// Standard deviation over the training rows.
    pub(crate) sigma: f64,
    /// Bins a second.
    pub(crate) spans: f64,
    pub(crate) measured: Bins,
    pub(crate) predicted: Bins,
    pub(crate) errors: Bins,
    pub(crate) left: Leftover,
}

/// The targets of a model, before any row, and the log that is drawn over time.
pub(crate) fn targets(model: &Model, drawn: &Episode, columns: &[Coverage]) -> Vec<Target> {
    let fitted = model.fitted().take(TARGETS).enumerate();
    let one = |(place, equation): (usize, &fleetfoot_model::Equation)| {
        let variance = model.training.target_covariance.get(fleetfoot_data::packed(place, place));
        // Bins narrower than the rows are apart would be empty here and there.
        let most = TIMES[usize::from(place >= SHOWN)].min(drawn.rows.div_ceil(2)).max(4);
        let time = || Bins::new(most);
        // As many bins whatever the length: the last row is just before the end of the last one.
        let spans = (1.0 - 1e-9) * most as f64 / drawn.duration();
        Target {
            name: equation.label(),
            unit: equation.unit.clone(),
            sigma: variance.map_or(f64::NAN, |variance| variance.sqrt()),
            spans: if spans.is_finite() { spans } else { 1.0 },
            measured: time(),
            predicted: time(),
            errors: Bins::new(ERRORS),
            left: Leftover::new(columns),
        }
    };
    fitted.map(one).collect()
}

impl Target {
    pub(crate) fn take(&mut self, place: usize, rows: &Predicted, time: Option<&[f64]>) {
        let values = |values| Predicted::equation(values, rows.rows, place);
        for &error in values(&rows.residual) {
            let share = error / self.sigma;
            if share.abs() < REACH {
                self.errors.add(share, 1.0);
            }
        }
        let Some(time) = time else { return };
        for ((&time, &measured), &predicted) in time.iter().zip(values(&rows.measured)).zip(values(&rows.predicted)) {
            self.measured.add(time * self.spans, measured);
            self.predicted.add(time * self.spans, predicted);
        }
    }

    /// Merges the rows behind these; `goes_on`: true if they follow in the same episode.
    pub(crate) fn append(&mut self, other: &Self, goes_on: bool) {
        self.measured.merge(&other.measured);
        self.predicted.merge(&other.predicted);
        self.errors.merge(&other.errors);
        self.left.append(&other.left, goes_on);
    }
}

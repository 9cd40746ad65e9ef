//! One step of time.

use fleetfoot_data::Source;
use fleetfoot_model::Prediction;

use crate::angle::wrap;

/// Integration method of derivatives from row to row.
///
/// Recorded columns are held from one row to the next (zero-order hold), also within a step. Equations for a next value
/// or a difference advance once a step with either method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// `x + h f(x)`: the method of the paper's simulations.
    Euler,
    /// The classical fourth-order Runge-Kutta method, as exported code has it. Within a step the region follows the stage, lagged columns
    /// and recorded columns are held, and `time()` moves with the stage.
    #[default]
    Rk4,
}

/// The length of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Step {
    /// The median sampling period of the episode.
    #[default]
    Median,
    /// The interval between the rows' own stamps.
    Stamps,
    /// This many seconds.
    Seconds(f64),
}

/// The sampling period of most rows of a source, seconds; `None` where no episode has two.
pub fn typical_period(source: &dyn Source) -> Option<f64> {
    let mut periods: Vec<(f64, usize)> =
        source.episodes().iter().filter(|e| e.rows > 1).map(|episode| (episode.period, episode.rows)).collect();
    periods.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = periods.iter().map(|(_, rows)| rows).sum::<usize>() / 2;
    let mut seen = 0;
    periods.into_iter().find_map(|(period, rows)| {
        seen += rows;
        (seen > half).then_some(period)
    })
}

/// Advance of one state: `factor * x + h * f`, then wrapped if it is an angle. (factor, h) is (1, step) for a
/// derivative, (1, 1) for a difference and (0, 1) for a next value. For a first-order lag of f it is (exp(-step/c), 1 -
/// exp(-step/c)).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Advance {
    /// The factor of the state itself; of a lag it depends on the step ([`Advance::factor`]).
    pub(crate) keep: f64,
    pub(crate) continuous: bool,
    pub(crate) angle: bool,
    /// The time constant of a first-order lag, seconds.
    pub(crate) lag: Option<f64>,
}

impl Advance {
    /// `None` for an equation that does not advance its subject.
    pub(crate) fn new(prediction: Prediction, angle: bool) -> Option<Self> {
        let (keep, continuous) = match prediction {
            Prediction::Derivative => (1.0, true),
            Prediction::Difference => (1.0, false),
            Prediction::Next => (0.0, false),
            Prediction::Value => return None,
        };
        Some(Self { keep, continuous, angle, lag: None })
    }

    /// Advance of a first-order lag with this time constant in seconds, towards its right side. It advances once a
    /// step, like [`FilterKind::Lag1`](fleetfoot_library::FilterKind::Lag1).
    pub(crate) fn lag(constant: f64) -> Self {
        Self { keep: f64::NAN, continuous: false, angle: false, lag: Some(constant) }
    }

    /// The factor of the state for a step of `seconds`.
    #[inline(always)]
    pub(crate) fn factor(&self, seconds: f64) -> f64 {
        self.lag.map_or(self.keep, |constant| (-seconds / constant).exp())
    }

    /// The factor of the right side for a step of `seconds`.
    #[inline(always)]
    pub(crate) fn gain(&self, seconds: f64) -> f64 {
        match self.lag {
            Some(constant) => -(-seconds / constant).exp_m1(),
            None if self.continuous => seconds,
            None => 1.0,
        }
    }

    /// The state one step later.
    #[inline(always)]
    pub(crate) fn next(&self, x: f64, f: f64, seconds: f64) -> f64 {
        if self.lag.is_some() {
            // As the recorded one: what is at rest stays so to the last bit.
            return x + self.gain(seconds) * (f - x);
        }
        let x = advance(self.keep, self.gain(seconds), x, f);
        if self.angle { wrap(x) } else { x }
    }
}

/// `keep * x + gain * f` with one rounding of the sum: the same bits in every path.
#[inline(always)]
pub(crate) fn advance(keep: f64, gain: f64, x: f64, f: f64) -> f64 {
    gain.mul_add(f, keep * x)
}

/// `(k1 + 2 k2 + 2 k3 + k4) / 6`.
#[inline(always)]
pub(crate) fn runge_kutta_mean(k: [f64; 4]) -> f64 {
    (2.0f64.mul_add(k[1], k[0]) + 2.0f64.mul_add(k[2], k[3])) * (1.0 / 6.0)
}

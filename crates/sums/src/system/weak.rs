//! The weak form: every equation averaged over short windows, so that no noisy row is ever differentiated.
//!
//! An equation `x' = sum_j c_j f_j(x)` holds after a product with a test function phi that is zero at both ends of a window, and an integral over it. By parts
//! the derivative moves onto the test function:
//!
//! ```text
//! -integral phi' x dt = sum_j c_j integral phi f_j(x) dt
//! ```
//!
//! (Schaeffer and McCalla, Physical Review E 96 (2017); Messenger and Bortz, "Weak SINDy: Galerkin-based data-driven
//! model selection", Multiscale Modeling & Simulation 19 (2021), WSINDy below.) Both sides are linear in the rows of a
//! window, so a window is one row of a regression with the same coefficients. It enters the statistic in the place of
//! the rows, and the code behind the statistic is unchanged.
//!
//! The window from row `c - m` to row `c + m` has the stamps a to b; `phi(s) = (1 - s^2)^p` with s from -1 at a to 1 at
//! b. Integrals are sums over the rows with the weights of the trapezoidal rule for the actual stamps. That is accurate
//! far beyond its usual order if a smooth function and its derivatives vanish at both ends (Euler and Maclaurin). Its
//! weights are positive, so that uneven stamps amplify no noise.

use std::f64::consts::TAU;

use fleetfoot_data::{Halo, Source};
use fleetfoot_library::Expr;
use fleetfoot_stats::scan::pilot_tiles;

use super::SystemError;

/// Rows of a window, from its middle to either end, at least.
pub const LEAST_REACH: usize = 4;
/// Windows begin at every so many rows of their reach: their test functions overlap by half of their height.
const STEPS: usize = 4;
/// Value of the test function in the row beside the end of its window: tau of WSINDy.
const TAIL: f64 = 1e-10;

/// Windows in the place of rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Weak {
    /// Rows from the middle of a window to either end, m: a window has 2 m + 1 rows.
    pub reach: usize,
    /// Every target over a window (q).
    pub targets: Vec<WeakTarget>,
    /// Error of the integrals, relative to a rate ([`weak_accuracy`]).
    pub accuracy: f64,
}

/// A target over a window: the rate of one expression, plus the mean of another.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakTarget {
    /// Signal whose derivative moves onto the test function.
    pub rate: Option<Rate>,
    /// Expression that is averaged like the candidates: minus the known part of the right side, or all of a target that
    /// is no derivative.
    pub mean: Expr,
}

/// Rate of change over a window.
#[derive(Debug, Clone, PartialEq)]
pub struct Rate {
    /// Over the columns of a source.
    pub of: Expr,
    /// True for an angle, whose steps from row to row are wrapped.
    pub angle: bool,
}

impl Weak {
    /// Rows of a window.
    pub fn rows(&self) -> usize {
        2 * self.reach + 1
    }

    /// Rows from one window to the next: a quarter of the reach.
    pub fn stride(&self) -> usize {
        (self.reach / STEPS).max(1)
    }

    /// Windows that share rows with a window before it: residuals of so many neighbours are correlated, whatever the noise.
    pub fn overlap(&self) -> usize {
        (2 * self.reach).div_ceil(self.stride())
    }

    /// Exponent p of the test function.
    pub(super) fn order(&self) -> i32 {
        order(self.reach)
    }

    pub(super) fn check(&self, targets: usize) -> Result<(), SystemError> {
        if self.reach < LEAST_REACH || self.targets.len() != targets {
            return Err(SystemError::Weak { reach: self.reach, window_targets: self.targets.len(), targets });
        }
        Ok(())
    }

    /// Expressions that are averaged for every target, then those that have a rate.
    pub(super) fn expressions(&self) -> (Vec<Expr>, Vec<Expr>) {
        let means = self.targets.iter().map(|target| target.mean.clone());
        (means.collect(), self.rates().map(|(_, rate)| rate.of.clone()).collect())
    }

    /// The targets that have a rate.
    pub(super) fn rates(&self) -> impl Iterator<Item = (usize, &Rate)> {
        self.targets.iter().enumerate().filter_map(|(at, target)| Some((at, target.rate.as_ref()?)))
    }

    /// Text of the windows, one line a fact.
    pub(super) fn text(&self) -> String {
        let mut text = format!("weak form over windows of {} rows, every {} rows\n", self.rows(), self.stride());
        for target in &self.targets {
            let rate = target.rate.as_ref().map_or_else(String::new, |rate| {
                format!("rate of {}{} and ", rate.of, if rate.angle { " (an angle)" } else { "" })
            });
            text.push_str(&format!("over a window : {rate}mean of {}\n", target.mean));
        }
        text
    }
}

/// The least exponent for which a test function is below 1e-10 in the row beside its end, as WSINDy chooses it.
fn order(reach: usize) -> i32 {
    let m = reach as f64;
    (TAIL.ln() / ((2.0 * m - 1.0) / (m * m)).ln()).ceil() as i32
}

/// The error of integrals over windows of a reach, from uneven stamps; with even ones it is tiny. It is relative to the
/// rate of signals that change as fast as the square and the cube of the time from the middle of the window to its end.
/// Root mean square over a sample of the rows, 1e-12 at least.
///
/// # Errors
/// Those of reading.
pub fn weak_accuracy(reach: usize, source: &dyn Source) -> Result<f64, SystemError> {
    let (mut window, mut squares, mut count) = (Window::default(), 0.0, 0_usize);
    pilot_tiles(source, Halo { before: reach, after: reach }, |_, block, tile| {
        for middle in tile.step_by(reach) {
            let Some(begin) = (block.before + middle).checked_sub(reach) else { continue };
            if let Some(stamps) = block.time.get(begin..begin + 2 * reach + 1) {
                window.set(stamps, order(reach));
                squares += window.defect(stamps).powi(2);
                count += 1;
            }
        }
        Ok::<_, SystemError>(())
    })?;
    Ok((squares / count.max(1) as f64).sqrt().max(1e-12))
}

/// The weights of a window's rows.
#[derive(Debug, Default)]
pub(super) struct Window {
    /// Of means: they add up to 1.
    pub(super) mean: Vec<f64>,
    /// Of rates: they give 0 for a constant and 1 for the time, whatever the stamps.
    pub(super) rate: Vec<f64>,
}

impl Window {
    /// The weights for a test function of order p over these stamps, nanoseconds, ascending.
    pub(super) fn set(&mut self, stamps: &[i64], p: i32) {
        let last = stamps.len() - 1;
        let seconds = |k: usize| (stamps[k] - stamps[0]) as f64 * 1e-9;
        let length = seconds(last);
        self.mean.clear();
        self.rate.clear();
        for k in 0..=last {
            // The test function is 0 at both ends.
            let width = if k == 0 || k == last { 0.0 } else { seconds(k + 1) - seconds(k - 1) };
            let s = 2.0 * seconds(k) / length - 1.0;
            let steep = width * (1.0 - s * s).max(0.0).powi(p - 1);
            self.mean.push(steep * (1.0 - s * s).max(0.0));
            self.rate.push(steep * s);
        }
        let mass: f64 = self.mean.iter().sum();
        self.mean.iter_mut().for_each(|weight| *weight /= mass);
        let drift: f64 = self.rate.iter().sum();
        self.rate.iter_mut().zip(&self.mean).for_each(|(rate, mean)| *rate -= drift * mean);
        let slope: f64 = self.rate.iter().enumerate().map(|(k, rate)| rate * (seconds(k) - length / 2.0)).sum();
        self.rate.iter_mut().for_each(|rate| *rate /= slope);
    }

    /// Difference between the rate of the square, or of the cube, and the mean of its derivative; the time runs from -1
    /// to 1.
    fn defect(&self, stamps: &[i64]) -> f64 {
        let half = (stamps[stamps.len() - 1] - stamps[0]) as f64 * 5e-10;
        let at = |k: usize| (stamps[k] - stamps[0]) as f64 * 1e-9 / half - 1.0;
        let sum = |of: &dyn Fn(f64, f64, f64) -> f64| -> f64 {
            (0..stamps.len()).map(|k| of(half * self.rate[k], self.mean[k], at(k))).sum()
        };
        let square = sum(&|rate, mean, s| rate * s * s - mean * 2.0 * s);
        let cube = sum(&|rate, mean, s| rate * s * s * s - mean * 3.0 * s * s);
        square.abs().max(cube.abs())
    }
}

/// `sum_k weights_k values_k`.
pub(super) fn sum(weights: &[f64], values: &[f64]) -> f64 {
    const LANES: usize = 8;
    let ((a, a_rest), (b, b_rest)) = (weights.as_chunks::<LANES>(), values.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        (0..LANES).for_each(|i| lanes[i] += a[i] * b[i]);
    }
    lanes.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

/// An angle without its jumps of a turn, from the first value on.
pub(super) fn unwrapped(values: &[f64], out: &mut Vec<f64>) {
    out.clear();
    let mut turns = 0.0;
    for (k, value) in values.iter().enumerate() {
        if k > 0 {
            turns -= TAU * ((value - values[k - 1]) / TAU).round();
        }
        out.push(value + turns);
    }
}

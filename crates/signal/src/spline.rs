//! Smoothing splines with derivatives and standard deviations.
//!
//! The spline of order 2M-1 is the least of
//!
//! ```text
//! sum_i w_i (y_i - f(t_i))^2  +  lambda * integral of (f^(M)(t))^2 dt
//! ```
//!
//! M = 2 the cubic, M = 3 the quintic one; t in seconds, the objective unscaled (that of `scipy.interpolate.make_smoothing_spline`). It is the posterior mean of a Gaussian process whose M-th
//! derivative is white noise of density sigma^2 / lambda, seen with errors of variance sigma^2 / w_i, with nothing known at the start (Wahba, "Improper priors,
//! spline smoothing and the problem of guarding against model errors in regression", JRSS B 40, 1978). The process is a chain of integrators,
//! so that a Kalman filter and a smoother find it in O(n) (Wecker and Ansley, "The signal extraction approach to nonlinear
//! regression and spline smoothing", JASA 78, 1983), with the derivatives as further states, standard deviations of all, and the likelihood of lambda.

mod better;
pub(crate) mod chain;
pub(crate) mod filter;
pub(crate) mod head;
mod link;
mod number;
mod scores;
pub(crate) mod smoother;

pub use better::better;
use scores::{Likelihood, Rest};
use smoother::{Residuals, Rows, Smoother};

use crate::{
    SignalError,
    error::{check, check_channel},
};

/// Width of the logarithm of the bandwidth at which the search for it ends.
const WIDTH: f64 = 1e-4;

/// Deviations of white noise, of what differences say of it, beyond which there is none.
const WHITE: f64 = 1.25;

/// Order of the spline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Spline {
    /// Penalises the second derivative (M = 2): value and slope.
    #[default]
    Cubic,
    /// Penalises the third derivative (M = 3): value, slope and second derivative.
    Quintic,
}

impl Spline {
    /// M: the derivative that is penalised, and how many of f, f', f'', ... are to be had.
    pub fn states(self) -> usize {
        match self {
            Self::Cubic => 2,
            Self::Quintic => 3,
        }
    }

    /// Rows over which a row is smoothed, where the share of its neighbours has fallen to one in a hundred of its own: ln(100) / sin(pi / 2M) bandwidths.
    ///
    /// `lambda` in s^(2M-1), `period` in s, `weight` a typical weight. The equivalent kernel decays by e over 1 / sin(pi / 2M) bandwidths (lambda period / weight)^(1/2M)
    /// (Silverman, "Spline smoothing: the equivalent variable kernel method", Annals of Statistics 12, 1984, for M = 2).
    pub fn correlation_rows(self, lambda: f64, period: f64, weight: f64) -> f64 {
        let m = self.states() as f64;
        let bandwidth = (lambda * period / weight).powf(0.5 / m);
        100.0_f64.ln() / (std::f64::consts::PI / (2.0 * m)).sin() * bandwidth / period
    }
}

/// Choice of the penalty.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Lambda {
    /// This one, s^(2M-1).
    Given(f64),
    /// The least score of generalised cross-validation, `n rss / (n - tr A)^2` (Craven and Wahba, 1979).
    Gcv,
    /// The greatest marginal likelihood with sigma profiled out and the unknown start left out (REML; Wahba, "A
    /// comparison of GCV and GML", Annals of Statistics 13, 1985). Only penalties count whose noise is no greater than
    /// the white noise that the differences of neighbours allow: oscillation is motion, not noise.
    #[default]
    Likelihood,
}

/// A smoothed channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothed {
    /// The penalty, s^(2M-1).
    pub lambda: f64,
    /// True if the choice stopped at an end of the search range: the channel is without noise, or a polynomial.
    pub at_end: bool,
    /// Standard deviation of the error of a measurement of weight one: sqrt(rss / (n - tr A)).
    pub noise: f64,
    /// Measured rows.
    pub measured: usize,
    /// Trace of the hat matrix: the numbers that the curve spends, from M to the measured rows.
    pub freedom: f64,
    /// f, f', ..., f^(M-1) at every stamp.
    pub derivatives: Vec<Vec<f64>>,
    /// Their standard deviations, in the same order.
    pub deviations: Vec<Vec<f64>>,
}

/// Smooths a channel: `times` in s, increasing; a value a stamp, NaN where nothing was measured; a weight a stamp (an error's variance is that of
/// weight one over the weight), or 1 for all. O(n); beside the answer it holds a copy of stamps and values.
///
/// ```
/// use fleetfoot_signal::{Lambda, Spline, smooth};
///
/// let times: Vec<f64> = (0..200).map(|row| 0.01 * f64::from(row)).collect();
/// let noisy = |t: &f64| (3.0 * t).sin() + 0.02 * ((61.8 * t).fract() - 0.5);
/// let measured: Vec<f64> = times.iter().map(noisy).collect();
/// let smoothed = smooth(&times, &measured, None, Spline::Quintic, Lambda::Likelihood)?;
/// let (rate, deviation) = (smoothed.derivatives[1][100], smoothed.deviations[1][100]);
/// assert!((rate - 3.0 * 3.0_f64.cos()).abs() < 3.0 * deviation && deviation < 0.1);
/// # Ok::<(), fleetfoot_signal::SignalError>(())
/// ```
///
/// # Errors
/// Arrays of different lengths, stamps that do not increase, weights that are negative, fewer than M + 1 measurements, a penalty that is not positive.
pub fn smooth(
    times: &[f64],
    values: &[f64],
    weights: Option<&[f64]>,
    spline: Spline,
    lambda: Lambda,
) -> Result<Smoothed, SignalError> {
    match spline {
        Spline::Cubic => Channel::new(times, values, weights, 2)?.smooth::<2>(lambda),
        Spline::Quintic => Channel::new(times, values, weights, 3)?.smooth::<3>(lambda),
    }
}

/// A channel in units in which numbers are near one.
struct Channel<'a> {
    times: Vec<f64>,
    values: Vec<f64>,
    weights: Option<&'a [f64]>,
    /// Seconds a unit of time.
    unit: f64,
    /// The mean of the measured values, which is subtracted.
    centre: f64,
    measured: usize,
    weight: f64,
}

impl<'a> Channel<'a> {
    fn new(times: &[f64], values: &[f64], weights: Option<&'a [f64]>, order: usize) -> Result<Self, SignalError> {
        check_channel(times, values, weights)?;
        let rows = Rows { times, values, weights };
        let (mut count, mut sum, mut weight) = (0, 0.0, 0.0);
        for (value, share) in (0..times.len()).filter_map(|row| rows.measured(row)) {
            (count, sum, weight) = (count + 1, sum + value, weight + share);
        }
        if count <= order {
            return Err(SignalError::TooFew { count, needed: order + 1 });
        }
        let (n, unit) = (count as f64, median_step(times));
        let centre = sum / n;
        Ok(Self {
            times: times.iter().map(|time| (time - times[0]) / unit).collect(),
            values: values.iter().map(|value| value - centre).collect(),
            weights,
            unit,
            centre,
            measured: count,
            weight: weight / n,
        })
    }

    fn rows(&self) -> Rows<'_> {
        Rows { times: &self.times, values: &self.values, weights: self.weights }
    }

    /// The penalty, in units of the channel, of a bandwidth of e^x rows.
    fn lambda<const M: usize>(&self, x: f64) -> f64 {
        self.weight * (2.0 * M as f64 * x).exp()
    }

    fn smooth<const M: usize>(&self, choice: Lambda) -> Result<Smoothed, SignalError> {
        let to_seconds = self.unit.powi(2 * M as i32 - 1);
        let (lambda, at_end) = match choice {
            Lambda::Given(lambda) => {
                let holds = lambda > 0.0 && lambda.is_finite();
                check(holds, "lambda", lambda, "a penalty must be positive and finite")?;
                (lambda / to_seconds, false)
            }
            Lambda::Gcv => self.search::<M>(|lambdas| self.gcv::<M>(lambdas)),
            Lambda::Likelihood => {
                let most = self.most_noise();
                self.search::<M>(|lambdas| self.deviances::<M>(lambdas, most))
            }
        };
        let mut smoothed = self.fit::<M>(lambda);
        (smoothed.lambda, smoothed.at_end) = (lambda * to_seconds, at_end);
        Ok(smoothed)
    }

    /// Bandwidths from a tenth of a row to all rows.
    fn search<const M: usize>(&self, scores: impl Fn(&[f64]) -> Vec<f64>) -> (f64, bool) {
        let rows = self.times.last().copied().unwrap_or(1.0).max(1.0);
        let all = |x: &[f64]| scores(&x.iter().map(|x| self.lambda::<M>(*x)).collect::<Vec<f64>>());
        let least = crate::least::least_of_many(0.1_f64.ln(), rows.ln().max(1.0), WIDTH, all);
        (self.lambda::<M>(least.at), least.at_end)
    }

    /// Rounding of the measurements: no sum of squares is less.
    fn floor(&self) -> f64 {
        let size = self
            .values
            .iter()
            .filter(|value| !value.is_nan())
            .fold(self.centre.abs(), |most, value| most.max(value.abs()));
        self.weight * self.measured as f64 * (f64::EPSILON * size).powi(2)
    }

    /// n rss / (n - tr A)^2 of each penalty.
    fn gcv<const M: usize>(&self, lambdas: &[f64]) -> Vec<f64> {
        let (n, floor) = (self.measured as f64, self.floor());
        let score = |Rest { squares, freedom }: &Rest| n * squares.max(floor) / (freedom * freedom);
        scores::rests::<M>(self.rows(), lambdas).iter().map(score).collect()
    }

    /// The variance that white noise of this channel can have, gross errors and all. It shows in full in the second differences of neighbours, to which motion only adds; an oscillation, which no
    /// integrated random walk is, looks like noise to the likelihood alone. A channel of weights has a variance of its own at every row.
    fn most_noise(&self) -> f64 {
        if self.weights.is_some() {
            return f64::INFINITY;
        }
        let measured: Vec<f64> = self.values.iter().copied().filter(|value| !value.is_nan()).collect();
        let last = measured.len() as isize - 1;
        // Mirrored at the ends, so that the error of every measurement counts six times.
        let at = |i: isize| measured[(last - (last - i.abs()).abs()) as usize];
        let second = |i: isize| at(i - 1) - 2.0 * at(i) + at(i + 1);
        let squares: f64 = (-1..=last + 1).map(|i| second(i).powi(2)).sum();
        // The mean of so many squares is no closer to the variance than that.
        let doubt = 1.0 + 5.0 / (measured.len() as f64).sqrt();
        (WHITE * doubt).powi(2) * squares / 6.0 / measured.len() as f64
    }

    /// Minus twice the marginal log-likelihood of each penalty, up to a constant; infinite where the variance of the noise would be above `most`.
    fn deviances<const M: usize>(&self, lambdas: &[f64], most: f64) -> Vec<f64> {
        let floor = self.floor();
        let deviance = |Likelihood { squares, log_variance, count }: &Likelihood| {
            // Noise at the level of rounding is none either.
            if *squares > (most * *count as f64).max(floor) {
                return f64::INFINITY;
            }
            *count as f64 * squares.max(floor).ln() + log_variance
        };
        scores::likelihoods::<M>(self.rows(), lambdas).iter().map(deviance).collect()
    }

    /// The spline of a penalty in units of the channel.
    fn fit<const M: usize>(&self, lambda: f64) -> Smoothed {
        // Zeros that the system hands out cost nothing until they are written.
        let zeros = || (0..M).map(|_| vec![0.0; self.times.len()]).collect::<Vec<_>>();
        let (mut derivatives, mut deviations) = (zeros(), zeros());
        let (rows, mut residuals) = (self.rows(), Residuals::default());
        Smoother::<_, M>::new(rows, lambda).smooth(|row, state| {
            rows.add(&mut residuals, row, state);
            for k in 0..M {
                derivatives[k][row] = state.mean[k];
                deviations[k][row] = state.covariance[k][k];
            }
        });
        let Residuals { squares, freedom } = residuals;
        let noise = (squares / (self.measured as f64 - freedom)).sqrt();
        for k in 0..M {
            let unit = self.unit.powi(k as i32);
            let centre = if k == 0 { self.centre } else { 0.0 };
            derivatives[k].iter_mut().for_each(|value| *value = *value / unit + centre);
            deviations[k].iter_mut().for_each(|value| *value = noise * value.sqrt() / unit);
        }
        Smoothed { lambda, at_end: false, noise, measured: self.measured, freedom, derivatives, deviations }
    }
}

/// The median of the steps between stamps, of which there is one at least.
pub(crate) fn median_step(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

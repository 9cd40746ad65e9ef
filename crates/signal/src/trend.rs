//! Trend filtering: the curve of least total variation of a derivative.
//!
//! The trend of degree k is the least of
//!
//! ```text
//! 1/2 sum_i w_i (y_i - x_i)^2  +  lambda * sum_j |(D x)_j|
//! ```
//!
//! where (D x)_j are the steps between neighbouring k-th derivatives of x, as differences over the stamps tell them (the sum is the total variation of the k-th derivative): a polynomial of degree k piece by piece,
//! with few pieces, their borders chosen by the data. k = 1 are straight lines (Kim, Koh, Boyd, Gorinevsky, "l1 trend filtering", SIAM Review 51, 2009); higher degrees and uneven stamps are
//! those of Tibshirani, "Adaptive piecewise polynomial estimation via trend filtering", Annals of Statistics 42, 2014, whose D this is up to the unit: `lambda` is in units of the channel times s^k.

mod chain;
mod derivatives;
mod interior;

use crate::{
    Lambda, SignalError,
    error::{check, check_channel},
    interpolate::resampled,
    spline::median_step,
};
use chain::Points;
use derivatives::local_derivatives;
use interior::Solution;

/// Width of the logarithm of lambda at which the search for it ends: criteria jump wherever a piece joins its neighbour.
const WIDTH: f64 = 0.02;

/// The share of the measurements that a chosen trend may spend: criteria fail where a curve is about to go through all of them.
const MOST: f64 = 1.0 / 3.0;

/// A channel as a trend.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    /// The penalty, in units of the channel times s^k.
    pub lambda: f64,
    /// True if the choice stopped at an end of the search range: at a polynomial, or at the measurements themselves.
    pub at_end: bool,
    /// Standard deviation of the error of a measurement of weight one: sqrt(rss / (n - freedom)).
    pub noise: f64,
    /// Measured rows.
    pub measured: usize,
    /// Degrees of freedom: k + 1, and one a border between pieces (Tibshirani and Taylor, "Degrees of freedom in lasso problems", Annals of Statistics 40, 2012).
    pub freedom: usize,
    /// Measured rows, the last of k + 1 that lie on one polynomial, after which the next piece begins.
    pub borders: Vec<usize>,
    /// The least value found, of the objective above.
    pub objective: f64,
    /// The duality gap: the objective's least value is not less than `objective - gap`.
    pub gap: f64,
    /// True if the gap is at most a millionth of the objective.
    pub converged: bool,
    /// Steps of the interior point.
    pub iterations: usize,
    /// x, its first derivative and, for k of 2 and 3, its second, at every stamp. A stamp without a measurement takes
    /// the piece that it lies in.
    pub derivatives: Vec<Vec<f64>>,
}

/// The trend of degree 1 to 3 of a channel: `times` in s, increasing; a value a stamp, NaN where nothing was measured; a weight a stamp, or 1 for all.
///
/// `lambda` is given, or the least of a criterion: [`Lambda::Likelihood`] is n log rss + freedom log n (Schwarz's approximation of the marginal likelihood),
/// [`Lambda::Gcv`] n rss / (n - freedom)^2, of trends that spend a third of the measurements at most. O(n) a step of the interior point, some 20 to 40 steps; the choice takes thirty such solutions.
///
/// ```
/// use fleetfoot_signal::{Lambda, trend_filter};
///
/// let times: Vec<f64> = (0..200).map(|row| 0.01 * f64::from(row)).collect();
/// let corner = |t: &f64| (t - 1.0).abs() + 0.01 * ((618.0 * t).fract() - 0.5);
/// let measured: Vec<f64> = times.iter().map(corner).collect();
/// let trend = trend_filter(&times, &measured, None, 1, Lambda::Likelihood)?;
/// assert!(trend.converged && trend.freedom <= 6);
/// assert!((trend.derivatives[1][50] + 1.0).abs() < 0.05 && (trend.derivatives[1][150] - 1.0).abs() < 0.05);
/// # Ok::<(), fleetfoot_signal::SignalError>(())
/// ```
///
/// # Errors
/// Arrays of different lengths, stamps that do not increase, weights that are negative, a degree other than 1, 2 and 3, fewer than k + 2 measurements, a penalty that is not positive.
pub fn trend_filter(
    times: &[f64],
    values: &[f64],
    weights: Option<&[f64]>,
    degree: usize,
    lambda: Lambda,
) -> Result<Trend, SignalError> {
    check((1..=3).contains(&degree), "degree", degree as f64, "the degree of a trend must be 1, 2 or 3")?;
    check_channel(times, values, weights)?;
    let channel = Channel::new(times, values, weights, degree)?;
    match degree {
        1 => channel.trend::<2>(lambda),
        2 => channel.trend::<3>(lambda),
        _ => channel.trend::<4>(lambda),
    }
}

/// The measured rows of a channel, in units in which numbers are near one.
struct Channel<'a> {
    times: &'a [f64],
    degree: usize,
    /// The rows.
    rows: Vec<usize>,
    points: Points,
    /// Seconds a unit of time.
    unit: f64,
    /// The mean of the values, which is subtracted, and what one is of the channel then.
    centre: f64,
    size: f64,
}

impl<'a> Channel<'a> {
    fn new(times: &'a [f64], values: &[f64], weights: Option<&[f64]>, degree: usize) -> Result<Self, SignalError> {
        let weight = |row: usize| weights.map_or(1.0, |weights| weights[row]);
        let rows: Vec<usize> = (0..times.len()).filter(|&row| weight(row) > 0.0 && !values[row].is_nan()).collect();
        if rows.len() < degree + 2 {
            return Err(SignalError::TooFew { count: rows.len(), needed: degree + 2 });
        }
        let stamps: Vec<f64> = rows.iter().map(|&row| times[row]).collect();
        let (n, unit) = (rows.len() as f64, median_step(&stamps));
        let centre = rows.iter().map(|&row| values[row]).sum::<f64>() / n;
        let square = rows.iter().map(|&row| (values[row] - centre).powi(2)).sum::<f64>() / n;
        let size = Some(square.sqrt()).filter(|size| *size > 0.0).unwrap_or(1.0);
        let points = Points {
            times: stamps.iter().map(|time| (time - stamps[0]) / unit).collect(),
            values: rows.iter().map(|&row| (values[row] - centre) / size).collect(),
            variances: rows.iter().map(|&row| 1.0 / weight(row)).collect(),
        };
        Ok(Self { times, degree, rows, points, unit, centre, size })
    }

    /// The penalty of one in units of the channel.
    fn penalty(&self) -> f64 {
        self.size * self.unit.powi(self.degree as i32)
    }

    fn trend<const M: usize>(&self, choice: Lambda) -> Result<Trend, SignalError> {
        let (lambda, at_end) = match choice {
            Lambda::Given(lambda) => {
                check(lambda > 0.0 && lambda.is_finite(), "lambda", lambda, "a penalty must be positive and finite")?;
                (lambda / self.penalty(), false)
            }
            Lambda::Gcv => self.search::<M>(|n, rss, freedom| n * rss / ((n - freedom) * (n - freedom))),
            Lambda::Likelihood => self.search::<M>(|n, rss, freedom| n * rss.ln() + freedom * n.ln()),
        };
        Ok(self.to_trend::<M>(&self.points.solved::<M>(lambda), lambda, at_end))
    }

    /// From the least penalty that leaves a polynomial down to one that follows single measurements.
    fn search<const M: usize>(&self, criterion: impl Fn(f64, f64, f64) -> f64 + Sync) -> (f64, bool) {
        let most = self.points.greatest_penalty::<M>();
        let n = self.rows.len() as f64;
        let score = |log: f64| {
            let solution = self.points.solved::<M>(log.exp());
            let freedom = (M + solution.borders().count()) as f64;
            let squares = self.points.squares(&solution.x).max(self.floor());
            if freedom > MOST * n { f64::INFINITY } else { criterion(n, squares, freedom) }
        };
        // A border costs about the noise times the square root of what it spends; a thousandth of the noise of neighbours costs nothing.
        let least = (1e-3 * self.points.noise()).clamp(1e-12 * most, 0.1 * most);
        let minimum = crate::least::least(least.ln(), most.ln(), WIDTH, score);
        let spent = (M + self.points.solved::<M>(minimum.at.exp()).borders().count()) as f64;
        (minimum.at.exp(), minimum.at_end || spent > 0.9 * MOST * n)
    }

    /// Rounding of the measurements: no sum of squares is less.
    fn floor(&self) -> f64 {
        let size = f64::EPSILON * (1.0 + (self.centre / self.size).abs());
        self.points.variances.iter().map(|variance| size * size / variance).sum()
    }

    /// The solution in units of the channel.
    fn to_trend<const M: usize>(&self, solution: &Solution, lambda: f64, at_end: bool) -> Trend {
        let freedom = M + solution.borders().count();
        let left = self.rows.len().saturating_sub(freedom).max(1) as f64;
        let square = self.size * self.size;
        Trend {
            lambda: lambda * self.penalty(),
            at_end,
            noise: self.size * (self.points.squares(&solution.x) / left).sqrt(),
            measured: self.rows.len(),
            freedom,
            borders: solution.borders().map(|j| self.rows[j + M - 1]).collect(),
            objective: square * solution.objective,
            gap: square * solution.gap,
            converged: solution.converged,
            iterations: solution.iterations,
            derivatives: self.at_all_stamps(&solution.x),
        }
    }

    /// Value and derivatives of the trend at every stamp.
    fn at_all_stamps(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let stamps: Vec<f64> = self.rows.iter().map(|&row| self.times[row]).collect();
        let x: Vec<f64> = x.iter().map(|x| self.centre + self.size * x).collect();
        let lists = local_derivatives(&stamps, &x, self.degree);
        resampled(&stamps, &lists, self.times, self.degree == 1)
    }
}

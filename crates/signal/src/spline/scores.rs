//! Filter of a channel under several penalties at once: a register holds a number of each.
//!
//! Cross-validation needs the squares of the smoother's residuals and the trace of its hat matrix. Neither needs the
//! smoother. Let V = K + s W^-1, with K the prior covariance of the measurements and s the variance of an error of
//! weight one. With P the projection that removes polynomials,
//!
//! ```text
//! y' P y = sum e^2 / v,   log |V|_P = sum log v
//! -d/ds y' P y = y' P W^-1 P y = sum w (y - f)^2,   d/ds log |V|_P = tr(W^-1 P) = n - tr A   at s = 1
//! ```
//!
//! so that both are slopes of the filter's sums (e its innovations, v their variances). They are computed with the
//! sums, and no rows are kept.

use fleetfoot_data::parallel_all;
use pulp::{Simd, WithSimd};

use super::{
    chain::{Chain, Matrix},
    filter::{Belief, Innovation},
    number::{Lanes, Number, Sloped},
    smoother::{Rows, Smoother, Start},
};

/// Penalties that are tried at a time. Registers of eight numbers take them at once, others in turn, and the answer is the same.
pub(super) const TOGETHER: usize = 8;

/// Variances whose product no exponent is too small for: what is near one in the channel's units may be 1e77.
const FACTORS: usize = 4;

/// Likelihood of a channel from the filter.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Likelihood {
    /// Sum of e^2 / v over the innovations: the least value of the spline's objective.
    pub(super) squares: f64,
    /// Sum of log v.
    pub(super) log_variance: f64,
    /// Number of innovations: measured rows less the M that determine the start.
    pub(super) count: usize,
}

/// Residuals of a channel after smoothing.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rest {
    /// Weighted sum of squared residuals.
    pub(super) squares: f64,
    /// Measured rows less the trace of the hat matrix.
    pub(super) freedom: f64,
}

/// The likelihood of each of these penalties.
pub(super) fn likelihoods<const M: usize>(rows: Rows<'_>, lambdas: &[f64]) -> Vec<Likelihood> {
    of_all(lambdas, |lambdas| fleetfoot_data::arch().dispatch(Likelihoods::<M> { rows, lambdas }))
}

/// Residuals of the measurements for each of these penalties.
pub(super) fn rests<const M: usize>(rows: Rows<'_>, lambdas: &[f64]) -> Vec<Rest> {
    of_all(lambdas, |lambdas| fleetfoot_data::arch().dispatch(Rests::<M> { rows, lambdas }))
}

/// All penalties, some at a time, on all threads.
fn of_all<T: Send + Clone>(lambdas: &[f64], work: impl Fn(&[f64]) -> Vec<T> + Sync) -> Vec<T> {
    let pieces: Vec<&[f64]> = lambdas.chunks(TOGETHER).collect();
    parallel_all(pieces.len(), |at| work(pieces[at])).concat()
}

/// Takes what the filter says of every measurement.
trait Sums<T> {
    fn add(&mut self, innovation: Innovation<T>);
}

/// The filter from the row after `first` on; `unit` is the variance of an error of weight one.
#[inline(always)]
fn filter<const M: usize, T: Number<Shared = f64>>(
    rows: Rows<'_>,
    first: usize,
    mut belief: Belief<M, T>,
    chain: &Chain<M, T>,
    unit: T,
    sums: &mut impl Sums<T>,
) {
    for row in first + 1..rows.times.len() {
        belief = belief.predicted(&chain.step(rows.times[row] - rows.times[row - 1]));
        if let Some((value, weight)) = rows.measured(row) {
            sums.add(belief.measure(value, unit.times(1.0 / weight)));
        }
    }
}

/// Beliefs side by side.
#[inline(always)]
fn beliefs<const M: usize, S: Simd>(simd: S, starts: &[Belief<M>]) -> Belief<M, Lanes<S>> {
    let zero = Lanes::load(simd, &[0.0]);
    let mut belief = Belief { mean: [zero; M], factor: [[zero; M]; M] };
    for i in 0..M {
        belief.mean[i] = Lanes::gather(simd, starts, |start| start.mean[i]);
        for j in 0..=i {
            belief.factor[i][j] = Lanes::gather(simd, starts, |start| start.factor[i][j]);
        }
    }
    belief
}

/// The first rows under each penalty.
fn starts<const M: usize>(rows: Rows<'_>, lambdas: &[f64]) -> Vec<Start<M>> {
    lambdas.iter().map(|lambda| Smoother::<_, M>::new(rows, *lambda).start()).collect()
}

struct Likelihoods<'a, const M: usize> {
    rows: Rows<'a>,
    lambdas: &'a [f64],
}

/// Sums of squares, and of logarithms as the mantissa and the exponents of a product.
struct LikelihoodSums<T> {
    squares: T,
    product: T,
    exponents: [i64; TOGETHER],
    count: usize,
}

impl<S: Simd> Sums<Lanes<S>> for LikelihoodSums<Lanes<S>> {
    #[inline(always)]
    fn add(&mut self, innovation: Innovation<Lanes<S>>) {
        self.squares = self.squares + innovation.square();
        self.product = self.product * innovation.variance;
        self.count += 1;
        if self.count.is_multiple_of(FACTORS) {
            self.product.take_exponents(&mut self.exponents);
        }
    }
}

impl<const M: usize> WithSimd for Likelihoods<'_, M> {
    type Output = Vec<Likelihood>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut scores = Vec::new();
        for lambdas in self.lambdas.chunks(S::F64_LANES.min(TOGETHER)) {
            let starts = starts::<M>(self.rows, lambdas);
            let starting: Vec<Belief<M>> = starts.iter().map(|start| start.belief).collect();
            let one = Lanes::load(simd, &[1.0]);
            let chain = Chain::new(Lanes::load(simd, lambdas).inverse());
            let squares = Lanes::gather(simd, &starts, |start| start.squares);
            let mut sums = LikelihoodSums { squares, product: one, exponents: [0; TOGETHER], count: 0 };
            filter(self.rows, starts[0].row, beliefs(simd, &starting), &chain, one, &mut sums);
            for at in 0..lambdas.len() {
                let log_variance = sums.product.values()[at].ln() + sums.exponents[at] as f64 * std::f64::consts::LN_2;
                scores.push(Likelihood { squares: sums.squares.values()[at], log_variance, count: sums.count });
            }
        }
        scores
    }
}

struct Rests<'a, const M: usize> {
    rows: Rows<'a>,
    lambdas: &'a [f64],
}

/// Sums under one penalty: squares with their slope by the variance of the errors, and the slope of log |V| by it.
struct RestSums<T> {
    squares: Sloped<T>,
    freedom: T,
}

impl<T: Number> Sums<Sloped<T>> for RestSums<T> {
    #[inline(always)]
    fn add(&mut self, innovation: Innovation<Sloped<T>>) {
        self.squares = self.squares + innovation.square();
        self.freedom = innovation.variance.slope.fused(innovation.weight.value, self.freedom);
    }
}

impl<const M: usize> WithSimd for Rests<'_, M> {
    type Output = Vec<Rest>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut scores = Vec::new();
        for lambdas in self.lambdas.chunks(S::F64_LANES.min(TOGETHER)) {
            let starts = starts::<M>(self.rows, lambdas);
            let first = starts[0].row;
            let by_errors = by_errors::<M>(self.rows, first);
            let starting: Vec<Belief<M>> = starts.iter().map(|start| start.belief).collect();
            // The mean of the first M measurements is the polynomial through them, whatever their errors.
            let grown: Vec<Belief<M>> =
                starting.iter().map(|belief| Belief { mean: [0.0; M], factor: belief.grown(&by_errors) }).collect();
            let (values, slopes) = (beliefs(simd, &starting), beliefs(simd, &grown));
            let one = Lanes::load(simd, &[1.0]);
            let zero = Lanes::load(simd, &[0.0]);
            let mut belief = Belief {
                mean: [Sloped { value: zero, slope: zero }; M],
                factor: [[Sloped { value: zero, slope: zero }; M]; M],
            };
            for i in 0..M {
                belief.mean[i] = Sloped { value: values.mean[i], slope: slopes.mean[i] };
                for j in 0..M {
                    belief.factor[i][j] = Sloped { value: values.factor[i][j], slope: slopes.factor[i][j] };
                }
            }
            let chain = Chain::new(Sloped { value: Lanes::load(simd, lambdas).inverse(), slope: zero });
            let unit = Sloped { value: one, slope: one };
            let mut sums = RestSums { squares: Sloped { value: zero, slope: zero }, freedom: zero };
            filter(self.rows, first, belief, &chain, unit, &mut sums);
            for at in 0..lambdas.len() {
                scores.push(Rest { squares: -sums.squares.slope.values()[at], freedom: sums.freedom.values()[at] });
            }
        }
        scores
    }
}

/// Covariance of the state at the last of the first M measurements due to their errors of weight one. It is the sum
/// over the measurements of the squared state that each error makes, and is the same under any penalty.
fn by_errors<const M: usize>(rows: Rows<'_>, first: usize) -> Matrix<M> {
    let mut sum = [[0.0; M]; M];
    let mut values = rows.values[..=first].to_vec();
    for (row, weight) in (0..=first).filter_map(|row| Some((row, rows.measured(row)?.1))) {
        for (at, value) in values.iter_mut().enumerate().filter(|(_, value)| !value.is_nan()) {
            *value = f64::from(at == row);
        }
        let alone = Rows { times: &rows.times[..=first], values: &values, weights: rows.weights };
        let state = Smoother::<_, M>::new(alone, 1.0).start().belief.mean;
        for i in 0..M {
            for j in 0..M {
                sum[i][j] += state[i] * state[j] / weight;
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::smoother::Residuals;

    /// Against what the smoother leaves, and against the filter of one penalty; rows without a measurement are among them, at the start as well.
    #[test]
    fn filter_slopes_match_the_smoother() {
        let noise = |row: usize| (fleetfoot_data::mix(row as u64) >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
        let times: Vec<f64> = (0..300).map(|row| row as f64 + 0.8 * noise(row)).collect();
        let mut values: Vec<f64> = times.iter().zip(0..).map(|(t, row)| (0.05 * t).sin() + noise(1000 + row)).collect();
        for row in [0, 2, 3, 100, 101, 299] {
            values[row] = f64::NAN;
        }
        let weights: Vec<f64> = (0..300).map(|row| 0.2 + 3.0 * (0.5 + noise(2000 + row))).collect();
        let rows = Rows { times: &times, values: &values, weights: Some(&weights) };
        check::<2>(rows);
        check::<3>(rows);
    }

    fn check<const M: usize>(rows: Rows<'_>) {
        let lambdas: Vec<f64> = (-4..16).map(|k| 10.0_f64.powf(f64::from(k))).collect();
        let measured = rows.values.iter().filter(|value| !value.is_nan()).count();
        let (rests, likelihoods) = (rests::<M>(rows, &lambdas), likelihoods::<M>(rows, &lambdas));
        for (at, &lambda) in lambdas.iter().enumerate() {
            let mut residuals = Residuals::default();
            let smoother = Smoother::<_, M>::new(rows, lambda);
            let squares = smoother.smooth(|row, state| rows.add(&mut residuals, row, state));
            let rest = rests[at];
            assert!((rest.squares / residuals.squares - 1.0).abs() < 1e-9, "{lambda:e}: {rest:?} {residuals:?}");
            let freedom = measured as f64 - residuals.freedom;
            // The trace itself is a difference from so many rows.
            assert!((rest.freedom - freedom).abs() < 1e-10 * measured as f64, "{lambda:e}: {rest:?} {freedom}");
            let (likelihood, alone) = (likelihoods[at], super::likelihoods::<M>(rows, &[lambda])[0]);
            assert!((likelihood.squares / squares - 1.0).abs() < 1e-10 && likelihood.count == measured - M);
            assert_eq!((likelihood.squares, likelihood.log_variance), (alone.squares, alone.log_variance));
            assert_eq!(super::rests::<M>(rows, &[lambda])[0].squares, rest.squares);
        }
    }
}

//! Estimates with their 95 % intervals.
//!
//! Rows of a log are correlated, so an interval comes from the spread between whole episodes (or between long contiguous spans), never from the spread
//! between rows.

/// A value with the ends of its 95 % interval; NaN ends where there are fewer than two parts to compare.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Estimate {
    /// The ratio `sum(numerator) / sum(weight)` over parts `(numerator, weight)`, with its t-interval.
    ///
    /// With numerators that are sums and weights that are counts this is the mean of the parts' means weighted by rows. The
    /// variance is that of the linearised ratio, `E/(E-1) sum_i (a_i - r b_i)^2 / (sum_i b_i)^2`, with E - 1 degrees of freedom
    /// (Cochran, Sampling Techniques, chapter 6: ratio estimates). Parts of no weight are left out.
    pub fn of_ratio(parts: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let parts: Vec<(f64, f64)> = parts.into_iter().filter(|part| part.1 > 0.0).collect();
        let (numerator, weight) = parts.iter().fold((0.0, 0.0), |(a, b), part| (a + part.0, b + part.1));
        let value = numerator / weight;
        if parts.len() < 2 {
            return Self { value, low: f64::NAN, high: f64::NAN };
        }
        let count = parts.len() as f64;
        let square: f64 = parts.iter().map(|(a, b)| (a - value * b).powi(2)).sum();
        let half = student_t_95(parts.len() - 1) * (count / (count - 1.0) * square).sqrt() / weight;
        Self { value, low: value - half, high: value + half }
    }

    /// [`Estimate::of_ratio`] of what cannot be negative, such as errors: the interval is that of the logarithm, whose standard error is that of the ratio over the ratio, so that no
    /// end is below zero. A ratio of zero has no logarithm, and keeps its own interval.
    pub fn of_errors(parts: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let plain = Self::of_ratio(parts);
        let factor = ((plain.high - plain.value) / plain.value).exp();
        if plain.value > 0.0 { Self { low: plain.value / factor, high: plain.value * factor, ..plain } } else { plain }
    }
}

/// Units that an interval compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// This many episodes.
    Episodes(usize),
    /// This many folds of cross-validation, each with a span of every episode: neighbours are correlated, so the interval is a lower bound.
    Folds(usize),
    /// This many contiguous spans of a single episode: neighbours are correlated, so the interval is a lower bound.
    Spans(usize),
    /// This many starts of a single episode: their rows overlap or neighbour, so the interval is a lower bound.
    Starts(usize),
}

/// The 0.975 quantile of Student's t distribution: 95 % of the distribution lies within this distance of zero.
///
/// Up to 200 degrees of freedom by bisection on the finite series of Abramowitz and Stegun (26.7.3, 26.7.4), beyond by
/// their expansion (26.7.5), which is good to 1e-7 there.
pub fn student_t_95(freedom: usize) -> f64 {
    if freedom == 0 {
        return f64::INFINITY;
    }
    let nu = freedom as f64;
    if freedom > 200 {
        let z: f64 = 1.959_963_984_540_054;
        let first = (z.powi(3) + z) / (4.0 * nu);
        let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * nu * nu);
        return z + first + second;
    }
    let (mut low, mut high) = (0.0f64, std::f64::consts::FRAC_PI_2);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if central_probability(middle, freedom) < 0.95 { low = middle } else { high = middle }
    }
    nu.sqrt() * (0.5 * (low + high)).tan()
}

/// P(|T| <= t) for theta = atan(t / sqrt(nu)).
fn central_probability(theta: f64, freedom: usize) -> f64 {
    let (sin, cos) = theta.sin_cos();
    let even = freedom.is_multiple_of(2);
    let (mut term, mut sum) = (if even { 1.0 } else { cos }, 0.0);
    let mut k = if even { 0 } else { 1 };
    while k + 2 <= freedom {
        sum += term;
        term *= cos * cos * (k + 1) as f64 / (k + 2) as f64;
        k += 2;
    }
    if even { sin * sum } else { std::f64::consts::FRAC_2_PI * (theta + sin * sum) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_the_t_table() {
        // Tables: 12.7062, 4.30265, 3.18245, 2.57058, 2.22814, 2.04227, 1.98397 (100), 1.97190 (200), 1.96234 (1000).
        for (freedom, expected) in [
            (1, 12.70620),
            (2, 4.30265),
            (3, 3.18245),
            (5, 2.57058),
            (10, 2.22814),
            (30, 2.04227),
            (100, 1.98397),
            (200, 1.97190),
            (1000, 1.96234),
        ] {
            let t = student_t_95(freedom);
            assert!((t - expected).abs() < 6e-6, "{freedom}: {t}");
        }
        assert!((student_t_95(200) - student_t_95(201)).abs() < 1e-4);
    }

    #[test]
    fn equal_weights_give_the_plain_t_interval() {
        let means = [1.0, 2.0, 4.0, 3.0];
        let estimate = Estimate::of_ratio(means.iter().map(|m| (m * 10.0, 10.0)));
        let deviation = (means.iter().map(|m| (m - 2.5f64).powi(2)).sum::<f64>() / 3.0).sqrt();
        let half = 3.182446 * deviation / 2.0;
        assert!((estimate.value - 2.5).abs() < 1e-15);
        assert!(
            (estimate.high - estimate.value - half).abs() < 1e-5 && (estimate.value - estimate.low - half).abs() < 1e-5
        );
    }

    #[test]
    fn intervals_of_errors_are_above_zero() {
        let parts = [(9.0, 1.0), (0.1, 1.0), (0.2, 1.0)];
        let (plain, errors) = (Estimate::of_ratio(parts), Estimate::of_errors(parts));
        assert!(plain.low < 0.0 && errors.low > 0.0 && errors.high > plain.high, "{errors:?}");
        assert_eq!(errors.value, plain.value);
        assert!((errors.low * errors.high - errors.value * errors.value).abs() < 1e-9);
        // If the parts agree, both are the same to the second order.
        let parts = [(1.0, 1.0), (1.01, 1.0), (0.99, 1.0)];
        let (plain, errors) = (Estimate::of_ratio(parts), Estimate::of_errors(parts));
        assert!((plain.low - errors.low).abs() < 1e-3 && (plain.high - errors.high).abs() < 1e-3);
        assert_eq!(Estimate::of_errors([(0.0, 1.0), (0.0, 2.0)]), Estimate { value: 0.0, low: 0.0, high: 0.0 });
    }

    #[test]
    fn one_part_has_no_interval() {
        let estimate = Estimate::of_ratio([(3.0, 2.0), (0.0, 0.0)]);
        assert_eq!(estimate.value, 1.5);
        assert!(estimate.low.is_nan());
    }
}

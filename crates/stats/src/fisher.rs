//! Fisher's F distribution.

/// Terms of the continued fraction at most: it needs some tens, and some multiples of the root of the degrees of freedom where these are many.
const TERMS: usize = 20_000;
/// A term that changes the fraction by less is the last one.
const CONVERGED: f64 = 4.0 * f64::EPSILON;

/// The probability that a number of the F distribution with these degrees of freedom (of the numerator, of the denominator; above 0, whole or not) exceeds
/// `value`; NaN for a value that is not a number.
///
/// The regularised incomplete beta function `I_x(d2/2, d1/2)` at `x = d2 / (d2 + d1 value)` (Abramowitz and Stegun, equation 26.6.2), by its continued fraction
/// (NIST Digital Library of Mathematical Functions, equation 8.17.22).
pub fn f_tail(value: f64, [above, below]: [f64; 2]) -> f64 {
    if value.is_nan() {
        return f64::NAN;
    }
    if value <= 0.0 {
        return 1.0;
    }
    // Shares of the denominator and of the numerator, neither as one less the other.
    let odds = above * value / below;
    let (x, y) = (1.0 / (1.0 + odds), if odds.is_finite() { odds / (1.0 + odds) } else { 1.0 });
    incomplete_beta([x, y], [0.5 * below, 0.5 * above])
}

/// `I_x(a, b)`; `y` is `1 - x`.
fn incomplete_beta([x, y]: [f64; 2], [a, b]: [f64; 2]) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if y <= 0.0 {
        return 1.0;
    }
    // The fraction converges fast on this side of the mean.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta([y, x], [b, a]);
    }
    let front = a * x.ln() + b * y.ln() - (ln_gamma(a) + ln_gamma(b) - ln_gamma(a + b)) - a.ln();
    (front.exp() * fraction(x, a, b)).clamp(0.0, 1.0)
}

/// `1 / (1 + d_1 / (1 + d_2 / (1 + ...)))`, from the front by the ratios of consecutive numerators and denominators (Lentz's method).
fn fraction(x: f64, a: f64, b: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let away = |value: f64| if value == 0.0 { TINY } else { value };
    let (mut value, mut numerators, mut denominators) = (TINY, TINY, 0.0);
    for term in 0..TERMS {
        let m = (term / 2) as f64;
        let d = match term {
            0 => 1.0,
            _ if term % 2 == 0 => m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            _ => -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        };
        denominators = 1.0 / away(1.0 + d * denominators);
        numerators = away(1.0 + d / numerators);
        let ratio = numerators * denominators;
        value *= ratio;
        if (ratio - 1.0).abs() < CONVERGED {
            break;
        }
    }
    value
}

/// `ln Gamma(x)` for `x > 0`: Stirling's series (Abramowitz and Stegun, equation 6.1.41) from 12 on, where its first term left out is below 1e-16 of it, and the
/// recurrence down to `x`.
fn ln_gamma(x: f64) -> f64 {
    let (mut at, mut product) = (x, 1.0);
    while at < 12.0 {
        product *= at;
        at += 1.0;
    }
    let square = at * at;
    let series = (1.0 / 12.0
        - (1.0 / 360.0 - (1.0 / 1260.0 - (1.0 / 1680.0 - 1.0 / 1188.0 / square) / square) / square) / square)
        / at;
    (at - 0.5) * at.ln() - at + 0.5 * (2.0 * std::f64::consts::PI).ln() + series - f64::ln(product)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_degrees_have_a_closed_form() {
        // I_x(b, 1) = x^b, and of a numerator of two degrees the tail is (1 + 2 F / d)^(-d / 2).
        for below in [1.0, 2.0, 7.0, 40.5, 1e4] {
            for value in [1e-6, 0.3, 1.0, 2.5, 40.0] {
                let exact = (-0.5 * below * f64::ln_1p(2.0 * value / below)).exp();
                let tail = f_tail(value, [2.0, below]);
                assert!((tail / exact - 1.0).abs() < 1e-11, "{below} {value}: {tail} {exact}");
            }
        }
    }

    #[test]
    fn whole_halves_are_sums_of_binomial_probabilities() {
        // I_x(a, b) of whole a and b: at least a successes of a + b - 1.
        for (a, b) in [(1, 1), (2, 5), (9, 3), (20, 30)] {
            for value in [0.2, 0.9, 1.0, 1.7, 5.0] {
                let [above, below] = [2.0 * f64::from(b), 2.0 * f64::from(a)];
                let x = below / (below + above * value);
                let trials = a + b - 1;
                let choose = |k: i32| (0..k).map(|i| f64::from(trials - i) / f64::from(i + 1)).product::<f64>();
                let exact: f64 = (a..=trials).map(|k| choose(k) * x.powi(k) * (1.0 - x).powi(trials - k)).sum();
                let tail = f_tail(value, [above, below]);
                assert!((tail - exact).abs() < 1e-12 * exact.max(1e-3), "{a} {b} {value}: {tail} {exact}");
            }
        }
    }

    #[test]
    fn one_degree_is_students_t() {
        for freedom in [1usize, 3, 12, 150, 100_000] {
            let t = crate::student_t_95(freedom);
            assert!((f_tail(t * t, [1.0, freedom as f64]) - 0.05).abs() < 1e-7, "{freedom}");
        }
    }

    #[test]
    fn ends() {
        assert_eq!(f_tail(0.0, [3.0, 4.0]), 1.0);
        assert_eq!(f_tail(f64::INFINITY, [3.0, 4.0]), 0.0);
        assert!(f_tail(f64::NAN, [3.0, 4.0]).is_nan());
        // Far in the tail of many degrees: the numbers stay in range and fall.
        let far = [2.0, 4.0, 8.0].map(|value| f_tail(value, [136.0, 5e5]));
        assert!(far[0] > far[1] && far[1] > far[2] && far[2] >= 0.0, "{far:?}");
    }

    #[test]
    fn factorials() {
        let mut factorial = 1.0;
        for n in 1..30 {
            factorial *= f64::from(n);
            let (value, exact) = (ln_gamma(f64::from(n) + 1.0), f64::ln(factorial));
            assert!((value - exact).abs() < 1e-13 * exact.max(1.0), "{n}: {value} {exact}");
        }
        assert!((ln_gamma(0.5) - 0.5 * std::f64::consts::PI.ln()).abs() < 1e-14);
    }
}

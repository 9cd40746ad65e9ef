//! Savitzky-Golay filters: a polynomial through every window, and its derivative in the middle.

use crate::{
    SignalError,
    error::{check, check_finite},
};

/// Orthogonal (Gram) polynomials on -m..=m up to a degree, with their derivatives.
///
/// P. A. Gorry, "General least-squares smoothing and differentiation by the convolution (Savitzky-Golay) method", Analytical Chemistry 62, 1990.
struct Gram {
    m: usize,
    degree: usize,
}

impl Gram {
    /// The polynomials of all degrees at `t`, `derivative` times differentiated: equation (10) there.
    fn at(&self, t: f64, derivative: usize) -> Vec<f64> {
        let two_m = 2.0 * self.m as f64;
        let mut lower = vec![0.0; self.degree + 1];
        for s in 0..=derivative {
            let mut row = vec![0.0; self.degree + 1];
            row[0] = if s == 0 { 1.0 } else { 0.0 };
            for k in 1..=self.degree {
                let (of, order) = (k as f64, s as f64);
                let divisor = of * (two_m - of + 1.0);
                let before = if k > 1 { row[k - 2] } else { 0.0 };
                row[k] = (4.0 * of - 2.0) / divisor * (t * row[k - 1] + order * lower[k - 1])
                    - (of - 1.0) * (two_m + of) / divisor * before;
            }
            lower = row;
        }
        lower
    }

    /// The norm of every degree: (2k + 1) (2m)^(k) / (2m + k + 1)^(k + 1), x^(k) the falling factorial.
    fn scales(&self) -> Vec<f64> {
        let falling = |x: usize, k: usize| (0..k).map(|i| (x - i) as f64).product::<f64>();
        let scale = |k: usize| (2 * k + 1) as f64 * falling(2 * self.m, k) / falling(2 * self.m + k + 1, k + 1);
        (0..=self.degree).map(scale).collect()
    }

    /// Weights of the rows of a window in the derivative at `t`, rows from the middle.
    fn weights(&self, t: f64, derivative: usize) -> Vec<f64> {
        let scaled: Vec<f64> = self.at(t, derivative).iter().zip(self.scales()).map(|(p, scale)| p * scale).collect();
        let weight = |i: usize| {
            let row = i as f64 - self.m as f64;
            self.at(row, 0).iter().zip(&scaled).map(|(p, s)| p * s).sum()
        };
        (0..=2 * self.m).map(weight).collect()
    }
}

/// The `derivative`-th derivative of the polynomial of `degree` fitted to the `window` rows around each row; rows `dt` apart, derivatives per unit of it to its power.
///
/// The first and the last rows are those of the polynomials of the first and the last window (as `scipy.signal.savgol_filter` has them by default).
///
/// # Errors
/// A window that is even, not longer than the degree, or longer than the signal; a derivative above the degree; values that are not finite.
pub fn savitzky_golay(
    values: &[f64],
    dt: f64,
    window: usize,
    degree: usize,
    derivative: usize,
) -> Result<Vec<f64>, SignalError> {
    check(window % 2 == 1, "window", window as f64, "a window must have an odd number of rows")?;
    check(degree < window, "degree", degree as f64, "a degree must be less than the rows of the window")?;
    check(derivative <= degree, "derivative", derivative as f64, "a derivative above the degree is zero")?;
    check(dt > 0.0 && dt.is_finite(), "dt", dt, "a period must be positive and finite")?;
    check_finite(values)?;
    if values.len() < window {
        return Err(SignalError::TooShort { what: "the window", rows: values.len(), needed: window - 1 });
    }
    let gram = Gram { m: window / 2, degree };
    let unit = dt.powi(derivative as i32);
    let dot = |weights: &[f64], rows: &[f64]| weights.iter().zip(rows).map(|(w, y)| w * y).sum::<f64>() / unit;
    let (m, n) = (window / 2, values.len());
    let edge = |row: usize, first: usize| {
        dot(&gram.weights(row as f64 - (first + m) as f64, derivative), &values[first..first + window])
    };
    let middle = gram.weights(0.0, derivative);
    let inner = values.windows(window).map(|rows| dot(&middle, rows));
    let start = (0..m).map(|row| edge(row, 0));
    let end = (n - m..n).map(|row| edge(row, n - window));
    Ok(start.chain(inner).chain(end).collect())
}

//! The metric in which a stable map contracts.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, MatRef};

/// The largest absolute value of an eigenvalue of M (n x n); NaN where they cannot be found.
pub fn spectral_radius(M: MatRef<'_, f64>) -> f64 {
    if M.nrows() == 0 {
        return 0.0;
    }
    let finite = (0..M.ncols()).all(|j| (0..M.nrows()).all(|i| M[(i, j)].is_finite()));
    match finite.then(|| M.eigenvalues()) {
        Some(Ok(values)) => values.iter().map(|value| value.re.hypot(value.im)).fold(0.0, f64::max),
        _ => f64::NAN,
    }
}

/// Doublings: after so many the powers that are left out are beyond the 10^15th.
const DOUBLINGS: usize = 50;

/// The solution P of `P - M' P M = W` (n x n, W symmetric and positive definite), by doubling: `P = sum_k (M')^k W M^k` in pairs, fours, eights
/// (Smith 1968). `None` where M has an eigenvalue of absolute value 1 or more.
///
/// For `|x|_P^2 = x' P x` then `|M x|_P < |x|_P`.
pub fn lyapunov(M: MatRef<'_, f64>, W: MatRef<'_, f64>) -> Option<Mat<f64>> {
    let (mut P, mut power) = (W.to_owned(), M.to_owned());
    for _ in 0..DOUBLINGS {
        let more = power.transpose() * &P * &power;
        let (size, change) = (P.norm_max(), more.norm_max());
        if !(size.is_finite() && change.is_finite()) {
            return None;
        }
        P += more;
        if change <= 1e-3 * f64::EPSILON * size {
            return Some(Mat::from_fn(P.nrows(), P.ncols(), |i, j| 0.5 * (P[(i, j)] + P[(j, i)])));
        }
        power = &power * &power;
    }
    None
}

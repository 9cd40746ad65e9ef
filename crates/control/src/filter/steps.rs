//! The steps of a region, with their noise.

use faer::{Mat, MatRef};

use super::step_noise::StepNoise;
use crate::{
    linear::{exponential, norm, symmetric},
    pieces::Affine,
};

/// A step `x+ = A x + B u + c + S rho + w`, rho the whitened residuals that are correlated with those before, w white
/// of covariance Q. Matrices by rows.
#[derive(Debug, Clone, PartialEq)]
pub struct StepMap {
    /// n x n.
    pub a: Vec<f64>,
    /// n x m.
    pub b: Vec<f64>,
    /// n.
    pub c: Vec<f64>,
    /// n x n.
    pub q: Vec<f64>,
    /// n x q; empty where all noise is white.
    pub s: Vec<f64>,
}

impl StepMap {
    /// A discrete step with the covariance of its noise.
    pub(super) fn discrete(step: &Affine, noise: &StepNoise) -> Self {
        Self {
            a: by_rows(step.a.as_ref()),
            b: by_rows(step.b.as_ref()),
            c: step.c.clone(),
            q: by_rows(noise.white.as_ref()),
            s: by_rows(noise.shape.as_ref()),
        }
    }

    /// Derivatives over `seconds` with inputs and residuals held, driven by white noise of this spectral density.
    pub(super) fn continuous(rates: &Affine, noise: &StepNoise, seconds: f64) -> Self {
        let white = noise_over(rates.a.as_ref(), &noise.white, seconds);
        let (n, m, q) = (rates.c.len(), rates.b.ncols(), noise.shape.ncols());
        let both = Mat::from_fn(n, m + q, |i, j| if j < m { rates.b[(i, j)] } else { noise.shape[(i, j - m)] });
        let held = Affine { a: rates.a.clone(), b: both, c: rates.c.clone() }.held(seconds);
        let part = |columns: std::ops::Range<usize>| held.b.subcols(columns.start, columns.len()).to_owned();
        let (b, shape) = (part(0..m), part(m..m + q));
        Self::discrete(&Affine { a: held.a, b, c: held.c }, &StepNoise { white, shape })
    }
}

fn by_rows(a: MatRef<'_, f64>) -> Vec<f64> {
    (0..a.nrows()).flat_map(|i| (0..a.ncols()).map(move |j| a[(i, j)])).collect()
}

/// Covariance that white noise of a spectral density S adds over `seconds`: the integral of `e^(A t) S e^(A' t)`. It
/// comes from the exponential of `[-A S; 0 A']` (Van Loan, "Computing integrals involving the matrix exponential", IEEE
/// Trans. Automatic Control 23, 1978). The exponential is over a part of the time in which it is well-conditioned, and
/// is doubled as often as needed: fast decays would overflow it.
fn noise_over(a: MatRef<'_, f64>, density: &Mat<f64>, seconds: f64) -> Mat<f64> {
    let n = a.nrows();
    let length = norm(a) * seconds;
    let doublings = if length > 1.0 && length.is_finite() { length.log2().ceil() as i32 } else { 0 };
    let part = seconds / 2f64.powi(doublings);
    let generator = Mat::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
        (true, true) => -part * a[(i, j)],
        (true, false) => part * density[(i, j - n)],
        (false, true) => 0.0,
        (false, false) => part * a[(j - n, i - n)],
    });
    let all = exponential(generator.as_ref());
    let mut power = Mat::from_fn(n, n, |i, j| all[(n + j, n + i)]);
    let mut noise = symmetric(&(&power * Mat::from_fn(n, n, |i, j| all[(i, n + j)])));
    for _ in 0..doublings {
        noise = symmetric(&(&noise + &power * &noise * power.transpose()));
        power = &power * &power;
    }
    noise
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrated_noise_matches_closed_forms() {
        // A double integrator pushed by noise: h^3/3, h^2/2, h.
        let (h, s) = (0.3f64, 2.0);
        let a = Mat::from_fn(2, 2, |i, j| f64::from(u8::from(i == 0 && j == 1)));
        let density = Mat::from_fn(2, 2, |i, j| if i == 1 && j == 1 { s } else { 0.0 });
        let noise = noise_over(a.as_ref(), &density, h);
        for (i, j, value) in
            [(0, 0, s * h.powi(3) / 3.0), (0, 1, s * h * h / 2.0), (1, 0, s * h * h / 2.0), (1, 1, s * h)]
        {
            assert!((noise[(i, j)] - value).abs() < 1e-14, "{i} {j}: {}", noise[(i, j)]);
        }
        // A decay a thousand times faster than the step forgets all but s / (2 a).
        let a = Mat::from_fn(1, 1, |_, _| -1e4);
        let noise = noise_over(a.as_ref(), &Mat::from_fn(1, 1, |_, _| s), 0.1)[(0, 0)];
        assert!((noise / (s / 2e4) - 1.0).abs() < 1e-12, "{noise:e}");
    }
}

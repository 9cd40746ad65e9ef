//! The exact minimiser of one group, the others fixed: an eigenvalue decomposition once, and the root of a secular equation.

use faer::{Mat, Side};

use crate::kernel::norm;

/// Steps of the secular equation's Newton iteration, at most: it converges monotonically, and quadratically at the end.
const MOST_STEPS: usize = 100;

/// `H = Q diag(d) Q'` of a group's Gram block.
#[derive(Debug, Clone)]
pub(super) struct Spectrum {
    /// Not negative; rounding is zero.
    values: Vec<f64>,
    vectors: Mat<f64>,
}

impl Spectrum {
    /// Of a symmetric positive semidefinite matrix; `None` when it is not finite.
    pub(super) fn of(matrix: &Mat<f64>) -> Option<Self> {
        let eigen = matrix.self_adjoint_eigen(Side::Lower).ok()?;
        let k = matrix.nrows();
        let largest = (0..k).map(|i| eigen.S()[i]).fold(0.0, f64::max);
        let rounding = 4.0 * f64::EPSILON * k as f64 * largest;
        let value = |i: usize| if eigen.S()[i] > rounding { eigen.S()[i] } else { 0.0 };
        Some(Self { values: (0..k).map(value).collect(), vectors: eigen.U().to_owned() })
    }

    /// The largest eigenvalue: the curvature that a proximal step may trust.
    pub(super) fn largest(&self) -> f64 {
        self.values.iter().copied().fold(0.0, f64::max)
    }

    /// The minimiser of `1/2 v'Hv - q'v + group |v|`, group > 0.
    ///
    /// At v of length t, `v_i = q_i / (d_i + group/t)` in the basis of eigenvectors, so that t is the root of `1 / |q_i / (d_i t + group)| = 1`, whose left
    /// side is concave and increasing: Newton's iteration from the left never oversteps (as in the trust region problem, Moré and Sorensen 1983).
    /// `start` is a guess of t.
    pub(super) fn minimise(&self, q: &[f64], group: f64, start: f64) -> Vec<f64> {
        let k = q.len();
        if norm(q.iter().copied()) <= group {
            return vec![0.0; k];
        }
        // A direction without curvature has no part of q but rounding.
        let along = |i: usize| {
            let dot = (0..k).map(|j| self.vectors[(j, i)] * q[j]).sum::<f64>();
            if self.values[i] > 0.0 { dot } else { 0.0 }
        };
        let along: Vec<f64> = (0..k).map(along).collect();
        if norm(along.iter().copied()) <= group {
            return vec![0.0; k];
        }
        let mut t = start.max(0.0);
        for _ in 0..MOST_STEPS {
            let (mut square, mut slope) = (0.0, 0.0);
            for (q, d) in along.iter().zip(&self.values) {
                let below = d * t + group;
                let share = (q / below).powi(2);
                square += share;
                slope += share * d / below;
            }
            // psi = square^(-1/2), psi' = square^(-3/2) slope.
            let next = (t + (square.sqrt() - 1.0) * square / slope).max(0.0);
            let done = (next - t).abs() <= 2.0 * f64::EPSILON * next;
            t = next;
            if done {
                break;
            }
        }
        let weight = |i: usize| along[i] * t / (self.values[i] * t + group);
        let weights: Vec<f64> = (0..k).map(weight).collect();
        (0..k).map(|j| (0..k).map(|i| self.vectors[(j, i)] * weights[i]).sum()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gram matrix of k columns in m rows, and a vector of its range.
    fn problem(k: usize, m: usize, seed: usize) -> (Mat<f64>, Vec<f64>) {
        let x = Mat::from_fn(m, k, |i, j| (1.7 * (i * k + j + 13 * seed) as f64).sin());
        let y = Mat::from_fn(m, 1, |i, _| (0.9 * (i + seed) as f64).cos());
        let q = x.transpose() * &y;
        (x.transpose() * &x, (0..k).map(|j| q[(j, 0)]).collect())
    }

    #[test]
    fn gradient_at_minimiser_matches_norm() {
        let mut checked = 0;
        for (k, m) in [(1, 4), (3, 9), (5, 5), (6, 2)] {
            for seed in 0..8 {
                let (h, q) = problem(k, m, seed);
                let spectrum = Spectrum::of(&h).unwrap();
                let length = norm(q.iter().copied());
                for share in [1e-6, 1e-2, 0.3, 0.9, 1.0, 1.1] {
                    let group = share * length;
                    for start in [0.0, 0.1, 50.0] {
                        let v = spectrum.minimise(&q, group, start);
                        let size = norm(v.iter().copied());
                        assert_eq!(size == 0.0, share >= 1.0);
                        for j in (0..k).filter(|_| size > 0.0) {
                            let fitted: f64 = (0..k).map(|i| h[(j, i)] * v[i]).sum();
                            let left = fitted + group * v[j] / size - q[j];
                            assert!(left.abs() < 1e-12 * length, "{k} {m} {share} {start}: {left:e}");
                        }
                        checked += 1;
                    }
                }
            }
        }
        assert_eq!(checked, 576);
    }
}

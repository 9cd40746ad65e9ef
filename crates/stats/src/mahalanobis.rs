//! The Mahalanobis score, equation (10) of Buchan, Haldane, Fearing, "Automatic Identification of Dynamic Piecewise Affine Models for a
//! Running Robot": `sqrt(e' S^-1 e)` of an error e under the covariance S of observations.

use faer::{Mat, Side};
use fleetfoot_data::packed;

use crate::kernel::{affine, padded};

/// Smallest eigenvalue of a standardised covariance that is taken at its word, relative to a variance of 1.
///
/// A direction in which the observations did not vary would make every deviation infinitely far; with this floor a deviation of
/// 3e-5 standard deviations counts as one. It is noticed, and rounding (1e-15) is not.
const EIGENVALUE_FLOOR: f64 = 1e-9;

/// The metric of a covariance matrix, regularised where that is singular.
#[derive(Debug, Clone)]
pub struct Mahalanobis {
    dimension: usize,
    width: usize,
    /// Column j of the whitening matrix W (S^-1 = W'W) in row j, padded.
    whitening: Vec<f64>,
    zeros: Vec<f64>,
}

impl Mahalanobis {
    /// The metric of a covariance (packed lower triangle by rows, `scale.len()` dimensions).
    ///
    /// `scale` are positive units in which the floor on the eigenvalues applies, usually standard deviations; an entry that is not a
    /// positive number counts as 1. Entries of the covariance that are not finite count as no covariance.
    pub fn new(covariance: &[f64], scale: &[f64]) -> Self {
        let n = scale.len();
        let width = padded(n);
        let unit: Vec<f64> = scale.iter().map(|&s| if s.is_finite() && s > 0.0 { s } else { 1.0 }).collect();
        let standardised = Mat::from_fn(n, n, |i, j| {
            let value = covariance.get(packed(i, j)).copied().unwrap_or(0.0) / (unit[i] * unit[j]);
            if value.is_finite() { value } else { 0.0 }
        });
        let mut whitening = vec![0.0; n * width];
        // The decomposition refuses to measure its memory for no dimensions at all: a model without regressors has none.
        if n == 0 {
            return Self { dimension: 0, width, whitening, zeros: vec![0.0; width] };
        }
        match standardised.self_adjoint_eigen(Side::Lower) {
            Ok(eigen) => {
                for k in 0..n {
                    let root = eigen.S()[k].max(EIGENVALUE_FLOOR).sqrt();
                    for j in 0..n {
                        whitening[j * width + k] = eigen.U()[(j, k)] / (root * unit[j]);
                    }
                }
            }
            // Without a decomposition (it needs absurd values) the axes are taken one by one.
            Err(_) => {
                for j in 0..n {
                    whitening[j * width + j] = 1.0 / (standardised[(j, j)].max(EIGENVALUE_FLOOR).sqrt() * unit[j]);
                }
            }
        }
        Self { dimension: n, width, whitening, zeros: vec![0.0; width] }
    }

    /// The metric of a covariance in units of its own standard deviations.
    pub fn of_covariance(covariance: &[f64], dimension: usize) -> Self {
        let scale: Vec<f64> = (0..dimension).map(|i| covariance.get(packed(i, i)).map_or(1.0, |v| v.sqrt())).collect();
        Self::new(covariance, &scale)
    }

    /// The whitening matrix W, `S^-1 = W'W`: column j at `j * width`, padded with zeros.
    pub fn whitening(&self) -> &[f64] {
        &self.whitening
    }

    /// Number of dimensions.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// The score of an error vector.
    pub fn score(&self, error: &[f64]) -> f64 {
        let mut scratch = vec![0.0; self.width];
        self.score_with(error, &mut scratch)
    }

    /// Length of the scratch memory of [`Self::score_with`].
    pub fn width(&self) -> usize {
        self.width
    }

    /// [`Self::score`] with scratch memory of [`Self::width`] values, inlined into the kernels of rows.
    #[inline(always)]
    pub fn score_with(&self, error: &[f64], scratch: &mut [f64]) -> f64 {
        let scratch = &mut scratch[..self.width];
        affine(&self.whitening, &self.zeros, &error[..self.dimension], scratch);
        scratch.iter().fold(0.0, |sum, &w| w.mul_add(w, sum)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_dimensions_no_distance() {
        let metric = Mahalanobis::new(&[], &[]);
        assert_eq!((metric.dimension(), metric.score(&[])), (0, 0.0));
    }

    #[test]
    fn two_dimensions_by_hand() {
        // S = [[4, 1], [1, 1]], S^-1 = [[1, -1], [-1, 4]] / 3.
        let metric = Mahalanobis::of_covariance(&[4.0, 1.0, 1.0], 2);
        let (a, b) = (0.3, -1.7);
        let expected = ((a * a - 2.0 * a * b + 4.0 * b * b) / 3.0f64).sqrt();
        assert!((metric.score(&[a, b]) - expected).abs() < 1e-13 * expected);
        assert_eq!(metric.score(&[0.0, 0.0]), 0.0);
    }

    #[test]
    fn one_dimensional_score_is_the_standardised_error() {
        let metric = Mahalanobis::of_covariance(&[1e-18], 1);
        assert!((metric.score(&[3e-9]) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn singular_covariances_are_finite_and_notice_the_forbidden_direction() {
        // x2 = x1 in all observations.
        let metric = Mahalanobis::of_covariance(&[1.0, 1.0, 1.0], 2);
        let along = metric.score(&[1.0, 1.0]);
        assert!((along - 1.0).abs() < 1e-6, "{along}");
        let across = metric.score(&[1e-3, -1e-3]);
        assert!(across.is_finite() && across > 10.0, "{across}");
        // Nothing ever varied.
        let constant = Mahalanobis::of_covariance(&[0.0], 1);
        assert!(constant.score(&[0.1]).is_finite());
        let missing = Mahalanobis::of_covariance(&[f64::NAN, f64::NAN, 1.0], 2);
        assert!(missing.score(&[0.0, 2.0]).is_finite());
    }
}

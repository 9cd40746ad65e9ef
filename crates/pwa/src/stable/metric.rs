//! The metric in which all regions contract.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::Mat;

use super::{inverse, largest};

/// `|x| = |T x|_2`.
#[derive(Debug, Clone)]
pub(crate) struct Metric {
    /// T (n x n).
    pub(crate) root: Mat<f64>,
    /// Its inverse.
    pub(crate) inverse: Mat<f64>,
    /// Coefficients of the loop's functions (s x q) whose map contracts, for where a region begins.
    pub(crate) start: Mat<f64>,
}

impl Metric {
    pub(crate) fn new(root: Mat<f64>, start: &Mat<f64>) -> Self {
        Self { inverse: inverse(&root), root, start: start.clone() }
    }

    /// P.
    pub(crate) fn matrix(&self) -> Mat<f64> {
        self.root.transpose() * &self.root
    }

    /// The norm of a map.
    pub(crate) fn norm(&self, M: &Mat<f64>) -> f64 {
        largest(&(&self.root * M * &self.inverse))
    }
}

//! The metric in which all regions contract.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};

use super::{Loop, inverse, largest};

/// `|x| = |T x|_2`.
#[derive(Debug, Clone)]
pub(crate) struct Metric {
    /// T (n x n).
    pub(crate) root: Mat<f64>,
    /// Its inverse.
    pub(crate) inverse: Mat<f64>,
    /// Coefficients of the loop's functions (s x q) whose map contracts, for where a region begins.
    pub(crate) start: Mat<f64>,
    /// Supply through the ports, if there are any.
    pub(crate) supply: Option<Supply>,
}

/// S of a passive loop in the coordinates T x, `S = L L'`.
#[derive(Debug, Clone)]
pub(crate) struct Supply {
    /// C T^-1 (m x n).
    pub(crate) gamma: Mat<f64>,
    /// L (n + m x n + m).
    pub(crate) lower: Mat<f64>,
    /// L^-T.
    pub(crate) weight: Mat<f64>,
}

impl Metric {
    /// `None` where ports have more coming in than such a storage can take.
    pub(crate) fn new(state_loop: &Loop, root: Mat<f64>, start: &Mat<f64>) -> Option<Self> {
        let inverse = inverse(&root);
        let supply = match &state_loop.ports {
            None => None,
            Some(ports) => {
                let gamma = ports.output(root.nrows()) * &inverse;
                let lower = ports.supply(&gamma, state_loop.bound).llt(Side::Lower).ok()?.L().to_owned();
                let weight = super::inverse(&lower.transpose().to_owned());
                Some(Supply { gamma, lower, weight })
            }
        };
        Some(Self { inverse, root, start: start.clone(), supply })
    }

    /// P.
    pub(crate) fn matrix(&self) -> Mat<f64> {
        self.root.transpose() * &self.root
    }

    /// The norm of a map.
    pub(crate) fn norm(&self, M: &Mat<f64>) -> f64 {
        let n = self.root.nrows();
        largest(&(&self.root * M.subcols(0, n) * &self.inverse))
    }

    /// Bounded quantity, and its bound: the map's norm, or that of `T [M N] L^-T` in a passive loop.
    pub(crate) fn measure(&self, state_loop: &Loop, M: &Mat<f64>) -> (f64, f64) {
        match self.supply {
            None => (self.norm(M), state_loop.bound),
            Some(_) => (largest(&self.seen(M)), 1.0),
        }
    }

    /// A map in the coordinates of the metric: `T M T^-1`. Of a passive loop it is `T [M N] L^-T` with rows of zeros
    /// that make it square.
    pub(crate) fn seen(&self, M: &Mat<f64>) -> Mat<f64> {
        match &self.supply {
            None => &self.root * M * &self.inverse,
            Some(_) => {
                let moved = &self.root * self.behind(M);
                Mat::from_fn(M.ncols(), M.ncols(), |i, j| if i < moved.nrows() { moved[(i, j)] } else { 0.0 })
            }
        }
    }

    /// Columns by variables and inputs, behind the coordinates: `A T^-1`, of a passive loop `[A_x T^-1, A_u] L^-T`.
    pub(crate) fn behind(&self, A: &Mat<f64>) -> Mat<f64> {
        let Some(supply) = &self.supply else { return A * &self.inverse };
        let n = self.root.nrows();
        let states = A.subcols(0, n) * &self.inverse;
        let all = Mat::from_fn(A.nrows(), A.ncols(), |i, j| if j < n { states[(i, j)] } else { A[(i, j)] });
        &all * &supply.weight
    }
}

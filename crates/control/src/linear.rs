//! Small dense linear systems: the exponential of a matrix, Riccati's equation, modes that nothing reaches.

mod exponential;
mod modes;
mod riccati;

pub use exponential::exponential;
pub use modes::{Mode, spectral_radius, unreached_modes};
pub use riccati::{Riccati, riccati};

use faer::{Mat, MatRef};

/// The largest absolute row sum.
pub(crate) fn norm(a: MatRef<'_, f64>) -> f64 {
    (0..a.nrows()).map(|i| (0..a.ncols()).map(|j| a[(i, j)].abs()).sum::<f64>()).fold(0.0, f64::max)
}

/// Returns true if every entry is finite.
pub(crate) fn is_finite(a: MatRef<'_, f64>) -> bool {
    (0..a.ncols()).all(|j| (0..a.nrows()).all(|i| a[(i, j)].is_finite()))
}

/// `(A + A') / 2`.
pub(crate) fn symmetric(a: &Mat<f64>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| 0.5 * (a[(i, j)] + a[(j, i)]))
}

/// The matrix of these rows, one after the other.
pub(crate) fn of_rows(rows: usize, columns: usize, values: &[f64]) -> Mat<f64> {
    Mat::from_fn(rows, columns, |i, j| values[i * columns + j])
}

/// `A x`.
pub(crate) fn times(a: MatRef<'_, f64>, x: &[f64]) -> Vec<f64> {
    (0..a.nrows()).map(|i| x.iter().enumerate().map(|(j, x)| a[(i, j)] * x).sum()).collect()
}

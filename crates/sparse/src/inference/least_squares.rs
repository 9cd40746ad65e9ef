//! Least squares on a support, priors included, by a column-pivoted QR of the compressed rows.

use faer::Mat;

use super::InferenceError;
use crate::{kernel::norm, quadratic::Form, structured::Assembled};

/// Least remainder of a column beyond the others, relative to its length, for an identified coefficient: errors of the
/// rows are divided by it.
pub(super) const IDENTIFIED: f64 = 1e-9;

/// A factored support. Columns are in units of their length over the rows, `unit`.
pub(super) struct SupportFactor {
    /// Place in the support of every column of R.
    pub(super) order: Vec<usize>,
    /// R (k x k), pivots descending.
    pub(super) r: Mat<f64>,
    /// Q'z, in the units of the target's length.
    z: Vec<f64>,
    /// `theta_j = (what R and z give)_j size / unit_j`.
    pub(super) unit: Vec<f64>,
    size: f64,
}

impl SupportFactor {
    pub(super) fn new(assembled: &Assembled, support: &[usize]) -> Result<Self, InferenceError> {
        let (problem, k) = (&assembled.problem, support.len());
        if let Some(&column) = support.iter().find(|&&column| column >= problem.columns()) {
            return Err(InferenceError::NoSuchCoefficient { column, columns: problem.columns() });
        }
        let (a, z) = rows(assembled, support);
        let qr = a.col_piv_qr();
        let q = qr.compute_thin_Q();
        let order = qr.P().arrays().0.to_vec();
        let r = qr.thin_R().to_owned();
        let z = (0..k).map(|i| q.col_as_slice(i).iter().zip(&z).map(|(q, z)| q * z).sum()).collect();
        let unit =
            support.iter().map(|&j| if problem.length[j] > 0.0 { problem.length[j] * assembled.scale[j] } else { 1.0 });
        Ok(Self { order, r, z, unit: unit.collect(), size: problem.target_length() })
    }

    /// Columns whose remainder beyond those before them, relative to their length, is above `limit`: the first `rank` of the order.
    pub(super) fn rank(&self, limit: f64) -> usize {
        (0..self.order.len()).take_while(|&i| self.r[(i, i)].abs() > limit).count()
    }

    /// The factor, when its support is identified.
    pub(super) fn identified(self, support: &[usize]) -> Result<Self, InferenceError> {
        let rank = self.rank(IDENTIFIED);
        if rank < support.len() {
            let mut columns: Vec<usize> = self.order[rank..].iter().map(|&place| support[place]).collect();
            columns.sort_unstable();
            return Err(InferenceError::NotIdentified { columns });
        }
        Ok(self)
    }

    /// Coefficients of the support (k), raw units.
    pub(super) fn coefficients(&self) -> Vec<f64> {
        let mut x = self.z.clone();
        self.solve(&mut x);
        let mut theta = vec![0.0; x.len()];
        for (i, &place) in self.order.iter().enumerate() {
            theta[place] = x[i] * self.size / self.unit[place];
        }
        theta
    }

    /// `x <- R^-1 x`.
    fn solve(&self, x: &mut [f64]) {
        for i in (0..x.len()).rev() {
            let known: f64 = (i + 1..x.len()).map(|j| self.r[(i, j)] * x[j]).sum();
            x[i] = (x[i] - known) / self.r[(i, i)];
        }
    }

    /// `x <- R^-T x`.
    fn solve_transposed(&self, x: &mut [f64]) {
        for i in 0..x.len() {
            let known: f64 = (0..i).map(|j| self.r[(j, i)] * x[j]).sum();
            x[i] = (x[i] - known) / self.r[(i, i)];
        }
    }

    /// `H^-1 u` for a gradient u (k, raw units), H = B'B with weights and priors: raw units of the coefficients.
    pub(super) fn inverse_times(&self, gradient: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = self.order.iter().map(|&place| gradient[place] / self.unit[place]).collect();
        self.solve_transposed(&mut x);
        self.solve(&mut x);
        let mut result = vec![0.0; x.len()];
        self.order.iter().zip(&x).for_each(|(&place, x)| result[place] = x / self.unit[place]);
        result
    }

    /// `|B delta|^2` for a change of the coefficients (k, raw units).
    pub(super) fn squared_effect(&self, delta: &[f64]) -> f64 {
        let x: Vec<f64> = self.order.iter().map(|&place| delta[place] * self.unit[place]).collect();
        (0..x.len()).map(|i| (i..x.len()).map(|j| self.r[(i, j)] * x[j]).sum::<f64>().powi(2)).sum()
    }

    /// Diagonal of `(A'A)^-1` for the columns of unit length (k).
    pub(super) fn inverse_diagonal(&self) -> Vec<f64> {
        let k = self.order.len();
        let mut diagonal = vec![0.0; k];
        for (i, &place) in self.order.iter().enumerate() {
            let mut x = vec![0.0; k];
            x[i] = 1.0;
            self.solve_transposed(&mut x);
            diagonal[place] = norm(x.iter().copied()).powi(2);
        }
        diagonal
    }
}

/// The columns of the support with unit length (at least as many rows as columns) and the target.
fn rows(assembled: &Assembled, support: &[usize]) -> (Mat<f64>, Vec<f64>) {
    let k = support.len();
    match &assembled.problem.form {
        Form::Root { a, z, .. } => {
            let m = a.rows().max(k);
            let inside = |i: usize| i < a.rows();
            let rows = Mat::from_fn(m, k, |i, place| if inside(i) { a.column(support[place])[i] } else { 0.0 });
            (rows, (0..m).map(|i| if inside(i) { z[i] } else { 0.0 }).collect())
        }
        Form::Gram { g, c } => {
            let matrix = Mat::from_fn(k, k, |i, j| g.column(support[j])[support[i]]);
            let target: Vec<f64> = support.iter().map(|&j| c[j]).collect();
            symmetric_root(&matrix, &target)
        }
    }
}

/// A and z with `A'A` the matrix and `A'z` the target's products, as far as rounding lets the matrix have a root.
fn symmetric_root(matrix: &Mat<f64>, target: &[f64]) -> (Mat<f64>, Vec<f64>) {
    let k = target.len();
    let Ok(eigen) = matrix.self_adjoint_eigen(faer::Side::Lower) else {
        return (Mat::zeros(k, k), vec![0.0; k]);
    };
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    let floor = 8.0 * f64::EPSILON * (k + 1) as f64;
    let root = |i: usize| if values[i] > floor { values[i].sqrt() } else { 0.0 };
    let product = |i: usize| (0..k).map(|j| vectors[(j, i)] * target[j]).sum::<f64>();
    let z = (0..k).map(|i| if root(i) > 0.0 { product(i) / root(i) } else { 0.0 }).collect();
    (Mat::from_fn(k, k, |i, j| root(i) * vectors[(j, i)]), z)
}

/// The least-squares coefficients (p; zero outside the support) of an assembled problem on a support, its priors included and its penalty not.
///
/// # Errors
/// When the support names a coefficient that does not exist, or holds coefficients that the rows and priors do not tell apart (remainder of a column
/// beyond the others below 1e-9 of its length).
pub fn least_squares_on(assembled: &Assembled, support: &[usize]) -> Result<Vec<f64>, InferenceError> {
    let coefficients = SupportFactor::new(assembled, support)?.identified(support)?.coefficients();
    let mut theta = vec![0.0; assembled.scale.len()];
    support.iter().zip(&coefficients).for_each(|(&j, &value)| theta[j] = value);
    Ok(theta)
}

//! The square-root form of a least-squares problem: an R factor with Q'y ("compressed data").

use std::ops::Range;

use faer::{Accum, Mat, MatMut, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::packed_row;

use crate::{
    householder::fold_rows,
    kernel::{COLUMNS_AT_ONCE, MANY_COLUMNS, Slab, norm},
};

/// Rounding of a column of an R factor of p columns, relative to the size of the numbers it was made from.
///
/// The bound for Householder QR is of the order `n p eps`; errors that behave like a random walk stay near `sqrt(p) eps`. The factor
/// 16 is the margin between the two in practice; it leaves condition numbers up to `1e13 / sqrt(p)` standing.
pub(crate) fn noise_level(p: usize) -> f64 {
    16.0 * f64::EPSILON * ((p + 1) as f64).sqrt()
}

/// Centred square-root form of a weighted least-squares problem with regressors x (p), targets y (q) and a free intercept:
/// for coefficients beta (p) of one target, with the best intercept,
/// `rss = |R beta - z|^2 + residual`.
#[derive(Debug, Clone, PartialEq)]
pub struct SquareRoot {
    /// Rows of positive weight.
    pub rows: u64,
    /// Sum of the weights.
    pub weight: f64,
    /// Weighted mean of every regressor (p).
    pub mean_x: Vec<f64>,
    /// Weighted mean of every target (q).
    pub mean_y: Vec<f64>,
    /// R, upper triangular (p x p), raw units: `R'R` is the centred scatter of x.
    pub r: Mat<f64>,
    /// Q'y (p x q).
    pub z: Mat<f64>,
    /// Squared norm of what no x explains (q).
    pub residual: Vec<f64>,
    /// Centred sum of squares of y (q).
    pub total: Vec<f64>,
    /// Condition number of the Gram matrix that this came from, in preconditioned coordinates and with unit diagonal; 1 when the factor
    /// came from the rows. The coefficients lose about `log10(condition)` digits to it, beyond what Householder QR loses.
    pub condition: f64,
    /// Relative rounding level: column j of `r` is known to `noise * magnitude[j]`, and what is shorter is no information.
    pub noise: f64,
    /// Size of the numbers that made column j of `r` (p): its own length, its mean, and the terms that cancelled on the way.
    pub magnitude: Vec<f64>,
}

/// Values of any length: those of [`crate::kernel::add_scaled`] are padded.
pub(crate) fn add_scaled(target: &mut [f64], values: &[f64], factor: f64) {
    target.iter_mut().zip(values).for_each(|(target, value)| *target += factor * value);
}

impl SquareRoot {
    /// From a factor `[R z]` (p x (p + q)).
    pub(crate) fn assemble(
        (rows, weight): (u64, f64),
        (mean_x, mean_y): (Vec<f64>, Vec<f64>),
        mut factor: Mat<f64>,
        residual: Vec<f64>,
        condition: f64,
        noise: f64,
        magnitude: Vec<f64>,
    ) -> Self {
        let p = mean_x.len();
        let z = Mat::from_fn(p, mean_y.len(), |i, t| factor[(i, p + t)]);
        factor.truncate(p, p);
        let r = factor;
        let total = residual.iter().enumerate().map(|(t, left)| sum_of_squares(z.col_as_slice(t)) + left).collect();
        Self { rows, weight, mean_x, mean_y, r, z, residual, total, condition, noise, magnitude }
    }

    /// Number of regressors, p.
    pub fn regressors(&self) -> usize {
        self.mean_x.len()
    }

    /// Number of targets, q.
    pub fn targets(&self) -> usize {
        self.mean_y.len()
    }

    /// Standard deviation of every regressor over these rows (divisor: the weight); what [`crate::least_squares`] may take as its units
    /// once zeros are replaced.
    pub fn deviation(&self) -> Vec<f64> {
        let divisor = if self.weight > 0.0 { self.weight.sqrt() } else { 1.0 };
        (0..self.regressors()).map(|j| norm(&self.r.col_as_slice(j)[..=j]) / divisor).collect()
    }

    /// `R'R`, the centred scatter of some neighbouring regressors: the lower triangle packed, row after row.
    ///
    /// # Panics
    /// When a regressor does not exist.
    pub fn scatter(&self, columns: Range<usize>) -> Vec<f64> {
        let count = columns.len();
        let mut scatter = Vec::with_capacity(packed_row(count));
        if count < MANY_COLUMNS {
            for i in columns.clone() {
                for j in columns.start..=i {
                    scatter.push((0..=j).map(|k| self.r[(k, i)] * self.r[(k, j)]).sum());
                }
            }
            return scatter;
        }
        let r = self.r.as_ref().get(..columns.end, columns);
        let mut product = Slab::zeros(count, count);
        let stride = product.stride();
        product.fill_columns(COLUMNS_AT_ONCE, |first, values| {
            let width = values.len() / stride;
            let part = MatMut::from_column_major_slice_mut(values, stride, width).subrows_mut(0, count);
            matmul(part, Accum::Replace, r.transpose(), r.subcols(first, width), 1.0, Par::Seq);
            Vec::<()>::new()
        });
        (0..count).for_each(|i| scatter.extend_from_slice(&product.column(i)[..=i]));
        scatter
    }

    /// Length of rounding in every column of `r`: `noise * magnitude`, made positive.
    pub(crate) fn column_noise(&self) -> Vec<f64> {
        self.magnitude.iter().map(|magnitude| (self.noise * magnitude).max(f64::MIN_POSITIVE)).collect()
    }

    /// The weighted sum of squared errors, per target, that a model makes on these rows; it may have been fitted on any rows.
    ///
    /// `coefficients` is p x q in raw units, `intercept` has q entries. A sum of squares throughout, so it does not cancel:
    /// `|R beta - z|^2 + residual + weight (mean error)^2`.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn error(&self, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> Vec<f64> {
        let mut left = vec![0.0; self.regressors()];
        (0..self.targets())
            .map(|t| {
                let mean = self.left(coefficients, intercept, t, &mut left);
                sum_of_squares(&left) + self.residual[t] + self.weight * mean * mean
            })
            .collect()
    }

    /// The weighted sums of products of the errors of every two targets, as far as they depend on the model:
    /// `(R beta_t - z_t)'(R beta_u - z_u) + weight mean_t mean_u`. They are packed as a lower triangle by rows
    /// (`q (q + 1) / 2`).
    ///
    /// The part that no x explains is the same for all models (this form holds only its squares). The products of two
    /// models' errors therefore differ by the difference of these sums.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn error_products(&self, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> Vec<f64> {
        let (p, q) = (self.regressors(), self.targets());
        let mut left = Mat::zeros(p, q);
        let means: Vec<f64> = (0..q).map(|t| self.left(coefficients, intercept, t, left.col_as_slice_mut(t))).collect();
        let product = |t: usize, u: usize| {
            let pairs = left.col_as_slice(t).iter().zip(left.col_as_slice(u));
            pairs.map(|(a, b)| a * b).sum::<f64>() + self.weight * means[t] * means[u]
        };
        (0..q).flat_map(|t| (0..=t).map(move |u| (t, u))).map(|(t, u)| product(t, u)).collect()
    }

    /// `R beta - z` of one target, and the mean of its errors.
    fn left(&self, coefficients: MatRef<'_, f64>, intercept: &[f64], t: usize, left: &mut [f64]) -> f64 {
        let (p, q) = (self.regressors(), self.targets());
        assert_eq!((coefficients.nrows(), coefficients.ncols(), intercept.len()), (p, q, q), "p x q coefficients");
        left.iter_mut().zip(self.z.col_as_slice(t)).for_each(|(left, z)| *left = -z);
        let mut mean = self.mean_y[t] - intercept[t];
        for j in 0..p {
            let beta = coefficients[(j, t)];
            mean -= self.mean_x[j] * beta;
            add_scaled(&mut left[..=j], &self.r.col_as_slice(j)[..=j], beta);
        }
        mean
    }

    /// The problem with some of the regressors only, in the order given; what the others explained joins the residual.
    ///
    /// # Panics
    /// When a column does not exist.
    pub fn select(&self, columns: &[usize]) -> Self {
        let (k, q, p) = (columns.len(), self.targets(), self.regressors());
        let mut stack = Slab::zeros(p, k + q);
        for (to, &column) in columns.iter().enumerate() {
            stack.column_mut(to)[..p].copy_from_slice(self.r.col_as_slice(column));
        }
        for t in 0..q {
            stack.column_mut(k + t)[..p].copy_from_slice(self.z.col_as_slice(t));
        }
        let mut factor = Mat::zeros(k, k + q);
        fold_rows(&mut factor, &mut stack);
        let residual = (0..q).map(|t| self.residual[t] + sum_of_squares(stack.column(k + t))).collect();
        let pick = |values: &[f64]| columns.iter().map(|&column| values[column]).collect::<Vec<f64>>();
        let means = (pick(&self.mean_x), self.mean_y.clone());
        let magnitude = pick(&self.magnitude);
        Self::assemble((self.rows, self.weight), means, factor, residual, self.condition, self.noise, magnitude)
    }
}

pub(crate) fn sum_of_squares(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}

//! The square-root form of a least-squares problem: an R factor with Q'y ("compressed data").

use std::ops::Range;

use faer::{Accum, Mat, MatMut, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::packed_row;

use crate::{
    Gram, PivotedCholesky, Preconditioner,
    householder::{condition, fold_rows},
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

impl Preconditioner {
    /// The square-root form, in raw units, of the Gram matrix of preconditioned rows ([`Preconditioner::apply`]).
    ///
    /// A pivoted Cholesky factor of the Gram matrix is stopped where only rounding remains (relative to the diagonal, and to what
    /// [`Preconditioner::apply`] rounded); its product with T is brought to triangular form by a QR.
    ///
    /// # Panics
    /// When `gram` has another dimension.
    pub fn square_root(&self, gram: &Gram) -> SquareRoot {
        let (p, weight) = (self.regressors(), gram.weight);
        let (cholesky, made_from) = self.pivoted(gram);
        let (order, rank) = (&cholesky.order, cholesky.rank());
        let triangle = Mat::from_fn(rank, rank, |i, j| if i <= j { cholesky.factor.column(order[j])[i] } else { 0.0 });
        let condition = condition(&triangle, rank);

        let factor = self.raw_factor(&cholesky);
        let (mean_x, mean_y) = self.means(gram);
        let mut magnitude = vec![0.0; p];
        for (k, &column) in self.order().iter().enumerate() {
            magnitude[column] = made_from[k] + weight.sqrt() * mean_x[column].abs().max(self.centre()[column].abs());
        }
        // What the Cholesky factor lost in weak directions leaks into the directions that it does not see.
        let leak = if rank < p { condition } else { 1.0 };
        SquareRoot::assemble(
            (gram.rows, weight),
            (mean_x, mean_y),
            factor,
            self.left(&cholesky),
            condition * condition,
            noise_level(p) * leak,
            magnitude,
        )
    }

    /// Means in raw units, of the regressors (p) and of the targets (q), of the Gram matrix of preconditioned rows: those of [`Preconditioner::square_root`],
    /// without the rest of it.
    pub fn means(&self, gram: &Gram) -> (Vec<f64>, Vec<f64>) {
        let (p, q) = (self.regressors(), self.targets());
        let mean = |k: usize| self.column(k).iter().zip(&gram.mean).map(|(t, mean)| t * mean).sum::<f64>();
        let mut mean_x = self.centre()[..p].to_vec();
        self.order().iter().enumerate().for_each(|(k, &column)| mean_x[column] += mean(k));
        (mean_x, (p..p + q).map(|k| self.centre()[k] + mean(k)).collect())
    }

    /// The squared error, per target and in raw units, of the least squares on the rows of a Gram matrix: [`SquareRoot::residual`], without the rest of
    /// the square-root form.
    ///
    /// # Panics
    /// When `gram` has another dimension.
    pub fn residual(&self, gram: &Gram) -> Vec<f64> {
        self.left(&self.pivoted(gram).0)
    }

    /// What a factor leaves of the targets, in raw units.
    fn left(&self, cholesky: &PivotedCholesky) -> Vec<f64> {
        let p = self.regressors();
        let residual = |t: usize| {
            let size = self.column(p + t)[p + t];
            cholesky.left[p + t].max(0.0) * size * size
        };
        (0..self.targets()).map(residual).collect()
    }

    /// The pivoted Cholesky factor of the Gram matrix of preconditioned rows, and the lengths that the columns were made from.
    fn pivoted(&self, gram: &Gram) -> (PivotedCholesky, Vec<f64>) {
        let (p, q) = (self.regressors(), self.targets());
        assert_eq!(gram.dimension(), p + q, "a Gram matrix of the preconditioned columns");
        let weight = gram.weight;
        // Lengths about the pilot's centre: what the substitutions and products were made of.
        let length: Vec<f64> = (0..p).map(|k| (gram.get(k, k) + weight * gram.mean[k] * gram.mean[k]).sqrt()).collect();
        let made_from = |k: usize| {
            let terms: Vec<f64> = self.column(k).iter().zip(&length).map(|(t, length)| t * length).collect();
            norm(&terms)
        };
        let made_from: Vec<f64> = (0..p).map(made_from).collect();
        let floor = |k: usize| {
            if self.is_native() {
                return noise_level(p) * length[k];
            }
            let centre = self.centre()[self.order()[k]].abs() * weight.sqrt();
            noise_level(p) * (made_from[k] + centre) / self.column(k)[k].abs()
        };
        let rounding = 8.0 * (p as f64) * f64::EPSILON;
        let floor: Vec<f64> =
            (0..p).map(|k| (rounding * gram.get(k, k)).max(floor(k).powi(2)).max(f64::MIN_POSITIVE)).collect();
        // No more rows than columns leave some that depend on others.
        let factor = if gram.rows > p as u64 { PivotedCholesky::in_order } else { PivotedCholesky::new };
        (factor(p, p + q, |i, j| gram.get(i, j), &floor), made_from)
    }
}

impl Preconditioner {
    /// `[R z]` in raw units: the Cholesky factor times `[T B; 0 diag(s)]`, made triangular. Of many columns that all kept their order it is a triangle already.
    fn raw_factor(&self, cholesky: &PivotedCholesky) -> Mat<f64> {
        let (p, q) = (self.regressors(), self.targets());
        let part = |i: usize| &cholesky.factor.column(i)[..cholesky.rank()];
        let mut stack = Slab::zeros(p, p + q);
        for k in 0..p + q {
            // Only the targets' own diagonal stands below row p.
            let raw = self.order().get(k).copied().unwrap_or(k);
            let entries = self.column(k).iter().enumerate().filter(|&(i, t)| *t != 0.0 && (i < p || i == k));
            for (i, t) in entries {
                add_scaled(stack.column_mut(raw), part(i), *t);
            }
        }
        let in_order = |order: &[usize]| order.iter().copied().eq(0..p);
        if p >= MANY_COLUMNS && in_order(&cholesky.order) && in_order(self.order()) {
            // No diagonal entry is negative, as a reduction leaves them.
            let sign: Vec<f64> = (0..p).map(|i| stack.column(i)[i].signum()).collect();
            return Mat::from_fn(p, p + q, |i, j| if i <= j { sign[i] * stack.column(j)[i] } else { 0.0 });
        }
        let mut factor = Mat::zeros(p, p + q);
        fold_rows(&mut factor, &mut stack);
        factor
    }
}

fn add_scaled(target: &mut [f64], values: &[f64], factor: f64) {
    target.iter_mut().zip(values).for_each(|(target, value)| *target += factor * value);
}

impl SquareRoot {
    /// From a factor `[R z]` (p x (p + q)).
    pub(crate) fn assemble(
        (rows, weight): (u64, f64),
        (mean_x, mean_y): (Vec<f64>, Vec<f64>),
        factor: Mat<f64>,
        residual: Vec<f64>,
        condition: f64,
        noise: f64,
        magnitude: Vec<f64>,
    ) -> Self {
        let p = mean_x.len();
        let r = Mat::from_fn(p, p, |i, j| factor[(i, j)]);
        let z = Mat::from_fn(p, mean_y.len(), |i, t| factor[(i, p + t)]);
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
        let mut found = Vec::with_capacity(packed_row(count));
        if count < MANY_COLUMNS {
            for i in columns.clone() {
                for j in columns.start..=i {
                    found.push((0..=j).map(|k| self.r[(k, i)] * self.r[(k, j)]).sum());
                }
            }
            return found;
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
        (0..count).for_each(|i| found.extend_from_slice(&product.column(i)[..=i]));
        found
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
        let (p, q) = (self.regressors(), self.targets());
        assert_eq!((coefficients.nrows(), coefficients.ncols(), intercept.len()), (p, q, q), "p x q coefficients");
        let mut left = vec![0.0; p];
        (0..q)
            .map(|t| {
                left.iter_mut().zip(self.z.col_as_slice(t)).for_each(|(left, z)| *left = -z);
                let mut mean = self.mean_y[t] - intercept[t];
                for j in 0..p {
                    let beta = coefficients[(j, t)];
                    mean -= self.mean_x[j] * beta;
                    add_scaled(&mut left[..=j], &self.r.col_as_slice(j)[..=j], beta);
                }
                sum_of_squares(&left) + self.residual[t] + self.weight * mean * mean
            })
            .collect()
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

//! From the moments of a resample, in good coordinates, to its lasso solution.

use faer::{Accum, Mat, Par, linalg::matmul::matmul};
use fleetfoot_data::{packed, packed_row};
use fleetfoot_stats::PivotedCholesky;

use crate::{
    Penalty, Quadratic, Solution, SparseError,
    coordinate::{CoordinateOptions, coordinate_descent},
    kernel::{Slab, norm},
    lars::lasso_at,
    rows::compress,
    structured::Assembly,
    warm::lasso_from,
};

/// Coordinates and penalty that all resamples of a regression share: x~ of the rows of B and y, with
/// `(B / unit, y / size) = x~ [T z; 0 r]`.
#[derive(Debug, Clone)]
pub(crate) struct Frame<'a> {
    /// Upper triangular, (p + 1) x (p + 1).
    pub(crate) triangle: Mat<f64>,
    /// Size of every column of B (p).
    pub(crate) unit: Vec<f64>,
    /// Size of the target.
    pub(crate) size: f64,
    assembly: &'a Assembly,
    pub(crate) penalty: Penalty,
}

/// Sums of a resample.
pub(crate) struct Sums<'a> {
    /// n: the sum of the row weights times the counts.
    pub(crate) weight: f64,
    /// Sums of products of the coordinates x~, lower triangle packed by rows, the target last ((p + 1) (p + 2) / 2).
    pub(crate) products: &'a [f64],
    /// Scale of every column of this resample (p), [`Assembled::scale`](crate::structured::Assembled).
    pub(crate) scale: Vec<f64>,
}

/// The lasso solution of one resample.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fitted {
    /// theta (p), raw units.
    pub(crate) coefficients: Vec<f64>,
    /// n.
    pub(crate) weight: f64,
    /// Violation of the optimality conditions, as a correlation.
    pub(crate) kkt: f64,
    /// True if rounding ended the path before lambda, and coordinate descent finished.
    pub(crate) stalled: bool,
    /// True if the solver that finished met its tolerance.
    pub(crate) converged: bool,
}

/// The scale of a column from its mean square over measured tasks, or over priors where there is none, as in [`assemble()`](crate::structured::assemble()).
///
/// `None` for a column of zeros.
pub(crate) fn scale(measured: f64, believed: f64) -> Option<f64> {
    let square = if measured > 0.0 { measured } else { believed };
    (square > 0.0 && square.is_finite()).then(|| square.sqrt())
}

/// Mean square of a column about its mean, from its sums about `centre`; of a column that does not vary about zero, as in [`assemble()`](crate::structured::assemble()).
pub(crate) fn spread(square: f64, sum: f64, weight: f64, centre: f64) -> f64 {
    let shift = sum / weight;
    let (about_mean, mean) = (square / weight - shift * shift, centre + shift);
    if about_mean > (STILL * mean).powi(2) { about_mean } else { mean * mean }
}

/// A deviation below this, relative to the mean, is rounding.
const STILL: f64 = 1e-13;

impl<'a> Frame<'a> {
    pub(crate) fn new(triangle: Mat<f64>, unit: Vec<f64>, size: f64, assembly: &'a Assembly, penalty: Penalty) -> Self {
        Self { triangle, unit, size, assembly, penalty }
    }

    fn columns(&self) -> usize {
        self.unit.len()
    }

    /// The surrogate problem of a resample, in the coefficients `theta_j scale_j`: `chol(x~'x~) [T z; 0 r]` is its square-root form, less what
    /// squaring loses of the condition number of x~.
    pub(crate) fn problem(&self, sums: &Sums<'_>) -> Result<Quadratic, SparseError> {
        let p = self.columns();
        if !(sums.weight > 0.0 && sums.weight.is_finite()) {
            return Err(SparseError::NoRows);
        }
        if let Some(column) =
            (0..p).find(|&j| !sums.products[packed_row(j)..packed_row(j + 1)].iter().all(|v| v.is_finite()))
        {
            return Err(SparseError::ColumnNotFinite { column });
        }
        if !sums.products[packed_row(p)..].iter().all(|value| value.is_finite()) {
            return Err(SparseError::TargetNotFinite);
        }
        let entry = |i: usize, j: usize| sums.products[packed(i, j)];
        let rounding = 8.0 * (p + 1) as f64 * f64::EPSILON;
        let floor: Vec<f64> = (0..p).map(|j| (rounding * entry(j, j)).max(f64::MIN_POSITIVE)).collect();
        let cholesky = PivotedCholesky::new(p, p + 1, entry, &floor);
        let m = cholesky.rank();
        let mut raw = Mat::zeros(m, p + 1);
        let factor = cholesky.factor.as_mat().subrows(0, m);
        matmul(raw.as_mut(), Accum::Replace, factor, self.triangle.as_ref(), 1.0, Par::Seq);
        let unit: Vec<f64> = self.unit.iter().zip(&sums.scale).map(|(unit, scale)| unit / scale).collect();
        let extra = self.assembly.tikhonov.as_ref().filter(|tikhonov| tikhonov.strength > 0.0);
        let below = extra.map_or(0, |tikhonov| tikhonov.gamma.nrows());
        let mut rows = Slab::zeros(m + below, p);
        for j in 0..p {
            let column = rows.column_mut(j);
            column.iter_mut().zip(raw.col_as_slice(j)).for_each(|(entry, raw)| *entry = raw * unit[j]);
        }
        let mut z: Vec<f64> = raw.col_as_slice(p).iter().map(|value| value * self.size).collect();
        z.resize(rows.stride(), 0.0);
        if let Some(tikhonov) = extra {
            let strength = tikhonov.strength.sqrt();
            for i in 0..below {
                let gamma = |j: usize| strength * tikhonov.gamma[(i, j)];
                (0..p).for_each(|j| rows.column_mut(j)[m + i] = gamma(j) / sums.scale[j]);
                z[m + i] = (0..p).map(|j| gamma(j) * tikhonov.prior[j]).sum();
            }
        }
        let beyond = cholesky.left[p].max(0.0).sqrt() * self.triangle[(p, p)].abs() * self.size;
        let size = norm(z.iter().copied().chain([beyond]));
        let more = if rows.rows() > p { compress(&mut rows, &mut z) } else { 0.0 };
        z.truncate(rows.rows());
        // Errors in weak directions leak into those that are set aside.
        let leak = if m < p { cholesky.least.sqrt().recip() } else { 1.0 };
        let level = 16.0 * f64::EPSILON * ((p + 1) as f64).sqrt() * leak;
        let noise = (0..p).map(|j| level * self.made_from(sums.products, j) * unit[j]).collect();
        Ok(Quadratic::of_compressed(sums.weight, None, rows, z, beyond.hypot(more), (size, 0.0), noise))
    }

    /// Length of the terms that column j of B / unit is the sum of.
    fn made_from(&self, products: &[f64], j: usize) -> f64 {
        let entry = |i: usize| self.triangle[(i, j)] * self.triangle[(i, j)] * products[packed(i, i)];
        (0..=j).map(entry).sum::<f64>().sqrt()
    }

    /// The lasso solution of a resample at lambda; `guess`, the active columns of a similar problem with their signs, saves the path where it is near.
    pub(crate) fn fit(
        &self,
        sums: &Sums<'_>,
        lambda: f64,
        guess: Option<&[(usize, f64)]>,
    ) -> Result<Fitted, SparseError> {
        let problem = self.problem(sums)?;
        let near = guess.map_or(Ok(None), |guess| lasso_from(&problem, &self.penalty, lambda, guess))?;
        let solution = if near.is_some() { near } else { lasso_at(&problem, &self.penalty, lambda)? };
        let (solution, stalled) = match solution {
            Some(solution) => (solution, false),
            None => (descend(&problem, &self.penalty, lambda)?, true),
        };
        Ok(Fitted {
            coefficients: self.coefficients(sums, &solution),
            weight: sums.weight,
            kkt: solution.certificate.kkt,
            stalled,
            converged: solution.converged,
        })
    }

    /// theta (p) of a solution.
    pub(crate) fn coefficients(&self, sums: &Sums<'_>, solution: &Solution) -> Vec<f64> {
        let mut theta = vec![0.0; self.columns()];
        solution.support.iter().zip(&solution.coefficients).for_each(|(&j, &value)| theta[j] = value / sums.scale[j]);
        theta
    }
}

/// Coordinate descent at one lambda, for a path that rounding ended.
pub(crate) fn descend(problem: &Quadratic, penalty: &Penalty, lambda: f64) -> Result<Solution, SparseError> {
    let solutions = coordinate_descent(problem, penalty, &[lambda], &CoordinateOptions::default())?;
    solutions.into_iter().next().ok_or(SparseError::NoRows)
}

/// Solves `X T = B` for columns in place, T upper triangular: substitution row by row of X, which is backward stable.
pub(crate) fn divide_right(columns: &mut [Vec<f64>], triangle: &Mat<f64>) {
    for j in 0..columns.len() {
        let (known, rest) = columns.split_at_mut(j);
        let column = &mut rest[0];
        for (i, known) in known.iter().enumerate() {
            let entry = triangle[(i, j)];
            if entry != 0.0 {
                column.iter_mut().zip(known).for_each(|(value, known)| *value -= known * entry);
            }
        }
        column.iter_mut().for_each(|value| *value /= triangle[(j, j)]);
    }
}

/// The triangle of a QR of rows (m x d), divided by sqrt(m'), m' their weight; directions that the rows do not show get the size of their column.
pub(crate) fn triangle_of(mut rows: Slab, weight: f64) -> Mat<f64> {
    let d = rows.columns();
    let root = weight.max(f64::MIN_POSITIVE).sqrt();
    let length: Vec<f64> = (0..d).map(|j| norm(rows.column(j).iter().copied()) / root).collect();
    let mut none = vec![0.0; rows.stride()];
    if rows.rows() < d {
        rows = Slab::from_fn(d, d, |i, j| if i < rows.rows() { rows.column(j)[i] } else { 0.0 });
        none = vec![0.0; rows.stride()];
    }
    compress(&mut rows, &mut none);
    let mut triangle = Mat::from_fn(d, d, |i, j| if i <= j { rows.column(j)[i] / root } else { 0.0 });
    for j in 0..d {
        let size = if length[j] > 0.0 && length[j].is_finite() { length[j] } else { 1.0 };
        if triangle[(j, j)].abs().partial_cmp(&(HIDDEN * size)) != Some(std::cmp::Ordering::Greater) {
            triangle[(j, j)] = size;
        }
    }
    triangle
}

/// A direction shorter than this, relative to its column, is rounding.
const HIDDEN: f64 = 1e-12;

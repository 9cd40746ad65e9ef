//! Problems from dense rows: for small data, and for tests.

use faer::MatRef;
use fleetfoot_stats::householder::reduce_columns;

use crate::{
    SparseError,
    kernel::{Slab, norm},
    quadratic::{Means, Quadratic},
};

impl Quadratic {
    /// From dense rows: x (n x p), y (n), row weights (n; `None`: all 1), with or without a free intercept.
    ///
    /// Columns are centred in two passes; more rows than columns are compressed by Householder QR.
    ///
    /// # Errors
    /// When there are no rows of positive weight, the lengths disagree, a weight is negative, or a value is not finite.
    pub fn from_rows(
        x: MatRef<'_, f64>,
        y: &[f64],
        weights: Option<&[f64]>,
        intercept: bool,
    ) -> Result<Self, SparseError> {
        Self::of_rows(x, y, weights, intercept, true)
    }

    /// As [`Quadratic::from_rows`], and all rows are kept: the factorisation costs rows times the square of the columns, and a sparse solution a few times
    /// rows times columns.
    pub(crate) fn from_rows_as_they_are(
        x: MatRef<'_, f64>,
        y: &[f64],
        weights: Option<&[f64]>,
        intercept: bool,
    ) -> Result<Self, SparseError> {
        Self::of_rows(x, y, weights, intercept, false)
    }

    fn of_rows(
        x: MatRef<'_, f64>,
        y: &[f64],
        weights: Option<&[f64]>,
        intercept: bool,
        compressed: bool,
    ) -> Result<Self, SparseError> {
        let (n, p) = x.shape();
        for (what, found) in [("the target", y.len()), ("the row weights", weights.map_or(n, <[f64]>::len))] {
            if found != n {
                return Err(SparseError::Length { what, found, expected: n });
            }
        }
        let weight = |row: usize| weights.map_or(1.0, |weights| weights[row]);
        if let Some(row) = (0..n).find(|&row| !(weight(row) >= 0.0 && weight(row).is_finite())) {
            return Err(SparseError::RowWeight { row, value: weight(row) });
        }
        let used: Vec<usize> = (0..n).filter(|&row| weight(row) > 0.0).collect();
        let total: f64 = used.iter().map(|&row| weight(row)).sum();
        if used.is_empty() {
            return Err(SparseError::NoRows);
        }
        if let Some(column) = (0..p).find(|&j| used.iter().any(|&row| !x[(row, j)].is_finite())) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        if used.iter().any(|&row| !y[row].is_finite()) {
            return Err(SparseError::TargetNotFinite);
        }
        let centre = |value: &dyn Fn(usize) -> f64| {
            if !intercept {
                return 0.0;
            }
            // The second pass takes out what the first one rounded.
            let first: f64 = used.iter().map(|&row| weight(row) / total * value(row)).sum();
            first + used.iter().map(|&row| weight(row) / total * (value(row) - first)).sum::<f64>()
        };
        let mean_x: Vec<f64> = (0..p).map(|j| centre(&|row| x[(row, j)])).collect();
        let mean_y = centre(&|row| y[row]);
        let roots: Vec<f64> = used.iter().map(|&row| weight(row).sqrt()).collect();
        let mut rows = Slab::from_fn(used.len(), p, |i, j| roots[i] * (x[(used[i], j)] - mean_x[j]));
        let mut z: Vec<f64> = used.iter().zip(&roots).map(|(&row, root)| root * (y[row] - mean_y)).collect();
        z.resize(rows.stride(), 0.0);
        let level = 16.0 * f64::EPSILON * ((p + 1) as f64).sqrt();
        let size = norm(z.iter().copied());
        let noise = |length: f64, mean: f64| level * (length + total.sqrt() * mean.abs());
        let noise_x = (0..p).map(|j| noise(norm(rows.column(j).iter().copied()), mean_x[j])).collect();
        let least = level * total.sqrt() * mean_y.abs();
        let beyond = if compressed && used.len() > p { compress(&mut rows, &mut z) } else { 0.0 };
        let means = intercept.then_some(Means { x: mean_x, y: mean_y });
        z.truncate(rows.rows());
        Ok(Self::of_compressed(total, means, rows, z, beyond, (size, least), noise_x))
    }
}

/// Replaces rows A (m x p, m >= p) and z by the triangle R (p x p) and the first p entries of Q'z (Householder QR); the length of the others.
///
/// Columns are scaled to unit length on the way: their squares cannot overflow.
pub(crate) fn compress(rows: &mut Slab, z: &mut Vec<f64>) -> f64 {
    let (m, p) = (rows.rows(), rows.columns());
    let unit = |values: &mut [f64]| {
        let length = norm(&*values);
        if length > 0.0 {
            values.iter_mut().for_each(|value| *value /= length);
        }
        length
    };
    let scale: Vec<f64> = (0..p).map(|j| unit(rows.column_mut(j))).collect();
    let target = unit(z.as_mut_slice());
    rows.push(z);
    reduce_columns(rows, &vec![m.saturating_sub(1); p]);
    let reduced = rows.column(p);
    let beyond = target * norm(&reduced[p..m]);
    let triangle = Slab::from_fn(p, p, |i, j| if i <= j { rows.column(j)[i] * scale[j] } else { 0.0 });
    z.clear();
    z.extend(reduced[..p].iter().map(|value| value * target));
    z.resize(triangle.stride(), 0.0);
    *rows = triangle;
    beyond
}

//! Problems from dense rows: for small data, and for tests.

use std::borrow::Cow;

use faer::MatRef;
use fleetfoot_data::checkpoint;
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
        let column = |j: usize| picked(x, j, &used);
        if let Some(column) = (0..p).find(|&j| column(j).iter().any(|value| !value.is_finite())) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        if used.iter().any(|&row| !y[row].is_finite()) {
            return Err(SparseError::TargetNotFinite);
        }
        let shares: Vec<f64> = used.iter().map(|&row| weight(row) / total).collect();
        let centre = |values: &[f64]| {
            if !intercept {
                return 0.0;
            }
            // The second pass takes out what the first one rounded.
            let first: f64 = shares.iter().zip(values).map(|(share, value)| share * value).sum();
            first + shares.iter().zip(values).map(|(share, value)| share * (value - first)).sum::<f64>()
        };
        let roots: Vec<f64> = used.iter().map(|&row| weight(row).sqrt()).collect();
        let mut rows = Slab::zeros(used.len(), p);
        let mut mean_x = Vec::with_capacity(p);
        for j in 0..p {
            checkpoint();
            let values = column(j);
            let mean = centre(&values);
            let scaled = rows.column_mut(j).iter_mut().zip(&roots).zip(values.iter());
            scaled.for_each(|((entry, root), value)| *entry = root * (value - mean));
            mean_x.push(mean);
        }
        let target: Vec<f64> = used.iter().map(|&row| y[row]).collect();
        let mean_y = centre(&target);
        let mut z: Vec<f64> = target.iter().zip(&roots).map(|(value, root)| root * (value - mean_y)).collect();
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

/// The values of a column in some rows, ascending; where they lie, if these are all.
fn picked<'a>(x: MatRef<'a, f64>, column: usize, used: &[usize]) -> Cow<'a, [f64]> {
    match x.col(column).try_as_col_major() {
        Some(values) if used.len() == x.nrows() => Cow::Borrowed(values.as_slice()),
        _ => used.iter().map(|&row| x[(row, column)]).collect(),
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

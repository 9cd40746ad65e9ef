//! Problems from dense rows: for small data, and for tests.

use std::borrow::Cow;

use faer::MatRef;
use fleetfoot_data::checkpoint;
use fleetfoot_stats::householder::reduce_columns;

use crate::{
    SparseError,
    kernel::{Slab, norm},
    quadratic::{Form, Means, Quadratic},
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
    #[cfg(test)]
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
        for (what, length) in [("the target", y.len()), ("the row weights", weights.map_or(n, <[f64]>::len))] {
            if length != n {
                return Err(SparseError::Length { what, actual: length, expected: n });
            }
        }
        let weight = |row: usize| weights.map_or(1.0, |weights| weights[row]);
        if let Some(row) = (0..n).find(|&row| !(weight(row) >= 0.0 && weight(row).is_finite())) {
            return Err(SparseError::RowWeight { row, value: weight(row) });
        }
        let used: Vec<usize> = (0..n).filter(|&row| weight(row) > 0.0).collect();
        let weights = weights.map(|_| used.iter().map(|&row| weight(row)).collect());
        let centring = Centring::new(used.len(), weights, intercept, p)?;
        let mut rows = Slab::zeros(used.len(), p);
        let mut columns = Vec::with_capacity(p);
        for j in 0..p {
            checkpoint();
            columns.push(centring.column(&picked(x, j, &used), rows.column_mut(j)));
        }
        let target: Vec<f64> = used.iter().map(|&row| y[row]).collect();
        centring.problem(rows, &columns, &target, compressed)
    }
}

/// Centring and weighting of columns.
pub(crate) struct Centring {
    rows: usize,
    /// Sum of the weights, n.
    total: f64,
    /// Weights over their sum, and their roots; `None` where all are 1.
    weights: Option<(Vec<f64>, Vec<f64>)>,
    intercept: bool,
    /// Rounding error relative to the rounded value.
    level: f64,
}

/// Mean and length of a column that is centred and weighted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Centred {
    /// Mean that was subtracted.
    mean: f64,
    /// Length of the centred column; not finite if a value or the length is not.
    length: f64,
}

impl Centring {
    /// Of `rows` rows with these weights, all positive (`None`: all 1), for p columns.
    ///
    /// # Errors
    /// When there are no rows.
    pub(crate) fn new(
        rows: usize,
        weights: Option<Vec<f64>>,
        intercept: bool,
        columns: usize,
    ) -> Result<Self, SparseError> {
        if rows == 0 {
            return Err(SparseError::NoRows);
        }
        let total = weights.as_ref().map_or(rows as f64, |weights| weights.iter().sum());
        let weights = weights.map(|weights| {
            let shares = weights.iter().map(|weight| weight / total).collect();
            (shares, weights.iter().map(|weight| weight.sqrt()).collect())
        });
        let level = 16.0 * f64::EPSILON * ((columns + 1) as f64).sqrt();
        Ok(Self { rows, total, weights, intercept, level })
    }

    /// The mean of a column; 0 without an intercept.
    fn mean(&self, values: &[f64]) -> f64 {
        if !self.intercept {
            return 0.0;
        }
        let mean = |centre: f64| match &self.weights {
            None => summed(values, |value| value - centre) / self.total,
            Some((shares, _)) => summed_with(values, shares, |value, share| share * (value - centre)),
        };
        // The second pass takes out what the first one rounded.
        let first = mean(0.0);
        first + mean(first)
    }

    /// Writes a column, centred and times the roots of the weights.
    pub(crate) fn column(&self, values: &[f64], out: &mut [f64]) -> Centred {
        let mean = self.mean(values);
        match &self.weights {
            None => out.iter_mut().zip(values).for_each(|(out, value)| *out = value - mean),
            Some((_, roots)) => {
                out.iter_mut().zip(values).zip(roots).for_each(|((out, value), root)| *out = root * (value - mean));
            }
        }
        // A value that is not finite makes the mean so, or without one the sum.
        let length = if summed(values, |value| value * 0.0) == 0.0 { length(&out[..values.len()]) } else { f64::NAN };
        Centred { mean, length }
    }

    /// As [`Centring::column`], and divided by its length: what [`Centring::problem_of_unit_columns`] takes.
    pub(crate) fn unit_column(&self, values: &[f64], out: &mut [f64]) -> Centred {
        let column = self.column(values, out);
        let length = if column.length > self.noise(column) { column.length } else { 0.0 };
        out.iter_mut().for_each(|value| *value = if length > 0.0 { *value / length } else { 0.0 });
        column
    }

    /// Rounding of a column.
    fn noise(&self, column: Centred) -> f64 {
        self.level * (column.length + self.total.sqrt() * column.mean.abs())
    }

    /// The problem of centred columns and a target as it is, all rows kept or compressed.
    fn problem(
        &self,
        mut rows: Slab,
        columns: &[Centred],
        target: &[f64],
        compressed: bool,
    ) -> Result<Quadratic, SparseError> {
        let Around { means, mut z, size } = self.around(rows.stride(), columns, target)?;
        let noise = columns.iter().map(|&column| self.noise(column)).collect();
        let p = columns.len();
        let beyond = if compressed && self.rows > p { compress(&mut rows, &mut z) } else { 0.0 };
        z.truncate(rows.rows());
        Ok(Quadratic::of_compressed(self.total, means, rows, z, beyond, size, noise))
    }

    /// The problem of unit columns and a target as it is, all rows kept.
    ///
    /// # Errors
    /// When a value is not finite.
    pub(crate) fn problem_of_unit_columns(
        &self,
        a: Slab,
        columns: &[Centred],
        target: &[f64],
    ) -> Result<Quadratic, SparseError> {
        let Around { means, mut z, size: (size, least) } = self.around(a.stride(), columns, target)?;
        let size = if size > least { size } else { 0.0 };
        z.iter_mut().for_each(|value| *value = if size > 0.0 { *value / size } else { 0.0 });
        let varies = |column: &Centred| column.length > self.noise(*column);
        let length = columns.iter().map(|column| if varies(column) { column.length } else { 0.0 });
        let noise = columns.iter().map(|column| if varies(column) { self.noise(*column) / column.length } else { 0.0 });
        let (length, noise) = (length.collect(), noise.collect());
        Ok(Quadratic { weight: self.total, length, size, means, noise, form: Form::Root { a, z, beyond: 0.0 } })
    }

    /// Means and length about which columns and target are centred.
    fn around(&self, stride: usize, columns: &[Centred], target: &[f64]) -> Result<Around, SparseError> {
        if let Some(column) = columns.iter().position(|column| !column.length.is_finite()) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        let mut z = vec![0.0; stride];
        let column = self.column(target, &mut z[..self.rows]);
        if !column.length.is_finite() {
            return Err(SparseError::TargetNotFinite);
        }
        let x = || columns.iter().map(|column| column.mean).collect();
        let means = self.intercept.then(|| Means { x: x(), y: column.mean });
        Ok(Around { means, z, size: (column.length, self.level * self.total.sqrt() * column.mean.abs()) })
    }
}

/// Rows that are centred.
struct Around {
    /// Means of the columns and the target; `None` without an intercept.
    means: Option<Means>,
    /// The centred target, padded.
    z: Vec<f64>,
    /// Its length, and that below which it is rounding.
    size: (f64, f64),
}

/// Sums side by side: enough for the additions to overlap, on any machine the same ones.
const SUMS: usize = 8;

/// The sum of what `term` makes of every value.
#[inline(always)]
fn summed(values: &[f64], term: impl Fn(f64) -> f64) -> f64 {
    let mut sums = [0.0; SUMS];
    let mut parts = values.chunks_exact(SUMS);
    for part in &mut parts {
        sums.iter_mut().zip(part).for_each(|(sum, &value)| *sum += term(value));
    }
    sums.iter().sum::<f64>() + parts.remainder().iter().map(|&value| term(value)).sum::<f64>()
}

/// The sum of what `term` makes of every value and the factor beside it.
#[inline(always)]
fn summed_with(values: &[f64], factors: &[f64], term: impl Fn(f64, f64) -> f64) -> f64 {
    let mut sums = [0.0; SUMS];
    let (mut parts, mut others) = (values.chunks_exact(SUMS), factors.chunks_exact(SUMS));
    for (part, other) in (&mut parts).zip(&mut others) {
        sums.iter_mut().zip(part).zip(other).for_each(|((sum, &value), &factor)| *sum += term(value, factor));
    }
    let last = parts.remainder().iter().zip(others.remainder());
    sums.iter().sum::<f64>() + last.map(|(&value, &factor)| term(value, factor)).sum::<f64>()
}

/// Euclidean norm, safe against overflow and underflow of the squares.
fn length(values: &[f64]) -> f64 {
    let square = summed(values, |value| value * value);
    // Beyond these the squares of some values are not what they should be.
    if (1e-280..1e280).contains(&square) { square.sqrt() } else { norm(values) }
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

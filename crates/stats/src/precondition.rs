//! The pilot preconditioner: coordinates in which the Gram matrix of the rows is well conditioned.
//!
//! Forming X'X squares the condition number. With T the triangular factor of a QR of a pilot sample, the Gram matrix of X T^-1 is
//! near a multiple of the identity as far as the pilot represents the rows, and `chol(T^-T X'X T^-1) T` is nearly as good an R
//! factor of X as Householder QR gives.

use faer::{
    Accum, Mat, MatMut, MatRef, Par,
    linalg::matmul::matmul,
    reborrow::{Reborrow, ReborrowMut},
};
use fleetfoot_data::{checkpoint, packed_row, parallel_pieces};

use crate::{
    PivotedCholesky,
    householder::{condition, fold_rows},
    kernel::{COLUMNS_AT_ONCE, MANY_COLUMNS, Slab, norm},
    separation::{Separation, separate},
    square_root::noise_level,
    triangle::{PANEL, Triangle},
};

/// A direction of the pilot shorter than this, relative to its column, takes no part in predicting the targets: what is weak in the
/// pilot may be strong in the rows, and would carry its rounding into the targets.
const STRONG: f64 = 1e-3;

/// Condition number of the pilot, its columns at unit length, up to which columns are centred and scaled only (T diagonal).
///
/// The factor of the Gram matrix then has the square of the rows' condition number to lose, where the full change of coordinates has the condition number
/// itself: at most the two digits between 1e2 and 1e4. The rows cost half.
const WELL_CONDITIONED: f64 = 100.0;
/// Rows of the pilot that are reduced at once, at least.
const PILOT_ROWS: usize = 256;

/// An affine change of coordinates of rows (x, y), made from a pilot sample:
///
/// `x~ = (x - c) P T^-1`, `y~ = (y - c - x~ B) diag(s)^-1`
///
/// Here P is a permutation (the pilot's pivot order) and T upper triangular. B is the pilot's regression of the targets
/// on its strong directions, and s the size of its residual. Taking B out of the targets keeps the residual of an exact
/// fit at the level of rounding squared. The Gram matrix of y itself would have it only to `1e-16 y'y`.
///
/// Any pilot gives a valid change of coordinates; a poor one costs accuracy, which [`SquareRoot::condition`](crate::SquareRoot)
/// reports. A direction that the pilot does not show keeps the scale of its column, so T is always invertible.
///
/// If the pilot's condition number is below 100, T is diagonal and P the identity: columns are centred and scaled. The
/// coefficients may then lose two more of the sixteen digits.
#[derive(Debug, Clone, PartialEq)]
pub struct Preconditioner {
    regressors: usize,
    targets: usize,
    centre: Vec<f64>,
    order: Vec<usize>,
    /// `[T B; 0 diag(s)]`, columns packed: (i, j), i <= j, at `j (j + 1) / 2 + i`.
    triangle: Vec<f64>,
    rank: usize,
    condition: f64,
    confounded: Vec<Vec<usize>>,
    solver: Solver,
}

/// Method that brings rows to the new coordinates.
#[derive(Debug, Clone, PartialEq)]
enum Solver {
    /// They are in them.
    Nothing,
    /// Columns are scaled, and targets predicted.
    Diagonal,
    /// By substitution.
    Triangle(Triangle),
}

/// Bytes that are no preconditioner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the bytes of the preconditioner are damaged or of another version")]
pub struct PreconditionerError;

impl Preconditioner {
    /// The preconditioner of pilot rows (n x (p + q)): p regressors, then targets. Rows that are not finite are skipped.
    ///
    /// The pilot is centred on its mean, its columns are scaled to unit length, and the triangle comes from a column-pivoted QR. Columns
    /// that the pilot cannot tell apart are named by [`Preconditioner::confounded`].
    ///
    /// # Panics
    /// When there are fewer than `p` columns.
    pub fn from_pilot(rows: MatRef<'_, f64>, p: usize) -> Self {
        let d = rows.ncols();
        assert!(p <= d, "the regressors are columns of the rows");
        let mut finite = vec![true; rows.nrows()];
        // Column by column, as they lie.
        for j in 0..d {
            finite.iter_mut().enumerate().for_each(|(i, finite)| *finite &= rows[(i, j)].is_finite());
        }
        let used: Vec<usize> = (0..rows.nrows()).filter(|&i| finite[i]).collect();
        let (columns, r) = factor_pilot(rows, &used, p);
        let n = (used.len() as f64).max(1.0);
        // Rounding of the numbers themselves, beside that of the factorisation.
        let noise: Vec<f64> =
            columns[..p].iter().map(|c| noise_level(p) * (1.0 + n.sqrt() * c.centre.abs() / c.length)).collect();
        let regressors = Mat::from_fn(d, p, |i, j| r[(i, j)]);
        let separation = separate(&regressors, &noise, Mat::from_fn(d, d - p, |i, j| r[(i, p + j)]));
        let sizes: Vec<f64> = columns.iter().map(|column| column.length / n.sqrt()).collect();
        let predicts = used.len() >= 2 * (p + 1);
        let preconditioner = Self {
            regressors: p,
            targets: d - p,
            centre: columns.iter().map(|column| column.centre).collect(),
            triangle: pilot_triangle(&separation, &noise, &sizes, predicts),
            rank: separation.rank,
            condition: separation.condition,
            confounded: separation.confounded(),
            order: separation.order,
            solver: Solver::Nothing,
        };
        let simple = predicts && preconditioner.rank == p && preconditioner.condition <= WELL_CONDITIONED;
        if simple { preconditioner.diagonal(&sizes) } else { preconditioner }.with_solver()
    }

    /// The same coordinates up to a product from the right: T diagonal (the columns' sizes), B in terms of the scaled columns.
    fn diagonal(mut self, sizes: &[f64]) -> Self {
        let (p, d) = (self.regressors, self.dimension());
        let mut triangle = vec![0.0; packed_row(d)];
        (0..p).for_each(|j| triangle[packed_row(j) + j] = sizes[j]);
        for target in p..d {
            // y - c = (x - c) P T^-1 B: the coefficients of x - c by substitution.
            let mut b = self.column(target)[..p].to_vec();
            for k in (0..p).rev() {
                b[k] /= self.column(k)[k];
                let (value, column) = (b[k], self.column(k));
                b[..k].iter_mut().zip(column).for_each(|(b, t)| *b -= value * t);
            }
            for (k, &column) in self.order.iter().enumerate() {
                triangle[packed_row(target) + column] = b[k] * sizes[column];
            }
            triangle[packed_row(target) + target] = self.column(target)[target];
        }
        (self.triangle, self.order) = (triangle, (0..p).collect());
        self
    }

    /// The preconditioner that changes nothing.
    pub fn identity(p: usize, q: usize) -> Self {
        let d = p + q;
        let mut triangle = vec![0.0; packed_row(d)];
        (0..d).for_each(|j| triangle[packed_row(j) + j] = 1.0);
        Self {
            regressors: p,
            targets: q,
            centre: vec![0.0; d],
            order: (0..p).collect(),
            triangle,
            rank: p,
            condition: 1.0,
            confounded: Vec::new(),
            solver: Solver::Nothing,
        }
    }

    /// The way back from rows that are made in their coordinates: raw column `order[k]` is the constant of `columns[k]` plus the first k + 1 coordinates times its
    /// factors; `targets` more columns stay as they are.
    ///
    /// # Panics
    /// When `order` is not a permutation or a column has another length.
    pub(crate) fn of_columns(columns: Vec<(f64, Vec<f64>)>, order: &[usize], targets: usize, condition: f64) -> Self {
        let p = columns.len();
        let mut preconditioner = Self { order: order.to_vec(), condition, ..Self::identity(p, targets) };
        for (k, (constant, factors)) in columns.into_iter().enumerate() {
            preconditioner.centre[order[k]] = constant;
            preconditioner.triangle[packed_row(k)..packed_row(k + 1)].copy_from_slice(&factors);
        }
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..p), "a permutation of the columns");
        preconditioner
    }

    /// Returns true if rows are in these coordinates from the start, without arithmetic on the raw columns.
    pub(crate) fn is_native(&self) -> bool {
        self.solver == Solver::Nothing
    }

    fn with_solver(mut self) -> Self {
        let triangle = &self.triangle;
        let in_order = self.order.iter().copied().eq(0..self.regressors);
        let diagonal = in_order && (0..self.regressors).all(|j| self.column(j)[..j].iter().all(|&entry| entry == 0.0));
        self.solver = if diagonal {
            Solver::Diagonal
        } else {
            Solver::Triangle(Triangle::new(self.dimension(), |i, j| triangle[packed_row(j) + i]))
        };
        self
    }

    /// Changes the coordinates of rows in place (n x d). Column k of the result is the k-th pivot of the pilot, not column k of x.
    ///
    /// # Panics
    /// When `z` has another number of columns than the pilot.
    pub fn apply(&self, mut z: MatMut<'_, f64>) {
        let d = self.dimension();
        assert_eq!(z.ncols(), d, "the columns of the pilot");
        let solver = match &self.solver {
            Solver::Nothing => return,
            Solver::Diagonal => return self.apply_diagonal(z),
            Solver::Triangle(solver) => solver,
        };
        let mut panel = vec![0.0; solver.panel_length()];
        for first in (0..z.nrows()).step_by(PANEL) {
            let rows = PANEL.min(z.nrows() - first);
            for k in 0..d {
                let from = self.order.get(k).copied().unwrap_or(k);
                let target = &mut panel[k * PANEL..(k + 1) * PANEL];
                let centre = self.centre[from];
                match z.rb().col(from).try_as_col_major() {
                    Some(column) => {
                        let column = &column.as_slice()[first..first + rows];
                        target.iter_mut().zip(column).for_each(|(target, value)| *target = value - centre);
                    }
                    None => (0..rows).for_each(|i| target[i] = z[(first + i, from)] - centre),
                }
                target[rows..].fill(0.0);
            }
            solver.solve(&mut panel);
            for k in 0..d {
                let source = &panel[k * PANEL..k * PANEL + rows];
                match z.rb_mut().col_mut(k).try_as_col_major_mut() {
                    Some(column) => column.as_slice_mut()[first..first + rows].copy_from_slice(source),
                    None => (0..rows).for_each(|i| z[(first + i, k)] = source[i]),
                }
            }
        }
    }

    /// [`Preconditioner::apply`] where T is diagonal: a column at a time.
    fn apply_diagonal(&self, mut z: MatMut<'_, f64>) {
        let (n, p) = (z.nrows(), self.regressors);
        let mut target = vec![0.0; n];
        for j in 0..p {
            let (centre, factor) = (self.centre[j], self.column(j)[j].recip());
            match z.rb_mut().col_mut(j).try_as_col_major_mut() {
                Some(column) => column.as_slice_mut().iter_mut().for_each(|x| *x = (*x - centre) * factor),
                None => (0..n).for_each(|i| z[(i, j)] = (z[(i, j)] - centre) * factor),
            }
        }
        for j in p..self.dimension() {
            (0..n).for_each(|i| target[i] = z[(i, j)] - self.centre[j]);
            let column = self.column(j);
            for (k, &b) in column[..p].iter().enumerate().filter(|(_, b)| **b != 0.0) {
                match z.rb().col(k).try_as_col_major() {
                    Some(x) => target.iter_mut().zip(x.as_slice()).for_each(|(y, x)| *y -= b * x),
                    None => (0..n).for_each(|i| target[i] -= b * z[(i, k)]),
                }
            }
            let factor = column[j].recip();
            (0..n).for_each(|i| z[(i, j)] = target[i] * factor);
        }
    }

    /// Number of regressors, p.
    pub fn regressors(&self) -> usize {
        self.regressors
    }

    /// Number of targets, q.
    pub fn targets(&self) -> usize {
        self.targets
    }

    /// Number of columns, d = p + q.
    pub fn dimension(&self) -> usize {
        self.regressors + self.targets
    }

    /// Directions of the regressors that the pilot shows.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Estimated condition number of the pilot's centred regressors, scaled to unit length, without the confounded ones.
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// Groups of regressors that the pilot cannot tell apart; a column constant in the pilot is a group of itself.
    pub fn confounded(&self) -> &[Vec<usize>] {
        &self.confounded
    }

    /// The way back: raw columns are `centre + z A` for preconditioned rows z; centre (d) and A (d x d).
    pub fn raw_map(&self) -> (Vec<f64>, Mat<f64>) {
        let d = self.dimension();
        let mut map = Mat::zeros(d, d);
        for k in 0..d {
            let raw = self.order.get(k).copied().unwrap_or(k);
            self.column(k).iter().enumerate().for_each(|(i, &entry)| map[(i, raw)] = entry);
        }
        (self.centre.clone(), map)
    }

    /// The centre of every raw column.
    pub(crate) fn centre(&self) -> &[f64] {
        &self.centre
    }

    /// The raw regressor behind each preconditioned one.
    pub(crate) fn order(&self) -> &[usize] {
        &self.order
    }

    /// Column `j` of `[T B; 0 diag(s)]`, down to its diagonal.
    pub(crate) fn column(&self, j: usize) -> &[f64] {
        &self.triangle[packed_row(j)..packed_row(j + 1)]
    }

    /// The preconditioner as bytes, the same for the same coordinates: for a plan's hash and for files.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut count = |value: usize| bytes.extend((value as u64).to_le_bytes());
        count(FORMAT);
        count(self.regressors);
        count(self.targets);
        count(self.rank);
        count(usize::from(self.solver != Solver::Nothing));
        self.order.iter().for_each(|&column| count(column));
        count(self.confounded.len());
        for group in &self.confounded {
            count(group.len());
            group.iter().for_each(|&column| count(column));
        }
        for value in self.centre.iter().chain(&self.triangle).chain([&self.condition]) {
            bytes.extend(value.to_le_bytes());
        }
        bytes
    }

    /// Reads what [`Preconditioner::to_bytes`] wrote.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PreconditionerError> {
        Reader(bytes).preconditioner().filter(Self::is_valid).ok_or(PreconditionerError)
    }

    fn is_valid(&self) -> bool {
        let mut order = self.order.clone();
        order.sort_unstable();
        let diagonal = (0..self.dimension()).map(|j| self.triangle[packed_row(j) + j]);
        order.into_iter().eq(0..self.regressors)
            && self.rank <= self.regressors
            && self.triangle.iter().chain(&self.centre).all(|value| value.is_finite())
            && diagonal.into_iter().all(|value| value != 0.0)
            && self.confounded.iter().flatten().all(|&column| column < self.regressors)
    }
}

/// Version of the bytes.
const FORMAT: usize = 1;

/// Reads counts and numbers from bytes; `None` where they end.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn word(&mut self) -> Option<[u8; 8]> {
        let (word, rest) = self.0.split_first_chunk::<8>()?;
        self.0 = rest;
        Some(*word)
    }

    /// A count that the remaining bytes can still hold.
    fn count(&mut self) -> Option<usize> {
        usize::try_from(u64::from_le_bytes(self.word()?)).ok()
    }

    fn counts(&mut self, length: usize) -> Option<Vec<usize>> {
        (length <= self.0.len() / 8).then_some(())?;
        (0..length).map(|_| self.count()).collect()
    }

    fn numbers(&mut self, length: usize) -> Option<Vec<f64>> {
        (length <= self.0.len() / 8).then_some(())?;
        (0..length).map(|_| self.word().map(f64::from_le_bytes)).collect()
    }

    fn preconditioner(mut self) -> Option<Preconditioner> {
        (self.count()? == FORMAT).then_some(())?;
        let (p, q, rank) = (self.count()?, self.count()?, self.count()?);
        let solves = self.count()? != 0;
        let order = self.counts(p)?;
        let groups = self.count()?;
        (groups <= p).then_some(())?;
        let mut confounded = Vec::new();
        for _ in 0..groups {
            let length = self.count()?;
            confounded.push(self.counts(length)?);
        }
        let d = p.checked_add(q)?;
        let centre = self.numbers(d)?;
        let triangle = self.numbers(packed_row(d))?;
        let condition = self.numbers(1)?[0];
        self.0.is_empty().then_some(())?;
        let result = Preconditioner {
            regressors: p,
            targets: q,
            centre,
            order,
            triangle,
            rank,
            condition,
            confounded,
            solver: Solver::Nothing,
        };
        Some(if solves { result.with_solver() } else { result })
    }
}

/// `[T B; 0 diag(s)]` from the separated pilot; `sizes` are the standard deviations of the columns (d), `predicts` says whether the pilot
/// has rows enough to predict the targets.
fn pilot_triangle(separation: &Separation, noise: &[f64], sizes: &[f64], predicts: bool) -> Vec<f64> {
    let Separation { order, rank, r, rhs, .. } = separation;
    let (p, rank) = (order.len(), *rank);
    let mut triangle = vec![0.0; packed_row(sizes.len())];
    for k in 0..p {
        let column = &mut triangle[packed_row(k)..packed_row(k + 1)];
        // From units of noise to raw units, and to rows of unit variance.
        let unit = noise[order[k]] * sizes[order[k]];
        for i in 0..(k + 1).min(rank) {
            column[i] = r[(i, k)] * unit;
        }
        if k >= rank {
            column[k] = sizes[order[k]];
        }
    }
    let strong = |k: usize| predicts && (r[(k, k)] * noise[order[k]]).abs() >= STRONG;
    for t in 0..rhs.ncols() {
        let size = sizes[p + t];
        let column = &mut triangle[packed_row(p + t)..packed_row(p + t + 1)];
        let mut left: Vec<f64> = rhs.col_as_slice(t).to_vec();
        for k in (0..rank).filter(|&k| strong(k)) {
            column[k] = left[k] * size;
            left[k] = 0.0;
        }
        // An exact fit leaves rounding only; any size will do that is not zero.
        column[p + t] = norm(&left).max(1e-8) * size;
    }
    triangle
}

/// One column of the pilot: `(value - centre) / length` has unit length over the rows.
struct PilotColumn {
    centre: f64,
    length: f64,
}

/// The centred pilot's columns, and the triangle (d x d) of its rows scaled to columns of unit length; a constant column is zero.
///
/// Of many columns the triangle is that of their products where these are conditioned well enough ([`WELL_CONDITIONED`]) to lose no digit that matters: half
/// the work of a reduction of the rows, which is the way else.
fn factor_pilot(rows: MatRef<'_, f64>, used: &[usize], p: usize) -> (Vec<PilotColumn>, Mat<f64>) {
    let d = rows.ncols();
    debug_assert!(p <= d);
    let mut columns: Vec<Option<(PilotColumn, bool)>> = (0..d).map(|_| None).collect();
    parallel_pieces(&mut columns, COLUMNS_AT_ONCE, |piece, columns| {
        let first = piece * COLUMNS_AT_ONCE;
        columns.iter_mut().zip(first..).for_each(|(column, j)| *column = Some(pilot_column(rows, used, j)));
    });
    let (columns, constant): (Vec<PilotColumn>, Vec<bool>) = columns.into_iter().flatten().unzip();
    let write = |chunk: &[usize], j: usize, values: &mut [f64]| {
        if !constant[j] {
            for (value, &i) in values.iter_mut().zip(chunk) {
                *value = (rows[(i, j)] - columns[j].centre) / columns[j].length;
            }
        }
    };
    if p >= MANY_COLUMNS && used.len() > d {
        let mut unit = Slab::zeros(used.len(), d);
        let stride = unit.stride();
        unit.fill_columns(COLUMNS_AT_ONCE, |first, values| {
            values.chunks_exact_mut(stride).zip(first..).for_each(|(values, j)| write(used, j, values));
            Vec::<()>::new()
        });
        if let Some(r) = factor_of_products(&unit, p) {
            return (columns, r);
        }
    }
    let mut r = Mat::zeros(d, d);
    // Of many columns as many rows as the triangle has: it is read once a chunk.
    for chunk in used.chunks(d.max(PILOT_ROWS)) {
        let mut tile = Slab::zeros(chunk.len(), d);
        (0..d).for_each(|j| write(chunk, j, tile.column_mut(j)));
        fold_rows(&mut r, &mut tile);
    }
    (columns, r)
}

/// A column of the pilot, and whether it is constant.
fn pilot_column(rows: MatRef<'_, f64>, used: &[usize], j: usize) -> (PilotColumn, bool) {
    let n = (used.len() as f64).max(1.0);
    let values = || used.iter().map(|&i| rows[(i, j)]);
    // Dividing first keeps the sum finite.
    let rough: f64 = values().map(|value| value / n).sum();
    let centre = rough + values().map(|value| (value - rough) / n).sum::<f64>();
    let largest = values().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    let spread: Vec<f64> = values().map(|value| value - centre).collect();
    let length = norm(&spread);
    let widest = spread.iter().fold(0.0_f64, |widest, value| widest.max(value.abs()));
    if widest > 4.0 * f64::EPSILON * largest && (1e-280..1e280).contains(&length) {
        return (PilotColumn { centre, length }, false);
    }
    // Its own size is the best guess of the size of its changes.
    let size = if (1e-280..1e280).contains(&centre.abs()) { centre.abs() } else { 1.0 };
    (PilotColumn { centre: if centre.is_finite() { centre } else { 0.0 }, length: size * n.sqrt() }, true)
}

/// The Cholesky factor of the products of columns (d, the first p of them regressors), as a triangle (d x d): what it leaves of a target stands on that one's
/// diagonal. `None` where the regressors are not well conditioned.
fn factor_of_products(unit: &Slab, p: usize) -> Option<Mat<f64>> {
    let d = unit.columns();
    let mut products = Slab::zeros(d, d);
    let stride = products.stride();
    products.fill_columns(COLUMNS_AT_ONCE, |first, values| {
        checkpoint();
        let width = values.len() / stride;
        let below = MatMut::from_column_major_slice_mut(values, stride, width);
        let (all, panel_columns) = (unit.as_mat().subcols(first, d - first), unit.as_mat().subcols(first, width));
        matmul(
            below.submatrix_mut(first, 0, d - first, width),
            Accum::Replace,
            all.transpose(),
            panel_columns,
            1.0,
            Par::Seq,
        );
        Vec::<()>::new()
    });
    // Pivots below the square of a column's share in such a condition number are none.
    let floor = vec![1.0 / (WELL_CONDITIONED * WELL_CONDITIONED * p as f64); p];
    let cholesky = PivotedCholesky::without_exchange(p, d, |i, j| products.column(i.min(j))[i.max(j)], &floor);
    if cholesky.rank() < p {
        return None;
    }
    let mut r = Mat::zeros(d, d);
    for j in 0..d {
        r.col_as_slice_mut(j)[..p.min(j + 1)].copy_from_slice(&cholesky.factor.column(j)[..p.min(j + 1)]);
    }
    (p..d).for_each(|j| r[(j, j)] = cholesky.left[j].max(0.0).sqrt());
    (condition(&r, p) <= WELL_CONDITIONED).then_some(r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangle_of_products_matches_well_conditioned_rows() {
        let (n, p, d) = (900, 300, 302);
        let value = |i: usize, j: usize| (0.731 * (i * (2 * j + 3) + 7 * j * j) as f64).sin() / (n as f64 / 2.0).sqrt();
        let mut rows = Slab::from_fn(n, d, value);
        let factor = factor_of_products(&rows, p).expect("well conditioned");
        let mut r = Mat::zeros(d, d);
        fold_rows(&mut r, &mut rows);
        for j in 0..d {
            for i in 0..=j.min(p - 1) {
                assert!((factor[(i, j)] - r[(i, j)]).abs() < 1e-12, "{i} {j}: {} {}", factor[(i, j)], r[(i, j)]);
            }
        }
        // Residual of a target, whatever another target explains of it.
        let left = |t: usize| (p..=t).map(|i| r[(i, t)] * r[(i, t)]).sum::<f64>().sqrt();
        (p..d).for_each(|t| assert!((factor[(t, t)] - left(t)).abs() < 1e-12, "{t}"));
        // A column that is nearly another one.
        let near =
            Slab::from_fn(n, d, |i, j| value(i, if j == 9 { 4 } else { j }) + f64::from(j == 9) * 1e-3 * value(i, 9));
        assert!(factor_of_products(&near, p).is_none());
    }
}

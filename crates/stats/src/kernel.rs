//! Vector kernels: dense columns of equal stride, products with them, substitution, and affine maps of one row.
//!
//! Columns and vectors are padded with zeros to whole vectors of the widest instruction set, so that no kernel has a tail. What takes a
//! [`Simd`] is inlined into the caller's [`WithSimd::with_simd`]; a closure would not do, for nothing forces the compiler to inline it into the
//! function that has the wide vectors.

use std::borrow::Borrow;

use faer::{MatMut, MatRef};
use fleetfoot_data::parallel_pieces;
use pulp::{Simd, WithSimd};

/// Values that one thread takes at once: what is more costs longer to read than to hand out.
const PIECE: usize = 1 << 17;

/// Columns from which on what would read a whole matrix for each of them goes by blocks and on all threads, and columns that a thread then takes at once.
pub(crate) const MANY_COLUMNS: usize = 256;
pub(crate) const COLUMNS_AT_ONCE: usize = 128;

/// Values of the widest vector.
pub const LANES: usize = 8;

/// `length` up to whole vectors.
pub fn padded(length: usize) -> usize {
    length.next_multiple_of(LANES)
}

/// A column-major matrix that grows by columns; the columns are padded with zeros.
#[derive(Debug, Clone, PartialEq)]
pub struct Slab {
    rows: usize,
    pub(crate) stride: usize,
    pub(crate) values: Vec<f64>,
}

impl Default for Slab {
    /// 0 x 0.
    fn default() -> Self {
        Self::zeros(0, 0)
    }
}

impl Slab {
    /// Zeros, n x p.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        let stride = padded(rows).max(LANES);
        Self { rows, stride, values: vec![0.0; stride * columns] }
    }

    /// From its entries, n x p.
    pub fn from_fn(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let mut slab = Self::zeros(rows, columns);
        for j in 0..columns {
            slab.column_mut(j)[..rows].iter_mut().enumerate().for_each(|(i, value)| *value = entry(i, j));
        }
        slab
    }

    /// Number of rows, the padding not counted.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.values.len() / self.stride
    }

    /// Length of a vector that the kernels take beside the columns.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Column `j`, padding included.
    pub fn column(&self, j: usize) -> &[f64] {
        &self.values[j * self.stride..(j + 1) * self.stride]
    }

    /// Column `j`, padding included: what is written there takes part.
    pub fn column_mut(&mut self, j: usize) -> &mut [f64] {
        &mut self.values[j * self.stride..(j + 1) * self.stride]
    }

    /// Columns `j` and `j + 1`.
    pub fn pair_mut(&mut self, j: usize) -> (&mut [f64], &mut [f64]) {
        self.values[j * self.stride..(j + 2) * self.stride].split_at_mut(self.stride)
    }

    /// Appends a column of the padded length.
    pub fn push(&mut self, column: &[f64]) {
        debug_assert_eq!(column.len(), self.stride);
        self.values.extend_from_slice(column);
    }

    /// Makes it `rows` x `columns` in its own place: what was there as far as both go, and zeros.
    pub fn resize(&mut self, rows: usize, columns: usize) {
        let (before, kept) = (self.stride, self.columns().min(columns));
        let (stride, height) = (padded(rows).max(LANES), self.rows.min(rows));
        let place = |values: &mut Vec<f64>, j: usize| {
            if stride != before {
                values.copy_within(j * before..j * before + height, j * stride);
            }
            values[j * stride + height..(j + 1) * stride].fill(0.0);
        };
        if stride <= before {
            (0..kept).for_each(|j| place(&mut self.values, j));
            self.values.truncate(kept * stride);
            self.values.resize(columns * stride, 0.0);
        } else {
            self.values.truncate(kept * before);
            self.values.resize(columns * stride, 0.0);
            (0..kept).rev().for_each(|j| place(&mut self.values, j));
            self.values[kept * stride..].fill(0.0);
        }
        (self.rows, self.stride) = (rows, stride);
    }

    /// Drops the last column.
    pub fn pop(&mut self) {
        self.values.truncate(self.values.len() - self.stride);
    }

    /// The matrix without its padding.
    pub fn as_mat(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice_with_stride(&self.values, self.rows, self.columns(), self.stride)
    }

    /// The matrix without its padding, to be written.
    pub fn as_mat_mut(&mut self) -> MatMut<'_, f64> {
        let (rows, columns, stride) = (self.rows, self.columns(), self.stride);
        MatMut::from_column_major_slice_with_stride_mut(&mut self.values, rows, columns, stride)
    }

    /// Keeps some of the columns and the rows at the same places, ascending, in its own place.
    ///
    /// # Panics
    /// When a place does not exist.
    pub fn retain(&mut self, places: &[usize]) {
        for (to, &from) in places.iter().enumerate() {
            let (head, tail) = self.values.split_at_mut(from * self.stride);
            if to == from {
                let column = &mut tail[..self.stride];
                places.iter().enumerate().for_each(|(row, &place)| column[row] = column[place]);
            } else {
                let column = &mut head[to * self.stride..(to + 1) * self.stride];
                column.iter_mut().zip(places).for_each(|(entry, &place)| *entry = tail[place]);
            }
        }
        self.resize(places.len(), places.len());
    }

    /// `target -= self x`, x of as many entries as there are columns.
    pub fn subtract(&self, x: &[f64], target: &mut [f64]) {
        self.subtract_below(0, x, target);
    }

    /// [`Slab::subtract`] on the rows from `first` on (and some before, up to whole vectors).
    pub fn subtract_below(&self, first: usize, x: &[f64], target: &mut [f64]) {
        debug_assert_eq!((x.len(), target.len()), (self.columns(), self.stride));
        let first = (first / LANES * LANES).min(self.stride);
        fleetfoot_data::arch().dispatch(Subtract { slab: self, first, x, target, place: |k| k });
    }

    /// [`Slab::subtract`] of some of the columns, by their entries of x.
    pub fn subtract_columns(&self, columns: &[usize], x: &[f64], target: &mut [f64]) {
        debug_assert_eq!((x.len(), target.len()), (columns.len(), self.stride));
        fleetfoot_data::arch().dispatch(Subtract { slab: self, first: 0, x, target, place: |k| columns[k] });
    }

    /// Exchanges two columns.
    pub fn swap_columns(&mut self, j: usize, k: usize) {
        let (first, last) = (j.min(k), j.max(k));
        if first != last {
            let (head, tail) = self.values.split_at_mut(last * self.stride);
            head[first * self.stride..(first + 1) * self.stride].swap_with_slice(&mut tail[..self.stride]);
        }
    }

    /// Exchanges two rows.
    pub fn swap_rows(&mut self, i: usize, k: usize) {
        if i != k {
            self.values.chunks_exact_mut(self.stride).for_each(|column| column.swap(i, k));
        }
    }

    /// `out_j = column_j . x`; of many columns in parallel.
    pub fn products(&self, x: &[f64], out: &mut [f64]) {
        debug_assert_eq!(x.len(), self.stride);
        let piece = (PIECE / self.stride).max(1);
        if out.len() <= 2 * piece {
            return fleetfoot_data::arch().dispatch(Products { slab: self, first: 0, x, out });
        }
        parallel_pieces(out, piece, |at, out| {
            fleetfoot_data::arch().dispatch(Products { slab: self, first: at * piece, x, out });
        });
    }

    /// Calls `fill` with the number of the first and the values (padding included) of some neighbouring columns, in parallel until all are filled; what it
    /// says of them, in their order.
    pub fn fill_columns<R: Send>(
        &mut self,
        at_once: usize,
        fill: impl Fn(usize, &mut [f64]) -> Vec<R> + Sync,
    ) -> Vec<R> {
        let at_once = at_once.max(1);
        let filled =
            parallel_pieces(&mut self.values, at_once * self.stride, |piece, values| fill(piece * at_once, values));
        filled.into_iter().flatten().collect()
    }
}

/// `x . y`, both padded to the same whole number of vectors.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    fleetfoot_data::arch().dispatch(Dot { x, y })
}

/// `y += factor x`, both padded to the same whole number of vectors.
pub fn add_scaled(factor: f64, x: &[f64], y: &mut [f64]) {
    fleetfoot_data::arch().dispatch(AddScaled { factor, x, y });
}

/// Euclidean norm, safe against overflow and underflow of the squares.
///
/// Squares are divided by that of the largest value only where they could leave the range.
pub fn norm<I>(values: I) -> f64
where
    I: IntoIterator<Item: Borrow<f64>, IntoIter: Clone>,
{
    let values = values.into_iter().map(|value| *Borrow::<f64>::borrow(&value));
    let largest = values.clone().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    if (1e-140..1e140).contains(&largest) {
        return values.map(|value| value * value).sum::<f64>().sqrt();
    }
    largest * values.map(|value| (value / largest) * (value / largest)).sum::<f64>().sqrt()
}

/// Values of a vector of any length that are taken by whole vectors: those of many, down to the last whole one.
fn wide(length: usize) -> usize {
    if length >= MANY_COLUMNS { length / LANES * LANES } else { 0 }
}

/// `x . y`, both of any one length.
pub(crate) fn dot_any(x: &[f64], y: &[f64]) -> f64 {
    let ((x, x_tail), (y, y_tail)) = (x.split_at(wide(x.len())), y.split_at(wide(y.len())));
    let tail: f64 = x_tail.iter().zip(y_tail).map(|(x, y)| x * y).sum();
    if x.is_empty() { tail } else { dot(x, y) + tail }
}

/// `y += factor x`, both of any one length.
pub(crate) fn add_scaled_any(factor: f64, x: &[f64], y: &mut [f64]) {
    let ((x, x_tail), (y, y_tail)) = (x.split_at(wide(x.len())), y.split_at_mut(wide(y.len())));
    if !x.is_empty() {
        add_scaled(factor, x, y);
    }
    y_tail.iter_mut().zip(x_tail).for_each(|(y, x)| *y += factor * x);
}

struct Subtract<'a, P> {
    slab: &'a Slab,
    first: usize,
    x: &'a [f64],
    target: &'a mut [f64],
    /// The column of every entry of x.
    place: P,
}

impl<P: Fn(usize) -> usize> WithSimd for Subtract<'_, P> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { slab, first, x, target, place } = self;
        let stride = slab.stride;
        let (target, _) = S::as_mut_simd_f64s(&mut target[first..]);
        let part = |k: usize| {
            let column = place(k) * stride;
            S::as_simd_f64s(&slab.values[column + first..column + stride]).0
        };
        let fours = x.len() / 4 * 4;
        // Four columns at once: a quarter of the traffic of the target.
        for k in (0..fours).step_by(4) {
            let [c0, c1, c2, c3] = [k, k + 1, k + 2, k + 3].map(part);
            let x = [-x[k], -x[k + 1], -x[k + 2], -x[k + 3]].map(|x| simd.splat_f64s(x));
            for ((((value, c0), c1), c2), c3) in target.iter_mut().zip(c0).zip(c1).zip(c2).zip(c3) {
                let first = simd.mul_add_f64s(*c0, x[0], simd.mul_f64s(*c1, x[1]));
                let second = simd.mul_add_f64s(*c2, x[2], simd.mul_f64s(*c3, x[3]));
                *value = simd.add_f64s(*value, simd.add_f64s(first, second));
            }
        }
        for k in fours..x.len() {
            let x = simd.splat_f64s(-x[k]);
            for (value, c) in target.iter_mut().zip(part(k)) {
                *value = simd.mul_add_f64s(*c, x, *value);
            }
        }
    }
}

/// `x <- R^-1 x` for an upper triangle R, given by its columns; as many as x has entries.
pub fn solve_upper<'r>(column: impl Fn(usize) -> &'r [f64], x: &mut [f64]) {
    for k in (0..x.len()).rev() {
        let entries = column(k);
        x[k] /= entries[k];
        let known = x[k];
        add_scaled_any(-known, &entries[..k], &mut x[..k]);
    }
}

/// `x <- R^-T x` for an upper triangle R, given by its columns; as many as x has entries.
pub fn solve_upper_transposed<'r>(column: impl Fn(usize) -> &'r [f64], x: &mut [f64]) {
    for k in 0..x.len() {
        let entries = column(k);
        x[k] = (x[k] - dot_any(&x[..k], &entries[..k])) / entries[k];
    }
}

/// The least length of `R diag(1/units) x` over unit x for an upper triangle R, given by its columns, from above and usually within a factor of two: inverse
/// iteration. As many columns as there are units; 0 where one has nothing on the diagonal.
pub fn least_length<'r>(column: impl Fn(usize) -> &'r [f64], units: &[f64]) -> f64 {
    let k = units.len();
    if (0..k).any(|j| column(j)[j] == 0.0) {
        return 0.0;
    }
    // A start with a component along everything, the same every time.
    let mut x: Vec<f64> =
        (0..k).map(|i| if i.is_multiple_of(2) { 1.0 } else { -1.0 } * (1.0 + 0.1 * (i % 7) as f64)).collect();
    let mut growth = f64::MIN_POSITIVE;
    for _ in 0..4 {
        let length = norm(x.iter().copied());
        x.iter_mut().zip(units).for_each(|(x, unit)| *x *= unit / length);
        solve_upper_transposed(&column, &mut x);
        solve_upper(&column, &mut x);
        x.iter_mut().zip(units).for_each(|(x, unit)| *x *= unit);
        growth = norm(x.iter().copied());
    }
    growth.sqrt().recip()
}

/// `x <- U^-1 x` and `y <- U^-1 y` for an upper triangle, column by column.
pub fn substitute_back(u: &[Vec<f64>], x: &mut [f64], y: &mut [f64]) {
    fleetfoot_data::arch().dispatch(SubstituteBack { u, x, y });
}

struct SubstituteBack<'a> {
    u: &'a [Vec<f64>],
    x: &'a mut [f64],
    y: &'a mut [f64],
}

impl WithSimd for SubstituteBack<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { u, x, y } = self;
        for k in (0..u.len()).rev() {
            let column = &u[k];
            x[k] /= column[k];
            y[k] /= column[k];
            let minus = [simd.splat_f64s(-x[k]), simd.splat_f64s(-y[k])];
            let (xk, yk) = (x[k], y[k]);
            let (columns, column_tail) = S::as_simd_f64s(&column[..k]);
            let (xs, x_tail) = S::as_mut_simd_f64s(&mut x[..k]);
            let (ys, y_tail) = S::as_mut_simd_f64s(&mut y[..k]);
            for ((x, y), u) in xs.iter_mut().zip(ys).zip(columns) {
                *x = simd.mul_add_f64s(*u, minus[0], *x);
                *y = simd.mul_add_f64s(*u, minus[1], *y);
            }
            for ((x, y), u) in x_tail.iter_mut().zip(y_tail).zip(column_tail) {
                *x -= u * xk;
                *y -= u * yk;
            }
        }
    }
}

struct Products<'a> {
    slab: &'a Slab,
    first: usize,
    x: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let columns = self.slab.values[self.first * self.slab.stride..].chunks_exact(self.slab.stride);
        for (out, column) in self.out.iter_mut().zip(columns) {
            *out = dot_in(simd, column, self.x);
        }
    }
}

struct Dot<'a> {
    x: &'a [f64],
    y: &'a [f64],
}

impl WithSimd for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        dot_in(simd, self.x, self.y)
    }
}

struct AddScaled<'a> {
    factor: f64,
    x: &'a [f64],
    y: &'a mut [f64],
}

impl WithSimd for AddScaled<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        add_scaled_in(simd, self.factor, self.x, self.y);
    }
}

/// [`add_scaled`] inside of a kernel.
#[inline(always)]
pub fn add_scaled_in<S: Simd>(simd: S, factor: f64, x: &[f64], y: &mut [f64]) {
    let (x, _) = S::as_simd_f64s(x);
    let (y, _) = S::as_mut_simd_f64s(y);
    let factor = simd.splat_f64s(factor);
    for (y, x) in y.iter_mut().zip(x) {
        *y = simd.mul_add_f64s(*x, factor, *y);
    }
}

/// [`dot`] inside of a kernel.
#[inline(always)]
pub fn dot_in<S: Simd>(simd: S, x: &[f64], y: &[f64]) -> f64 {
    let (x, _) = S::as_simd_f64s(x);
    let (y, _) = S::as_simd_f64s(y);
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (x4, x1) = pulp::as_arrays::<4, _>(x);
    let (y4, y1) = pulp::as_arrays::<4, _>(y);
    for (x, y) in x4.iter().zip(y4) {
        for k in 0..4 {
            sums[k] = simd.mul_add_f64s(x[k], y[k], sums[k]);
        }
    }
    for (x, y) in x1.iter().zip(y1) {
        sums[0] = simd.mul_add_f64s(*x, *y, sums[0]);
    }
    let pairs = (simd.add_f64s(sums[0], sums[1]), simd.add_f64s(sums[2], sums[3]));
    simd.reduce_sum_f64s(simd.add_f64s(pairs.0, pairs.1))
}

/// `out = constants + sum_j matrix[j, ..] * features[j]`, summed in the order of j.
///
/// `matrix` holds one row of `out.len()` values per feature; `out.len()` is a multiple of [`LANES`].
#[inline(always)]
pub fn affine(matrix: &[f64], constants: &[f64], features: &[f64], out: &mut [f64]) {
    assert!(
        out.len().is_multiple_of(LANES) && constants.len() == out.len() && matrix.len() >= features.len() * out.len(),
        "a row of coefficients for every feature"
    );
    let mut from = 0;
    while from < out.len() {
        // As many sums side by side as there are: every feature is fetched once, and the additions overlap.
        from += match (out.len() - from) / LANES {
            1 => panel::<{ LANES }>(matrix, constants, features, from, out),
            2 => panel::<{ 2 * LANES }>(matrix, constants, features, from, out),
            3 => panel::<{ 3 * LANES }>(matrix, constants, features, from, out),
            4 => panel::<{ 4 * LANES }>(matrix, constants, features, from, out),
            5 => panel::<{ 5 * LANES }>(matrix, constants, features, from, out),
            6 => panel::<{ 6 * LANES }>(matrix, constants, features, from, out),
            _ => panel::<{ 7 * LANES }>(matrix, constants, features, from, out),
        };
    }
}

/// The outputs `from..from + N` of [`affine`], which has checked the lengths; gives N.
#[inline(always)]
fn panel<const N: usize>(matrix: &[f64], constants: &[f64], features: &[f64], from: usize, out: &mut [f64]) -> usize {
    let width = out.len();
    let mut sum = load::<N>(&constants[from..from + N]);
    for (j, &feature) in features.iter().enumerate() {
        debug_assert!(j * width + from + N <= matrix.len());
        // SAFETY: the matrix has at least `features.len() * width` values (asserted by the only caller), j is below `features.len()`, and
        // `from + N <= width` (the constants, of that length, were sliced to it above). An array of N values needs no more alignment than one.
        let row = unsafe { &*matrix.as_ptr().add(j * width + from).cast::<[f64; N]>() };
        for i in 0..N {
            sum[i] = row[i].mul_add(feature, sum[i]);
        }
    }
    out[from..from + N].copy_from_slice(&sum);
    N
}

/// The first `N` values of a slice of at least that length.
#[inline(always)]
pub fn load<const N: usize>(values: &[f64]) -> [f64; N] {
    let mut loaded = [0.0; N];
    loaded.copy_from_slice(&values[..N]);
    loaded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resized_slab_keeps_its_content() {
        let entry = |i: usize, j: usize| (10 * i + j + 1) as f64;
        for (rows, columns) in [(3, 4), (9, 2), (17, 30)] {
            for (more, wider) in [(3, 4), (8, 1), (9, 9), (40, 31), (0, 0), (2, 50)] {
                let mut slab = Slab::from_fn(rows, columns, entry);
                slab.resize(more, wider);
                let kept = |i: usize, j: usize| if i < rows && j < columns { entry(i, j) } else { 0.0 };
                assert_eq!(slab, Slab::from_fn(more, wider, kept), "{rows}x{columns} {more}x{wider}");
            }
        }
    }

    #[test]
    fn products_and_sums_match_plain_loops() {
        for (rows, columns) in [(1, 1), (7, 3), (8, 4), (37, 11), (64, 9)] {
            let slab = Slab::from_fn(rows, columns, |i, j| ((3 * i + 5 * j) % 7) as f64 - 2.0);
            let x: Vec<f64> = (0..columns).map(|j| j as f64 - 1.5).collect();
            let mut target = vec![0.0; slab.stride()];
            target[..rows].fill(1.0);
            slab.subtract(&x, &mut target);
            for i in 0..rows {
                let plain: f64 = 1.0 - (0..columns).map(|j| slab.column(j)[i] * x[j]).sum::<f64>();
                assert_eq!(target[i], plain);
            }
            assert!(target[rows..].iter().all(|&value| value == 0.0));
            let mut below = vec![0.0; slab.stride()];
            below[..rows].fill(1.0);
            slab.subtract_below(rows / 2, &x, &mut below);
            assert_eq!(below[rows / 2..], target[rows / 2..]);
            let mut out = vec![0.0; columns];
            slab.products(&target, &mut out);
            for j in 0..columns {
                let plain: f64 = (0..rows).map(|i| slab.column(j)[i] * target[i]).sum();
                assert_eq!(out[j], plain);
                assert_eq!(dot(slab.column(j), &target), plain);
            }
            let before = target.clone();
            add_scaled(-2.0, slab.column(0), &mut target);
            assert!((0..rows).all(|i| target[i] == before[i] - 2.0 * slab.column(0)[i]));
        }
    }

    #[test]
    fn affine_is_the_plain_sum_at_every_width() {
        for width in [8, 16, 24, 32, 40, 48, 56, 64, 104, 120] {
            let features: Vec<f64> = (0..5).map(|j| f64::from(j) * 0.7 - 1.1).collect();
            let matrix: Vec<f64> = (0..5 * width).map(|i| (i as f64 * 0.37).sin()).collect();
            let constants: Vec<f64> = (0..width).map(|i| i as f64).collect();
            let mut out = vec![0.0; width];
            affine(&matrix, &constants, &features, &mut out);
            for o in 0..width {
                let expected = (0..5).fold(constants[o], |sum, j| matrix[j * width + o].mul_add(features[j], sum));
                assert_eq!(out[o].to_bits(), expected.to_bits());
            }
        }
    }

    #[test]
    fn the_norm_does_not_overflow() {
        assert!((norm([3e200, 4e200]) / 5e200 - 1.0).abs() < 1e-15);
        assert!((norm([3e-200, 4e-200].as_slice()) / 5e-200 - 1.0).abs() < 1e-15);
        assert_eq!(norm([3.0, 4.0]), 5.0);
        assert_eq!(norm([0.0_f64; 0]), 0.0);
        assert_eq!(norm([f64::INFINITY, 1.0]), f64::INFINITY);
    }
}

//! Tiles: a fixed number of rows of a few columns, copied, centred and multiplied in cache.

use std::ops::Range;

use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::triangular::BlockStructure};
use pulp::{Simd, WithSimd};

/// Rows of one tile. Fixed, because the grouping of the sums decides their last bits.
pub(crate) const TILE: usize = 512;
/// Columns up to which the kernel below beats the general matrix product.
const FEW_COLUMNS: usize = 128;
/// Columns are padded to whole vectors of the widest instruction set.
const LANES: usize = 8;
/// Columns whose distance is a multiple of this compete for the same lines of the first-level cache.
const ALIAS: usize = 64;
/// Columns are padded to whole blocks of the product.
const BLOCK: usize = 4;
/// Left and right columns of a block of the product: 3 x 8 sums stay in registers, 3 x 4 where there are sixteen. The right ones stay in first-level cache while all left ones pass, so
/// that there should be more of them.
const LEFT: usize = 3;
const RIGHT: usize = 8;

/// Rows of a design: d columns of equal length, with or without weights.
pub(crate) struct Columns<'a> {
    pub(crate) columns: Vec<&'a [f64]>,
    pub(crate) weights: Option<&'a [f64]>,
}

/// Up to [`TILE`] centred rows, column-major, times the roots of their weights.
pub(crate) struct Tile {
    columns: usize,
    /// Distance of the columns in `values`: the rows, up to whole vectors, and zeros behind them.
    stride: usize,
    values: Vec<f64>,
    roots: Vec<f64>,
    /// Sum of the weights.
    pub(crate) weight: f64,
    /// Centre subtracted from each column.
    pub(crate) centre: Vec<f64>,
    /// Weighted mean of the remainder after the subtraction: the rounding of `centre`.
    pub(crate) remainder: Vec<f64>,
    /// Lower triangle of the products, row-major, `padded x padded`.
    product: Vec<f64>,
}

impl Tile {
    pub(crate) fn new(columns: usize) -> Self {
        let padded = columns.next_multiple_of(BLOCK);
        Self {
            columns,
            stride: 0,
            values: vec![0.0; padded * (TILE + LANES)],
            roots: vec![0.0; TILE],
            weight: 0.0,
            centre: vec![0.0; columns],
            remainder: vec![0.0; columns],
            product: vec![0.0; padded * padded],
        }
    }

    /// Takes at most [`TILE`] rows, subtracts its weighted mean from every column, multiplies the rows by the roots of their weights, and
    /// forms all products of two columns ([`Tile::product`]).
    pub(crate) fn multiply(&mut self, design: &Columns<'_>, rows: Range<usize>) {
        let padded = self.columns.next_multiple_of(BLOCK);
        self.stride = rows.len().next_multiple_of(LANES);
        if self.stride.is_multiple_of(ALIAS) {
            self.stride += LANES;
        }
        // The product reads the columns of padding, wherever the stride puts them.
        self.values[self.columns * self.stride..padded * self.stride].fill(0.0);
        self.weight = match design.weights {
            None => rows.len() as f64,
            Some(weights) => {
                self.roots.iter_mut().zip(&weights[rows.clone()]).for_each(|(root, weight)| *root = weight.sqrt());
                weights[rows.clone()].iter().sum()
            }
        };
        let arch = fleetfoot_data::arch();
        let few = self.columns <= FEW_COLUMNS;
        arch.dispatch(Centre { tile: self, design, rows });
        if few {
            arch.dispatch(Multiply {
                values: &self.values,
                stride: self.stride,
                columns: padded,
                product: &mut self.product,
            });
        } else {
            let x = MatRef::from_column_major_slice(&self.values[..padded * self.stride], self.stride, padded);
            faer::linalg::matmul::triangular::matmul(
                MatMut::from_row_major_slice_mut(&mut self.product, padded, padded),
                BlockStructure::TriangularLower,
                Accum::Replace,
                x.transpose(),
                BlockStructure::Rectangular,
                x,
                BlockStructure::Rectangular,
                1.0,
                Par::Seq,
            );
        }
    }

    /// The weighted sum of the products of the centred columns `i >= j`.
    #[inline(always)]
    pub(crate) fn product(&self, i: usize, j: usize) -> f64 {
        self.product[i * self.columns.next_multiple_of(BLOCK) + j]
    }
}

/// Copies the rows into the tile, centred: one pass for the mean, one for the rest.
struct Centre<'a> {
    tile: &'a mut Tile,
    design: &'a Columns<'a>,
    rows: Range<usize>,
}

impl WithSimd for Centre<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { tile, design, rows } = self;
        let (n, stride) = (rows.len(), tile.stride);
        for (j, column) in design.columns.iter().enumerate() {
            let source = &column[rows.start..rows.end];
            let target = &mut tile.values[j * stride..(j + 1) * stride];
            target[n..].fill(0.0);
            let target = &mut target[..n];
            let (centre, remainder) = match design.weights {
                None => {
                    let centre = sum(simd, source) / tile.weight;
                    (centre, subtract(simd, source, centre, target))
                }
                Some(weights) => {
                    let weights = &weights[rows.start..rows.end];
                    let centre = weighted_sum(simd, source, weights) / tile.weight;
                    (centre, subtract_weighted(simd, source, centre, weights, &tile.roots[..n], target))
                }
            };
            tile.centre[j] = centre;
            tile.remainder[j] = remainder / tile.weight;
        }
    }
}

#[inline(always)]
fn total<S: Simd>(simd: S, sums: [S::f64s; 4], tail: f64) -> f64 {
    let pairs = (simd.add_f64s(sums[0], sums[1]), simd.add_f64s(sums[2], sums[3]));
    simd.reduce_sum_f64s(simd.add_f64s(pairs.0, pairs.1)) + tail
}

#[inline(always)]
fn sum<S: Simd>(simd: S, values: &[f64]) -> f64 {
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (vectors, tail) = S::as_simd_f64s(values);
    let (fours, rest) = pulp::as_arrays::<4, _>(vectors);
    for four in fours {
        for k in 0..4 {
            sums[k] = simd.add_f64s(sums[k], four[k]);
        }
    }
    for v in rest {
        sums[0] = simd.add_f64s(sums[0], *v);
    }
    total(simd, sums, tail.iter().sum())
}

#[inline(always)]
fn weighted_sum<S: Simd>(simd: S, values: &[f64], weights: &[f64]) -> f64 {
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (vectors, tail) = S::as_simd_f64s(values);
    let (weight_vectors, weight_tail) = S::as_simd_f64s(weights);
    for (k, (v, w)) in vectors.iter().zip(weight_vectors).enumerate() {
        sums[k % 4] = simd.mul_add_f64s(*v, *w, sums[k % 4]);
    }
    let mut last = 0.0;
    for (v, w) in tail.iter().zip(weight_tail) {
        last += v * w;
    }
    total(simd, sums, last)
}

/// `target = source - centre`; returns the sum of the target.
#[inline(always)]
fn subtract<S: Simd>(simd: S, source: &[f64], centre: f64, target: &mut [f64]) -> f64 {
    let splat = simd.splat_f64s(centre);
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (from, from_tail) = S::as_simd_f64s(source);
    let (to, to_tail) = S::as_mut_simd_f64s(target);
    let (from_fours, from_rest) = pulp::as_arrays::<4, _>(from);
    let (to_fours, to_rest) = pulp::as_arrays_mut::<4, _>(to);
    for (to, from) in to_fours.iter_mut().zip(from_fours) {
        for k in 0..4 {
            to[k] = simd.sub_f64s(from[k], splat);
            sums[k] = simd.add_f64s(sums[k], to[k]);
        }
    }
    for (to, from) in to_rest.iter_mut().zip(from_rest) {
        *to = simd.sub_f64s(*from, splat);
        sums[0] = simd.add_f64s(sums[0], *to);
    }
    let mut last = 0.0;
    for (to, from) in to_tail.iter_mut().zip(from_tail) {
        *to = from - centre;
        last += *to;
    }
    total(simd, sums, last)
}

/// `target = root (source - centre)`; returns the weighted sum of `source - centre`.
#[inline(always)]
fn subtract_weighted<S: Simd>(
    simd: S,
    source: &[f64],
    centre: f64,
    weights: &[f64],
    roots: &[f64],
    target: &mut [f64],
) -> f64 {
    let splat = simd.splat_f64s(centre);
    let mut sums = [simd.splat_f64s(0.0); 4];
    let (from, from_tail) = S::as_simd_f64s(source);
    let (to, to_tail) = S::as_mut_simd_f64s(target);
    let (w, w_tail) = S::as_simd_f64s(weights);
    let (root, root_tail) = S::as_simd_f64s(roots);
    for k in 0..to.len() {
        let value = simd.sub_f64s(from[k], splat);
        sums[k % 4] = simd.mul_add_f64s(value, w[k], sums[k % 4]);
        to[k] = simd.mul_f64s(value, root[k]);
    }
    let mut last = 0.0;
    for k in 0..to_tail.len() {
        let value = from_tail[k] - centre;
        last += value * w_tail[k];
        to_tail[k] = value * root_tail[k];
    }
    total(simd, sums, last)
}

/// Products of all pairs of a few columns: blocks of dot products whose sums stay in registers. Every sum has the same order whatever the block.
///
/// The general matrix product spends most of its time on packing and dispatch when there are a hundred rows of twenty columns,
/// which is what a region of a chunk looks like.
struct Multiply<'a> {
    values: &'a [f64],
    stride: usize,
    columns: usize,
    product: &'a mut [f64],
}

impl WithSimd for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { values, stride, columns, product } = self;
        // Instruction sets before AVX-512 have half of the registers.
        if S::REGISTER_COUNT >= 32 {
            blocks::<S, LEFT, RIGHT>(simd, (values, stride), (product, columns));
        } else {
            blocks::<S, LEFT, BLOCK>(simd, (values, stride), (product, columns));
        }
    }
}

/// All products of columns `i >= j`, in blocks of `A` left and `B` right columns.
#[inline(always)]
fn blocks<S: Simd, const A: usize, const B: usize>(
    simd: S,
    (values, stride): (&[f64], usize),
    (product, columns): (&mut [f64], usize),
) {
    let mut j = 0;
    while j + B <= columns {
        let mut i = j;
        while i + A <= columns {
            dots::<S, A, B>(simd, (values, stride), (i, j), (product, columns));
            i += A;
        }
        while i < columns {
            dots::<S, 1, B>(simd, (values, stride), (i, j), (product, columns));
            i += 1;
        }
        j += B;
    }
    while j < columns {
        for i in (j..columns).step_by(BLOCK) {
            dots::<S, BLOCK, BLOCK>(simd, (values, stride), (i, j), (product, columns));
        }
        j += BLOCK;
    }
}

/// Columns `first..first + N`, as vectors.
#[inline(always)]
fn columns_of<S: Simd, const N: usize>(values: &[f64], stride: usize, first: usize) -> [&[S::f64s]; N] {
    let mut columns: [&[S::f64s]; N] = [&[]; N];
    for k in 0..N {
        columns[k] = S::as_simd_f64s(&values[(first + k) * stride..(first + k + 1) * stride]).0;
    }
    columns
}

/// Products of the columns `i + k` and `j + l`.
#[inline(always)]
fn dots<S: Simd, const A: usize, const B: usize>(
    simd: S,
    (values, stride): (&[f64], usize),
    (i, j): (usize, usize),
    (product, columns): (&mut [f64], usize),
) {
    let mut left = columns_of::<S, A>(values, stride, i);
    let mut right = columns_of::<S, B>(values, stride, j);
    let length = right[0].len();
    // Equal lengths, stated once, spare the bounds checks in the loop.
    for k in 0..A {
        left[k] = &left[k][..length];
    }
    for l in 0..B {
        right[l] = &right[l][..length];
    }
    let mut sums = [[simd.splat_f64s(0.0); B]; A];
    for row in 0..length {
        // The shorter side is held: 3 x 4 sums, three vectors and a passing one are sixteen registers.
        let mut a = [simd.splat_f64s(0.0); A];
        for k in 0..A {
            a[k] = left[k][row];
        }
        for l in 0..B {
            let b = right[l][row];
            for k in 0..A {
                sums[k][l] = simd.mul_add_f64s(a[k], b, sums[k][l]);
            }
        }
    }
    for k in 0..A {
        for l in 0..B {
            product[(i + k) * columns + j + l] = simd.reduce_sum_f64s(sums[k][l]);
        }
    }
}

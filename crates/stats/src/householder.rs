//! Orthogonal reductions: rows folded into a triangle, and the rank-revealing factorisation of a triangle.
//!
//! Rows that exceed a processor's cache are reduced by blocks of reflectors (`blocked`).
//!
//! faer's unpivoted QR (0.24) drops columns whose remainder is below `16 n eps`, so that its R is an echelon form. A remainder of
//! `1e-12` is data here, and the decision about rank is taken elsewhere, once, with the noise of every column at hand.

use faer::Mat;
use fleetfoot_data::{checkpoint, parallel_pieces};
use pulp::{Simd, WithSimd};

use crate::kernel::{
    self, COLUMNS_AT_ONCE, LANES, MANY_COLUMNS, Slab, add_scaled_any, add_scaled_in, dot_any, dot_in, norm, padded,
};

mod blocked;

/// The reflector `I - beta u u'`, `u = (1, v / first)`, that sends (alpha, v) to (-sign(alpha) length, 0).
struct Reflection {
    length: f64,
    first: f64,
    beta: f64,
}

impl Reflection {
    /// `below` is the length of v. `I - u u' / (u'u / 2)` with u = (alpha + sign(alpha) length, v), divided through by its first entry.
    fn of(alpha: f64, below: f64) -> Self {
        let length = alpha.hypot(below);
        let first = alpha + length.copysign(alpha);
        let ratio = below / first;
        Self { length, first, beta: 2.0 / (1.0 + ratio * ratio) }
    }
}

/// Replaces x by the vector u, `u_0 = 1`, of the Householder reflector `I - beta u u'` that sends x to a multiple of the first unit vector; that multiple,
/// and beta. `None` where x has nothing but its first entry.
pub fn reflector(x: &mut [f64]) -> Option<(f64, f64)> {
    let (alpha, below) = (*x.first()?, norm(&x[1..]));
    if below == 0.0 {
        return None;
    }
    let Reflection { length, first, beta } = Reflection::of(alpha, below);
    x.iter_mut().for_each(|value| *value /= first);
    x[0] = 1.0;
    Some((-length.copysign(alpha), beta))
}

/// Folds the rows of `rows` (m x d) into the triangle `r` (k x d, its first k columns upper triangular): afterwards `r` is the first
/// k rows of `Q' [r; rows]`, and `rows` holds zeros in its first k columns and the remaining rows of `Q'[r; rows]` in the others.
///
/// Columns beyond k are right-hand sides. One Householder reflector per column, applied to the triangle's row k and to all rows
/// (the "triangle on top of a rectangle" step of TSQR): the backward error of every column is of the order of eps times its norm.
/// Diagonal entries come out not negative.
pub fn fold_rows(r: &mut Mat<f64>, rows: &mut Slab) {
    assert_eq!(r.ncols(), rows.columns(), "the same columns");
    if blocked::pays(rows) {
        return blocked::fold_rows(r, rows);
    }
    let (to, until) = (r.nrows(), r.ncols());
    fleetfoot_data::arch().dispatch(Fold { r, rows, from: 0, to, until });
    rows.values[..to * rows.stride].fill(0.0);
}

/// One step of [`Fold`]: the factor of its reflector (0: none), and the sign by which its row of the triangle was then
/// multiplied.
#[derive(Debug, Clone, Copy)]
struct Step {
    beta: f64,
    sign: f64,
}

/// The reflectors of the columns `from..to`, applied to the columns before `until`; their vectors are left in the rows, without their leading ones.
struct Fold<'a> {
    r: &'a mut Mat<f64>,
    rows: &'a mut Slab,
    from: usize,
    to: usize,
    until: usize,
}

impl WithSimd for Fold<'_> {
    type Output = Vec<Step>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Step> {
        let Self { r, rows, from, to, until } = self;
        let stride = rows.stride;
        let step = |k: usize| {
            checkpoint();
            let (head, tail) = rows.values.split_at_mut((k + 1) * stride);
            let v = &mut head[k * stride..];
            let squares = dot_in(simd, v, v);
            let below = if (1e-280..1e280).contains(&squares) { squares.sqrt() } else { norm(&*v) };
            if below == 0.0 {
                let sign = if r[(k, k)] < 0.0 { -1.0 } else { 1.0 };
                (k..until).for_each(|j| r[(k, j)] *= sign);
                return Step { beta: 0.0, sign };
            }
            let alpha = r[(k, k)];
            let Reflection { length, first, beta } = Reflection::of(alpha, below);
            v.iter_mut().for_each(|value| *value /= first);
            // The reflector sends the column to -sign(alpha) length; the whole row changes sign where that would be negative.
            let sign = if alpha.is_sign_negative() { 1.0 } else { -1.0 };
            r[(k, k)] = length;
            for (j, column) in (k + 1..until).zip(tail.chunks_exact_mut(stride)) {
                let step = beta * (r[(k, j)] + dot_in(simd, v, column));
                r[(k, j)] = sign * (r[(k, j)] - step);
                add_scaled_in(simd, -step, v, column);
            }
            Step { beta, sign }
        };
        (from..to).map(step).collect()
    }
}

/// Reduces a matrix whose column i ends at the row `last[i]` (ascending) to an upper triangle, in place, by one Householder reflector a column;
/// what stands behind these columns are right-hand sides. Diagonal entries have either sign.
///
/// A staircase has few rows to reflect: columns taken out of a triangle, or rows of a diagonal between those of a triangle.
pub fn reduce_columns(values: &mut Slab, last: &[usize]) {
    reduce(values, last, &mut |_, _, _| ());
}

/// Reflectors of a reduction, one a column, in their order.
pub(crate) struct Reflectors(Vec<(usize, f64, Vec<f64>)>);

impl Reflectors {
    /// As [`reduce_columns`], and the reflectors are kept.
    pub(crate) fn of_columns(values: &mut Slab, last: &[usize]) -> Self {
        let mut kept = Vec::with_capacity(last.len());
        reduce(values, last, &mut |column, beta, v| {
            if beta != 0.0 {
                kept.push((column, beta, v.to_vec()));
            }
        });
        Self(kept)
    }

    /// `Q x` in the place of x (as many entries as there were rows), where `Q'` reduced the columns.
    pub(crate) fn apply(&self, x: &mut [f64]) {
        for (first, beta, v) in self.0.iter().rev() {
            let x = &mut x[*first..*first + v.len()];
            let step = beta * dot_any(v, x);
            add_scaled_any(-step, v, x);
        }
    }
}

/// [`reduce_columns`]; `keep` hears of every column, the factor of its reflector, and its vector from the column's own row on.
fn reduce(values: &mut Slab, last: &[usize], keep: &mut dyn FnMut(usize, f64, &[f64])) {
    if blocked::pays(values) {
        return blocked::reduce_columns(values, last, keep);
    }
    let until = values.columns();
    let mut v = vec![0.0; values.stride()];
    for (column, &last) in last.iter().enumerate() {
        let beta = fleetfoot_data::arch().dispatch(Reduce { values, v: &mut v, column, last, until });
        keep(column, beta, v.get(column..=last).unwrap_or(&[]));
    }
}

/// The reflector of a column that ends at the row `last`, applied to the columns before `until`. Its vector is written to v (whole vectors around its rows),
/// its factor is the answer: 0 where there is none, and v then means nothing.
struct Reduce<'a> {
    values: &'a mut Slab,
    v: &'a mut [f64],
    column: usize,
    last: usize,
    until: usize,
}

impl WithSimd for Reduce<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { values, v, column: i, last, until } = self;
        if last <= i {
            return 0.0;
        }
        checkpoint();
        // Whole vectors around the rows of the reflector; it is zero in the others.
        let (from, to) = (i / LANES * LANES, padded(last + 1));
        v[from..to].fill(0.0);
        v[i..=last].copy_from_slice(&values.column(i)[i..=last]);
        let Some((diagonal, beta)) = reflector(&mut v[i..=last]) else { return 0.0 };
        let column = values.column_mut(i);
        column[i..=last].fill(0.0);
        column[i] = diagonal;
        for j in i + 1..until {
            let column = &mut values.column_mut(j)[from..to];
            let step = beta * dot_in(simd, &v[from..to], column);
            add_scaled_in(simd, -step, &v[from..to], column);
        }
        beta
    }
}

/// Column-pivoted QR: `A[:, order] = Q [R11 R12; 0 R22]` with R22 below the noise.
pub(crate) struct Pivoted {
    /// Column of A at each position: first `rank` columns that carry the others, then the rest.
    pub(crate) order: Vec<usize>,
    /// Columns whose pivot stands above `threshold`.
    pub(crate) rank: usize,
    /// R in pivoted order (p x p); rows from `rank` on are not reduced.
    pub(crate) r: Mat<f64>,
    /// `Q'B`.
    pub(crate) rhs: Mat<f64>,
}

/// Householder QR of `a` (m x p) with column pivoting (Businger and Golub 1965), stopped when no remaining column is longer than
/// `threshold`; `rhs` (m x q) is carried along.
///
/// The remaining lengths are computed anew in every step: a third more work than updating them, and no cancellation.
pub(crate) fn pivoted_qr(a: &Mat<f64>, rhs: &Mat<f64>, threshold: f64) -> Pivoted {
    let (m, p) = a.shape();
    let entry = |i: usize, j: usize| if j < p { a[(i, j)] } else { rhs[(i, j - p)] };
    let mut values = Slab::from_fn(m, p + rhs.ncols(), entry);
    let mut lengths: Vec<f64> = (0..p).map(|j| norm(&values.column(j)[..m])).collect();
    let mut order: Vec<usize> = (0..p).collect();
    let mut u = vec![0.0; values.stride()];
    let mut rank = 0;
    while rank < p.min(m) {
        checkpoint();
        let k = rank;
        let longest = |best: (usize, f64), j: usize| if lengths[j] > best.1 { (j, lengths[j]) } else { best };
        // NaN is never the longest.
        let (pivot, length) = (k..p).fold((k, 0.0), longest);
        if length <= threshold || !length.is_finite() {
            break;
        }
        order.swap(k, pivot);
        lengths.swap(k, pivot);
        values.swap_columns(k, pivot);
        u[..k].fill(0.0);
        u[k..m].copy_from_slice(&values.column(k)[k..m]);
        let alpha = u[k];
        let first = alpha + length.copysign(alpha);
        u[k] = first;
        u[k..m].iter_mut().for_each(|value| *value /= first);
        let beta = 2.0 / u[k..m].iter().map(|value| value * value).sum::<f64>();
        let column = values.column_mut(k);
        column[k + 1..].fill(0.0);
        column[k] = -length.copysign(alpha);
        let reflected = reflect_behind(&mut values, &u, beta, k);
        lengths[k + 1..].copy_from_slice(&reflected[..p - k - 1]);
        rank += 1;
    }
    let r = Mat::from_fn(m, p, |i, j| values.column(j)[i]);
    Pivoted { order, rank, r, rhs: Mat::from_fn(m, rhs.ncols(), |i, t| values.column(p + t)[i]) }
}

/// Applies `I - beta u u'` to the columns behind k; the lengths of what then stands below row k. Many columns go on all threads.
fn reflect_behind(values: &mut Slab, u: &[f64], beta: f64, k: usize) -> Vec<f64> {
    let (m, stride) = (values.rows(), values.stride());
    let many = values.columns() >= MANY_COLUMNS;
    let behind = &mut values.values[(k + 1) * stride..];
    if !many {
        let reflected = behind.chunks_exact_mut(stride).map(|column| {
            reflect(&u[k..m], beta, &mut column[k..m]);
            norm(&column[k + 1..m])
        });
        return reflected.collect();
    }
    let lengths = parallel_pieces(behind, COLUMNS_AT_ONCE * stride, |_, columns| {
        fleetfoot_data::arch().dispatch(ReflectBehind { columns, u, beta, k })
    });
    lengths.concat()
}

struct ReflectBehind<'a> {
    /// Padded columns.
    columns: &'a mut [f64],
    /// Padded, zero before k.
    u: &'a [f64],
    beta: f64,
    k: usize,
}

impl WithSimd for ReflectBehind<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
        let Self { columns, u, beta, k } = self;
        // Whole vectors: u is zero in what stands before k.
        let (from, below) = (k / LANES * LANES, padded(k + 1));
        let mut lengths = Vec::with_capacity(columns.len() / u.len());
        for column in columns.chunks_exact_mut(u.len()) {
            let step = beta * dot_in(simd, &u[from..], &column[from..]);
            add_scaled_in(simd, -step, &u[from..], &mut column[from..]);
            let first: f64 = column[k + 1..below].iter().map(|value| value * value).sum();
            let squares = first + dot_in(simd, &column[below..], &column[below..]);
            let plain = (1e-280..1e280).contains(&squares);
            lengths.push(if plain { squares.sqrt() } else { norm(&column[k + 1..]) });
        }
        lengths
    }
}

/// `x -= beta u (u'x)`, with u scaled so that its first entry is 1.
fn reflect(u: &[f64], beta: f64, x: &mut [f64]) {
    let step = beta * u.iter().zip(&*x).map(|(u, x)| u * x).sum::<f64>();
    x.iter_mut().zip(u).for_each(|(x, u)| *x -= step * u);
}

/// Solves `R x = b` in place for the leading `n x n` upper triangle of `r`; every column of `b` is a right-hand side.
pub(crate) fn solve_upper(r: &Mat<f64>, n: usize, b: &mut Mat<f64>) {
    (0..b.ncols()).for_each(|t| kernel::solve_upper(|k| r.col_as_slice(k), &mut b.col_as_slice_mut(t)[..n]));
}

/// Estimate, from below and usually within a few per cent, of the condition number (2-norm) of the leading `n x n` upper triangle of
/// `r` with its columns scaled to unit length: power iteration on R'R and on its inverse. 1 when n is 0.
pub(crate) fn condition(r: &Mat<f64>, n: usize) -> f64 {
    condition_of(|j| r.col_as_slice(j), n)
}

/// [`condition`] of a triangle that is given by its columns.
pub(crate) fn condition_of<'r>(column: impl Fn(usize) -> &'r [f64], n: usize) -> f64 {
    if n == 0 {
        return 1.0;
    }
    let length: Vec<f64> = (0..n).map(|j| length_of(&column(j)[..=j])).collect();
    let many = n >= MANY_COLUMNS;
    // Many columns are scaled on the way.
    let scaled = (!many).then(|| Mat::from_fn(n, n, |i, j| if i <= j { column(j)[i] / length[j] } else { 0.0 }));
    let length = if many { length } else { vec![1.0; n] };
    let unit = |j: usize| scaled.as_ref().map_or_else(|| column(j), |scaled| scaled.col_as_slice(j));
    let scale = |x: &mut [f64]| x.iter_mut().zip(&length).for_each(|(x, length)| *x *= length);
    let mut growth = [1.0_f64; 2];
    for (which, growth) in growth.iter_mut().enumerate() {
        // A start with a component along everything, the same every time.
        let start = |i: usize| (1.0 + 0.37 * ((i * 7 + 3) % 11) as f64) * if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let mut x = Mat::from_fn(n, 1, |i, _| start(i));
        for round in 0..12 {
            checkpoint();
            let (column_norm, last) = (norm(x.col_as_slice(0)), *growth);
            x.col_as_slice_mut(0).iter_mut().for_each(|value| *value /= column_norm);
            if which == 0 {
                multiply_both(unit, &length, x.col_as_slice_mut(0));
            } else {
                scale(x.col_as_slice_mut(0));
                kernel::solve_upper_transposed(unit, x.col_as_slice_mut(0));
                kernel::solve_upper(unit, x.col_as_slice_mut(0));
                scale(x.col_as_slice_mut(0));
            }
            *growth = norm(x.col_as_slice(0));
            // Of many columns every round reads a whole matrix.
            if many && round > 2 && (*growth - last).abs() <= 0.01 * *growth {
                break;
            }
        }
    }
    (growth[0] * growth[1]).sqrt().max(1.0)
}

/// `x = D R'R D x` for an upper triangle, D the inverses of the lengths.
fn multiply_both<'r>(column: impl Fn(usize) -> &'r [f64], length: &[f64], x: &mut [f64]) {
    let mut product = vec![0.0; x.len()];
    for (j, (x, length)) in x.iter().zip(length).enumerate() {
        add_scaled_any(x / length, &column(j)[..=j], &mut product[..=j]);
    }
    for (j, (x, length)) in x.iter_mut().zip(length).enumerate() {
        *x = dot_any(&product[..=j], &column(j)[..=j]) / length;
    }
}

/// The length of a column: by whole vectors where it is long and no square leaves the range.
fn length_of(values: &[f64]) -> f64 {
    if values.len() < MANY_COLUMNS {
        return norm(values);
    }
    let squares = dot_any(values, values);
    if (1e-280..1e280).contains(&squares) { squares.sqrt() } else { norm(values) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(i: usize, j: usize) -> f64 {
        (1.3 * (i * 7 + j * 3) as f64).sin() + 0.1 * j as f64
    }

    #[test]
    fn folding_keeps_inner_products_and_carries_right_hand_sides() {
        let (n, p, d) = (37, 4, 6);
        let mut r = Mat::zeros(p, d);
        let mut left = vec![0.0; d - p];
        for first in (0..n).step_by(10) {
            let rows = 10.min(n - first);
            let mut tile = Slab::zeros(rows, d);
            for j in 0..d {
                (0..rows).for_each(|i| tile.column_mut(j)[i] = value(first + i, j));
            }
            fold_rows(&mut r, &mut tile);
            (p..d).for_each(|j| left[j - p] += tile.column(j).iter().map(|x| x * x).sum::<f64>());
            assert!((0..p).all(|j| tile.column(j).iter().all(|&x| x == 0.0)));
        }
        for a in 0..d {
            for b in 0..=a {
                let direct: f64 = (0..n).map(|i| value(i, a) * value(i, b)).sum();
                let mut folded: f64 = (0..p).map(|k| r[(k, a)] * r[(k, b)]).sum();
                if a >= p && a != b {
                    continue;
                }
                if a >= p {
                    folded += left[a - p];
                }
                assert!((direct - folded).abs() < 1e-12, "{a} {b}: {direct} {folded}");
            }
        }
        assert!((0..p).all(|k| r[(k, k)] >= 0.0 && (0..k).all(|j| r[(k, j)] == 0.0)));
    }

    #[test]
    fn pivoting_finds_the_rank_and_the_condition_is_near() {
        let a = Mat::from_fn(6, 4, |i, j| if j == 2 { value(i, 0) - 2.0 * value(i, 1) } else { value(i, j) });
        let factored = pivoted_qr(&a, &Mat::from_fn(6, 1, |i, _| value(i, 0)), 1e-12);
        assert_eq!(factored.rank, 3);
        for k in 0..4 {
            for l in 0..4 {
                let (u, v) = (factored.order[k], factored.order[l]);
                let direct: f64 = (0..6).map(|i| a[(i, u)] * a[(i, v)]).sum();
                let factored: f64 = (0..3).map(|i| factored.r[(i, k)] * factored.r[(i, l)]).sum();
                assert!((direct - factored).abs() < 1e-13);
            }
        }
        // Many columns, of which but some are independent: the same products.
        let (m, p, rank) = (301, 290, 40);
        let wave = |i: usize, k: usize| (0.731 * (i * (2 * k + 3)) as f64).sin();
        let of = |i: usize, j: usize| (0..rank).map(|k| wave(i, k) * wave(j, k + 1)).sum::<f64>();
        let wide = Mat::from_fn(m, p, of);
        let factored = pivoted_qr(&wide, &Mat::zeros(m, 0), 1e-9);
        assert_eq!(factored.rank, rank);
        for k in (0..p).step_by(17) {
            for l in (0..p).step_by(13) {
                let (u, v) = (factored.order[k], factored.order[l]);
                let direct: f64 = (0..m).map(|i| wide[(i, u)] * wide[(i, v)]).sum();
                let factored: f64 = (0..rank).map(|i| factored.r[(i, k)] * factored.r[(i, l)]).sum();
                assert!((direct - factored).abs() < 1e-10 * direct.abs().max(1.0), "{direct} {factored}");
            }
        }
        // [1 c; 0 s] with c^2 + s^2 = 1 has singular values sqrt(1 +- c).
        let (c, s) = (0.999_f64, (1.0_f64 - 0.999 * 0.999).sqrt());
        let r = Mat::from_fn(2, 2, |i, j| [[5.0, c], [0.0, s]][i][j]);
        let exact = ((1.0 + c) / (1.0 - c)).sqrt();
        assert!((condition(&r, 2) / exact - 1.0).abs() < 1e-6);
    }
}

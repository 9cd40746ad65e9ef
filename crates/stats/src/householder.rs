//! Orthogonal reductions: rows folded into a triangle, and the rank-revealing factorisation of a triangle.
//!
//! faer's unpivoted QR (0.24) drops columns whose remainder is below `16 n eps`, so that its R is an echelon form. A remainder of
//! `1e-12` is data here, and the decision about rank is taken elsewhere, once, with the noise of every column at hand.

use faer::Mat;
use fleetfoot_data::checkpoint;
use pulp::{Simd, WithSimd};

use crate::kernel::{self, LANES, Slab, add_scaled_in, dot_in, norm, padded};

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
    pulp::Arch::new().dispatch(Fold { r, rows });
}

struct Fold<'a> {
    r: &'a mut Mat<f64>,
    rows: &'a mut Slab,
}

impl WithSimd for Fold<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { r, rows } = self;
        let (stride, d) = (rows.stride, rows.columns());
        for k in 0..r.nrows() {
            checkpoint();
            let (head, tail) = rows.values.split_at_mut((k + 1) * stride);
            let v = &mut head[k * stride..];
            let squares = dot_in(simd, v, v);
            let below = if (1e-280..1e280).contains(&squares) { squares.sqrt() } else { norm(&*v) };
            if below == 0.0 {
                if r[(k, k)] < 0.0 {
                    (k..d).for_each(|j| r[(k, j)] = -r[(k, j)]);
                }
                continue;
            }
            let alpha = r[(k, k)];
            let Reflection { length, first, beta } = Reflection::of(alpha, below);
            v.iter_mut().for_each(|value| *value /= first);
            // The reflector sends the column to -sign(alpha) length; the whole row changes sign where that would be negative.
            let sign = if alpha.is_sign_negative() { 1.0 } else { -1.0 };
            r[(k, k)] = length;
            for (j, column) in (k + 1..d).zip(tail.chunks_exact_mut(stride)) {
                let step = beta * (r[(k, j)] + dot_in(simd, v, column));
                r[(k, j)] = sign * (r[(k, j)] - step);
                add_scaled_in(simd, -step, v, column);
            }
            head[k * stride..].fill(0.0);
        }
    }
}

/// Reduces a matrix whose column i ends at the row `last[i]` (ascending) to an upper triangle, in place, by one Householder reflector a column;
/// what stands behind these columns are right-hand sides. Diagonal entries have either sign.
///
/// A staircase has few rows to reflect: columns taken out of a triangle, or rows of a diagonal between those of a triangle.
pub fn reduce_columns(values: &mut Slab, last: &[usize]) {
    pulp::Arch::new().dispatch(Reduce { values, last });
}

struct Reduce<'a> {
    values: &'a mut Slab,
    last: &'a [usize],
}

impl WithSimd for Reduce<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { values, last } = self;
        let (columns, stride) = (values.columns(), values.stride());
        let mut v = vec![0.0; stride];
        for (i, &last) in last.iter().enumerate().filter(|&(i, &last)| last > i) {
            checkpoint();
            // Whole vectors around the rows of the reflector; it is zero in the others.
            let (from, to) = (i / LANES * LANES, padded(last + 1));
            v[from..to].fill(0.0);
            v[i..=last].copy_from_slice(&values.column(i)[i..=last]);
            let Some((diagonal, beta)) = reflector(&mut v[i..=last]) else { continue };
            let column = values.column_mut(i);
            column[i..=last].fill(0.0);
            column[i] = diagonal;
            for j in i + 1..columns {
                let column = &mut values.column_mut(j)[from..to];
                let step = beta * dot_in(simd, &v[from..to], column);
                add_scaled_in(simd, -step, &v[from..to], column);
            }
        }
    }
}

/// What a column-pivoted QR found: `A[:, order] = Q [R11 R12; 0 R22]` with R22 below the noise.
pub(crate) struct Pivoted {
    /// Column of A at each position: first `rank` columns that carry the others, then the rest.
    pub(crate) order: Vec<usize>,
    /// Columns whose pivot stands above `threshold`.
    pub(crate) rank: usize,
    /// R in pivoted order (p x p); rows from `rank` on are left unreduced.
    pub(crate) r: Mat<f64>,
    /// `Q'B`.
    pub(crate) rhs: Mat<f64>,
}

/// Householder QR of `a` (m x p) with column pivoting (Businger and Golub 1965), stopped when no remaining column is longer than
/// `threshold`; `rhs` (m x q) is carried along.
///
/// The remaining lengths are computed anew in every step: a third more work than updating them, and no cancellation.
pub(crate) fn pivoted_qr(mut a: Mat<f64>, mut rhs: Mat<f64>, threshold: f64) -> Pivoted {
    let (m, p) = a.shape();
    let mut order: Vec<usize> = (0..p).collect();
    let mut rank = 0;
    while rank < p.min(m) {
        checkpoint();
        let k = rank;
        let mut best = (k, 0.0);
        for j in k..p {
            let length = norm(&a.col_as_slice(j)[k..]);
            if length > best.1 {
                best = (j, length);
            }
        }
        let (pivot, length) = best;
        // NaN is never the longest.
        if length <= threshold || !length.is_finite() {
            break;
        }
        if pivot != k {
            order.swap(k, pivot);
            for i in 0..m {
                (a[(i, k)], a[(i, pivot)]) = (a[(i, pivot)], a[(i, k)]);
            }
        }
        let mut u = a.col_as_slice(k)[k..].to_vec();
        let alpha = u[0];
        let first = alpha + length.copysign(alpha);
        u[0] = first;
        u.iter_mut().for_each(|value| *value /= first);
        let beta = 2.0 / u.iter().map(|value| value * value).sum::<f64>();
        a.col_as_slice_mut(k)[k + 1..].fill(0.0);
        a[(k, k)] = -length.copysign(alpha);
        (k + 1..p).for_each(|j| reflect(&u, beta, &mut a.col_as_slice_mut(j)[k..]));
        (0..rhs.ncols()).for_each(|j| reflect(&u, beta, &mut rhs.col_as_slice_mut(j)[k..]));
        rank += 1;
    }
    Pivoted { order, rank, r: a, rhs }
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

/// Solves `R'x = b` in place for the leading `n x n` upper triangle of `r`.
pub(crate) fn solve_upper_transposed(r: &Mat<f64>, n: usize, b: &mut Mat<f64>) {
    (0..b.ncols()).for_each(|t| kernel::solve_upper_transposed(|k| r.col_as_slice(k), &mut b.col_as_slice_mut(t)[..n]));
}

/// Estimate, from below and usually within a few per cent, of the condition number (2-norm) of the leading `n x n` upper triangle of
/// `r` with its columns scaled to unit length: power iteration on R'R and on its inverse. 1 when n is 0.
pub(crate) fn condition(r: &Mat<f64>, n: usize) -> f64 {
    if n == 0 {
        return 1.0;
    }
    let scale: Vec<f64> = (0..n).map(|j| norm(&r.col_as_slice(j)[..=j])).collect();
    let unit = Mat::from_fn(n, n, |i, j| if i <= j { r[(i, j)] / scale[j] } else { 0.0 });
    let mut growth = [1.0_f64; 2];
    for (which, growth) in growth.iter_mut().enumerate() {
        // A start with a component along everything, the same every time.
        let start = |i: usize| (1.0 + 0.37 * ((i * 7 + 3) % 11) as f64) * if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let mut x = Mat::from_fn(n, 1, |i, _| start(i));
        for _ in 0..12 {
            let length = norm(x.col_as_slice(0));
            x.col_as_slice_mut(0).iter_mut().for_each(|value| *value /= length);
            if which == 0 {
                multiply_both(&unit, x.col_as_slice_mut(0));
            } else {
                solve_upper_transposed(&unit, n, &mut x);
                solve_upper(&unit, n, &mut x);
            }
            *growth = norm(x.col_as_slice(0));
        }
    }
    (growth[0] * growth[1]).sqrt().max(1.0)
}

/// `x = R'R x` for an upper triangle.
fn multiply_both(r: &Mat<f64>, x: &mut [f64]) {
    let mut product = vec![0.0; x.len()];
    for (j, x) in x.iter().enumerate() {
        product[..=j].iter_mut().zip(r.col_as_slice(j)).for_each(|(sum, r)| *sum += r * x);
    }
    for (j, x) in x.iter_mut().enumerate() {
        *x = product[..=j].iter().zip(r.col_as_slice(j)).map(|(p, r)| p * r).sum();
    }
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
        let found = pivoted_qr(a.clone(), Mat::from_fn(6, 1, |i, _| value(i, 0)), 1e-12);
        assert_eq!(found.rank, 3);
        for k in 0..4 {
            for l in 0..4 {
                let (u, v) = (found.order[k], found.order[l]);
                let direct: f64 = (0..6).map(|i| a[(i, u)] * a[(i, v)]).sum();
                let factored: f64 = (0..3).map(|i| found.r[(i, k)] * found.r[(i, l)]).sum();
                assert!((direct - factored).abs() < 1e-13);
            }
        }
        // [1 c; 0 s] with c^2 + s^2 = 1 has singular values sqrt(1 +- c).
        let (c, s) = (0.999_f64, (1.0_f64 - 0.999 * 0.999).sqrt());
        let r = Mat::from_fn(2, 2, |i, j| [[5.0, c], [0.0, s]][i][j]);
        let exact = ((1.0 + c) / (1.0 - c)).sqrt();
        assert!((condition(&r, 2) / exact - 1.0).abs() < 1e-6);
    }
}

//! Cholesky factorisation with diagonal pivoting.

use std::ops::Range;

use faer::{Accum, Mat, MatMut, Par, linalg::matmul::matmul};
use fleetfoot_data::{checkpoint, parallel_pieces};
use pulp::{Simd, WithSimd};

use crate::kernel::{COLUMNS_AT_ONCE, MANY_COLUMNS, Slab, dot_in, padded};

/// Pivots between which the other columns are brought up to date at once, where there are many.
const PANEL: usize = 64;
/// Share of the best pivot from which on the first of many open columns is taken in its place.
const GOOD: f64 = 0.1;

/// Part of a Cholesky factor of a positive semidefinite matrix: C with `C'C` its leading p columns without the ones set
/// aside, and `C^-T` times the columns behind them.
#[derive(Debug, Clone)]
pub struct PivotedCholesky {
    /// The pivots in their order: the others of the p columns were set aside.
    pub order: Vec<usize>,
    /// The factor (p x d), with as many valid rows as there are pivots. Columns are in matrix order, so that it is
    /// triangular only in the order of the pivots.
    pub factor: Slab,
    /// Diagonal of the matrix that remains after the factor: `diag(A - C'C)` (d).
    pub left: Vec<f64>,
    /// The least share of its own diagonal entry that was left of a pivot; 1 without pivots.
    pub least: f64,
}

impl PivotedCholesky {
    /// Factors the leading p of d columns, always the one of which the largest share of its diagonal entry is left (Higham 2002, section 10.3, of the
    /// matrix scaled to unit diagonal); of equal ones the first. Columns of which not more than `floor` (p) is left are set aside.
    pub fn new(p: usize, d: usize, entry: impl Fn(usize, usize) -> f64, floor: &[f64]) -> Self {
        Self::factored(p, d, entry, floor, 1.0)
    }

    /// [`PivotedCholesky::new`] for columns that are expected to be independent: of many, the next one is taken where it is nearly as good as the best. Where all
    /// are, the factor is a triangle in the columns' own order.
    pub(crate) fn in_order(p: usize, d: usize, entry: impl Fn(usize, usize) -> f64, floor: &[f64]) -> Self {
        Self::factored(p, d, entry, floor, if p >= MANY_COLUMNS { GOOD } else { 1.0 })
    }

    /// [`PivotedCholesky::new`] without any exchange: as far as columns have more left than their floor, in their own order.
    pub(crate) fn without_exchange(p: usize, d: usize, entry: impl Fn(usize, usize) -> f64, floor: &[f64]) -> Self {
        Self::factored(p, d, entry, floor, 0.0)
    }

    fn factored(p: usize, d: usize, entry: impl Fn(usize, usize) -> f64, floor: &[f64], good: f64) -> Self {
        let diagonal: Vec<f64> = (0..d).map(|k| entry(k, k)).collect();
        let mut cholesky =
            Self { order: Vec::with_capacity(p), factor: Slab::zeros(p, d), left: diagonal.clone(), least: 1.0 };
        let mut open: Vec<usize> = (0..p).collect();
        let mut next = |cholesky: &mut Self, open: &mut Vec<usize>| cholesky.next(open, &diagonal, floor, good);
        if p >= MANY_COLUMNS {
            cholesky.by_panels(&mut open, p, entry, &mut next);
            return cholesky;
        }
        while let Some(pivot) = next(&mut cholesky, &mut open) {
            fleetfoot_data::arch().dispatch(Eliminate {
                cholesky: &mut cholesky,
                entry: &entry,
                pivot,
                open: &open,
                p,
                from: 0,
            });
        }
        cholesky
    }

    /// Takes the next pivot out of the open columns, the first of them where it is as good as a part `good` of the best; `None` where no more than its floor is
    /// left of any.
    fn next(&mut self, open: &mut Vec<usize>, diagonal: &[f64], floor: &[f64], good: f64) -> Option<usize> {
        let share = |k: usize| if self.left[k] > floor[k] { self.left[k] / diagonal[k] } else { 0.0 };
        let best = (0..open.len()).reduce(|best, at| if share(open[at]) > share(open[best]) { at } else { best })?;
        let taken = if share(open[0]) >= good * share(open[best]) { 0 } else { best };
        let share = share(open[taken]);
        (share > 0.0).then(|| {
            self.least = self.least.min(share);
            open.remove(taken)
        })
    }

    /// Many columns: what is left of the matrix is formed anew after every [`PANEL`] of them.
    fn by_panels(
        &mut self,
        open: &mut Vec<usize>,
        p: usize,
        entry: impl Fn(usize, usize) -> f64,
        next: &mut dyn FnMut(&mut Self, &mut Vec<usize>) -> Option<usize>,
    ) {
        let behind = p..self.left.len();
        let mut left = Remainder::new(open, behind.clone(), |columns| {
            let value = |i: usize, j: usize| if i >= j { entry(columns[i], columns[j]) } else { 0.0 };
            Slab::from_fn(columns.len(), open.len(), value)
        });
        loop {
            let from = self.order.len();
            for _ in 0..PANEL {
                let Some(pivot) = next(self, open) else { return };
                let entry = |i: usize, j: usize| left.entry(i, j);
                fleetfoot_data::arch().dispatch(Eliminate { cholesky: self, entry: &entry, pivot, open, p, from });
            }
            checkpoint();
            left = left.after(open, behind.clone(), |j| &self.factor.column(j)[from..from + PANEL]);
        }
    }

    /// Number of pivots.
    pub fn rank(&self) -> usize {
        self.order.len()
    }
}

/// One row of the factor: its pivot, and the entries of the columns that are open or stand behind the first p.
struct Eliminate<'a, E> {
    cholesky: &'a mut PivotedCholesky,
    entry: &'a E,
    pivot: usize,
    open: &'a [usize],
    p: usize,
    /// The first row that `entry` does not know of.
    from: usize,
}

impl<E: Fn(usize, usize) -> f64> WithSimd for Eliminate<'_, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { cholesky, entry, pivot, open, p, from } = self;
        let row = cholesky.order.len();
        let root = cholesky.left[pivot].sqrt();
        let known = padded(row);
        let above = cholesky.factor.column(pivot)[from..known].to_vec();
        for j in open.iter().copied().chain(p..cholesky.left.len()) {
            let column = cholesky.factor.column_mut(j);
            let value = (entry(pivot, j) - dot_in(simd, &above, &column[from..known])) / root;
            column[row] = value;
            cholesky.left[j] -= value * value;
        }
        cholesky.factor.column_mut(pivot)[row] = root;
        cholesky.left[pivot] = 0.0;
        cholesky.order.push(pivot);
    }
}

/// Schur complement of a symmetric matrix after some pivots, in the open columns and those behind.
struct Remainder {
    /// Place of a column among the open ones and those behind; no place for those that are done.
    place: Vec<usize>,
    /// The open columns down to the last of those behind; entries above the diagonal are undefined.
    values: Slab,
    /// Places of columns that are done, before those of the others.
    done: usize,
}

impl Remainder {
    fn new(open: &[usize], behind: Range<usize>, values: impl FnOnce(&[usize]) -> Slab) -> Self {
        let mut place = vec![usize::MAX; behind.end];
        let columns: Vec<usize> = open.iter().copied().chain(behind).collect();
        columns.iter().enumerate().for_each(|(at, &column)| place[column] = at);
        let values = values(&columns);
        Self { place, values, done: 0 }
    }

    /// Of an open column and another one.
    fn entry(&self, i: usize, j: usize) -> f64 {
        let (i, j) = (self.place[i], self.place[j]);
        self.values.column(i.min(j))[i.max(j)]
    }

    /// The remainder of the columns that are still open, given the rows that every column of the factor got: where it is if the first ones were the pivots.
    fn after<'f>(mut self, open: &[usize], behind: Range<usize>, rows: impl Fn(usize) -> &'f [f64]) -> Self {
        let done = self.done + PANEL;
        if open.iter().zip(done..).any(|(&column, place)| self.place[column] != place) {
            return self.without(open, behind, rows);
        }
        let columns: Vec<usize> = open.iter().copied().chain(behind).collect();
        let panel = Mat::from_fn(PANEL, columns.len(), |row, at| rows(columns[at])[row]);
        let stride = self.values.stride();
        let open_columns = &mut self.values.values[done * stride..(done + open.len()) * stride];
        parallel_pieces(open_columns, COLUMNS_AT_ONCE * stride, |piece, values| {
            let (first, width) = (piece * COLUMNS_AT_ONCE, values.len() / stride);
            let count = columns.len() - first;
            let below = MatMut::from_column_major_slice_mut(values, stride, width);
            let (all, panel_columns) = (panel.as_ref().subcols(first, count), panel.as_ref().subcols(first, width));
            let below = below.submatrix_mut(done + first, 0, count, width);
            matmul(below, Accum::Add, all.transpose(), panel_columns, -1.0, Par::Seq);
        });
        self.done = done;
        self
    }

    /// [`Remainder::after`] any pivots, in a place of its own.
    fn without<'f>(&self, open: &[usize], behind: Range<usize>, rows: impl Fn(usize) -> &'f [f64]) -> Self {
        Self::new(open, behind, |columns| {
            let count = columns.len();
            let panel = Mat::from_fn(PANEL, count, |row, at| rows(columns[at])[row]);
            let mut left = Slab::zeros(count, open.len());
            let stride = left.stride();
            left.fill_columns(COLUMNS_AT_ONCE, |first, values| {
                let width = values.len() / stride;
                for (at, column) in (first..).zip(values.chunks_exact_mut(stride)) {
                    (at..count).for_each(|i| column[i] = self.entry(columns[i], columns[at]));
                }
                let below = MatMut::from_column_major_slice_mut(values, stride, width);
                let below = below.submatrix_mut(first, 0, count - first, width);
                let (all, panel_columns) =
                    (panel.as_ref().subcols(first, count - first), panel.as_ref().subcols(first, width));
                matmul(below, Accum::Add, all.transpose(), panel_columns, -1.0, Par::Seq);
                Vec::<()>::new()
            });
            left
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(i: usize, j: usize) -> f64 {
        (0.7 * (i * (j + 1)) as f64 + 0.3 * j as f64).sin()
    }

    #[test]
    fn panels_make_the_same_factor() {
        // More columns than rows: only so many are independent; right-hand sides stand behind.
        for (n, p, d) in [(400, 300, 303), (190, 280, 281)] {
            let x = |i: usize, j: usize| {
                (0.7 * (i * (j + 1)) as f64 + 1.3 * (j * j) as f64).sin() + if i == j { 3.0 } else { 0.0 }
            };
            let columns: Vec<Vec<f64>> = (0..d).map(|j| (0..n).map(|i| x(i, j)).collect()).collect();
            let product = |a: usize, b: usize| columns[a].iter().zip(&columns[b]).map(|(a, b)| a * b).sum::<f64>();
            let floor: Vec<f64> = (0..p).map(|k| 1e-10 * product(k, k)).collect();
            let cholesky = PivotedCholesky::new(p, d, product, &floor);
            assert_eq!(cholesky.rank(), n.min(p));
            let made = |a: usize, b: usize| -> f64 {
                cholesky.factor.column(a).iter().zip(cholesky.factor.column(b)).map(|(a, b)| a * b).sum()
            };
            for a in (0..d).step_by(7) {
                for &b in cholesky.order.iter().step_by(5) {
                    assert!((made(a, b) - product(a, b)).abs() < 1e-10 * n as f64, "{a} {b}");
                }
            }
            for (at, &column) in cholesky.order.iter().enumerate() {
                assert!(cholesky.factor.column(column)[at + 1..].iter().all(|&entry| entry == 0.0));
            }
        }
    }

    #[test]
    fn the_factor_gives_the_matrix_and_sets_dependent_columns_aside() {
        let (n, p, d) = (23, 11, 13);
        // Column 4 is the sum of two others.
        let x = |i: usize, j: usize| if j == 4 { value(i, 1) + value(i, 9) } else { value(i, j) };
        let product = |a: usize, b: usize| (0..n).map(|i| x(i, a) * x(i, b)).sum::<f64>();
        let floor: Vec<f64> = (0..p).map(|k| 1e-12 * product(k, k)).collect();
        let cholesky = PivotedCholesky::new(p, d, product, &floor);
        assert_eq!(cholesky.rank(), 10);
        assert!([1, 4, 9].iter().any(|j| !cholesky.order.contains(j)));
        for a in 0..d {
            for b in 0..p {
                let made: f64 =
                    (0..cholesky.rank()).map(|k| cholesky.factor.column(a)[k] * cholesky.factor.column(b)[k]).sum();
                assert!((made - product(a, b)).abs() < 1e-12 * n as f64, "{a} {b}: {made} {}", product(a, b));
            }
            let made: f64 = (0..cholesky.rank()).map(|k| cholesky.factor.column(a)[k].powi(2)).sum();
            assert!((cholesky.left[a] - (product(a, a) - made)).abs() < 1e-12 * n as f64);
        }
        // In the order of the pivots it is triangular.
        for (at, &column) in cholesky.order.iter().enumerate() {
            assert!(cholesky.factor.column(column)[at + 1..].iter().all(|&entry| entry == 0.0));
        }
        // By panels the pivots are the same.
        let mut other = PivotedCholesky {
            order: Vec::new(),
            factor: Slab::zeros(p, d),
            left: (0..d).map(|k| product(k, k)).collect(),
            least: 1.0,
        };
        let diagonal = other.left.clone();
        let mut next = |other: &mut PivotedCholesky, open: &mut Vec<usize>| other.next(open, &diagonal, &floor, 1.0);
        other.by_panels(&mut (0..p).collect(), p, product, &mut next);
        assert_eq!((&other.order, other.factor.column(2)), (&cholesky.order, cholesky.factor.column(2)));
        let last = cholesky.factor.column(cholesky.order[9])[9].powi(2) / product(cholesky.order[9], cholesky.order[9]);
        assert!((cholesky.least / last - 1.0).abs() < 1e-6);
    }
}

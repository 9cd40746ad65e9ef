//! Reflectors by the block: data that exceed a processor's cache are read once a block, by matrix products on all
//! threads.
//!
//! A block of reflectors is `I - V T V'` with T upper triangular (the compact WY form; Schreiber and Van Loan 1989). Its columns are reduced one by one, the
//! columns behind them at once. Pieces of columns have a fixed width, so that the bits do not depend on the threads.

use faer::{Accum, Mat, MatMut, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::{checkpoint, parallel_pieces};

use super::{Fold, Reduce, Step};
use crate::kernel::{COLUMNS_AT_ONCE, LANES, Slab, padded};

/// Reflectors of a block.
const BLOCK: usize = 32;
/// Values from which on blocks are faster: twice what a second-level cache holds.
const LARGE: usize = 1 << 18;

/// Returns true if blocks are faster than one reflector after the other.
pub(super) fn pays(rows: &Slab) -> bool {
    rows.columns() >= 4 * BLOCK && rows.values.len() >= LARGE
}

/// [`super::fold_rows`].
pub(super) fn fold_rows(r: &mut Mat<f64>, rows: &mut Slab) {
    let (stride, d) = (rows.stride, rows.columns());
    for from in (0..r.nrows()).step_by(BLOCK) {
        let to = (from + BLOCK).min(r.nrows());
        let steps = fleetfoot_data::arch().dispatch(Fold { r, rows, from, to, until: to });
        let (head, tail) = rows.values.split_at_mut(to * stride);
        let head = &mut head[from * stride..];
        let v = MatRef::from_column_major_slice(head, stride, to - from);
        let factors: Vec<f64> = steps.iter().map(|step| step.beta).collect();
        let block = Block { v, t: triangular_factor(v, &factors) };
        let above = r.as_ref();
        // The rows of the triangle are the unit vectors' part of V.
        let moved = parallel_pieces(tail, COLUMNS_AT_ONCE * stride, |piece, columns| {
            let (first, count) = (to + piece * COLUMNS_AT_ONCE, columns.len() / stride);
            let above = above.submatrix(from, first, to - from, count);
            block.apply(Some(above), MatMut::from_column_major_slice_mut(columns, stride, count))
        });
        for (piece, moved) in moved.iter().enumerate() {
            for j in 0..moved.ncols() {
                let entries = &mut r.col_as_slice_mut(to + piece * COLUMNS_AT_ONCE + j)[from..to];
                for ((entry, moved), Step { sign, .. }) in entries.iter_mut().zip(moved.col_as_slice(j)).zip(&steps) {
                    *entry = sign * (*entry - moved);
                }
            }
        }
        head.fill(0.0);
    }
    debug_assert_eq!(d, r.ncols());
}

/// [`super::reduce`].
pub(super) fn reduce_columns(values: &mut Slab, last: &[usize], keep: &mut dyn FnMut(usize, f64, &[f64])) {
    let stride = values.stride;
    for from in (0..last.len()).step_by(BLOCK) {
        let to = (from + BLOCK).min(last.len());
        let mut v = Slab::zeros(values.rows(), to - from);
        let mut reflect = |column: usize| {
            let vector = v.column_mut(column - from);
            let reduce = Reduce { values: &mut *values, v: &mut *vector, column, last: last[column], until: to };
            let beta = fleetfoot_data::arch().dispatch(reduce);
            if beta == 0.0 {
                vector.fill(0.0);
            }
            keep(column, beta, vector.get(column..=last[column]).unwrap_or(&[]));
            beta
        };
        let factors: Vec<f64> = (from..to).map(&mut reflect).collect();
        // Whole vectors around the rows of these reflectors.
        let top = from / LANES * LANES;
        let rows = padded(last[to - 1] + 1).saturating_sub(top);
        let v = MatRef::from_column_major_slice_with_stride(&v.values[top..], rows, to - from, stride);
        let block = Block { v, t: triangular_factor(v, &factors) };
        parallel_pieces(&mut values.values[to * stride..], COLUMNS_AT_ONCE * stride, |_, columns| {
            let count = columns.len() / stride;
            let columns = MatMut::from_column_major_slice_mut(columns, stride, count);
            block.apply(None, columns.submatrix_mut(top, 0, rows, count));
        });
    }
}

/// `I - V T V'`.
struct Block<'a> {
    v: MatRef<'a, f64>,
    t: Mat<f64>,
}

impl Block<'_> {
    /// `C - V W` in the place of C, `W = T'(U + V'C)`; W. U is the part of C that V meets with unit vectors.
    fn apply(&self, above: Option<MatRef<'_, f64>>, mut columns: MatMut<'_, f64>) -> Mat<f64> {
        checkpoint();
        let mut met = Mat::zeros(self.v.ncols(), columns.ncols());
        let accum = match above {
            Some(above) => {
                met.copy_from(above);
                Accum::Add
            }
            None => Accum::Replace,
        };
        matmul(met.as_mut(), accum, self.v.transpose(), columns.as_ref(), 1.0, Par::Seq);
        let mut moved = Mat::zeros(met.nrows(), met.ncols());
        matmul(moved.as_mut(), Accum::Replace, self.t.transpose(), met.as_ref(), 1.0, Par::Seq);
        matmul(columns.as_mut(), Accum::Add, self.v, moved.as_ref(), -1.0, Par::Seq);
        moved
    }
}

/// T of the reflectors `I - beta v v'`, one after the other; what V's columns have beyond `v` is orthogonal.
fn triangular_factor(v: MatRef<'_, f64>, betas: &[f64]) -> Mat<f64> {
    let k = betas.len();
    let mut products = Mat::zeros(k, k);
    matmul(products.as_mut(), Accum::Replace, v.transpose(), v, 1.0, Par::Seq);
    let mut t = Mat::zeros(k, k);
    for (j, &beta) in betas.iter().enumerate() {
        for i in 0..j {
            t[(i, j)] = -beta * (i..j).map(|l| t[(i, l)] * products[(l, j)]).sum::<f64>();
        }
        t[(j, j)] = beta;
    }
    t
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::parallel_all;

    use super::*;

    fn value(i: usize, j: usize) -> f64 {
        (1.3 * (i * 7 + j * 3) as f64).sin() + 0.1 * (0.37 * (i * j) as f64).cos()
    }

    /// The largest difference of two matrices.
    fn apart(a: impl Fn(usize, usize) -> f64, b: impl Fn(usize, usize) -> f64, shape: (usize, usize)) -> f64 {
        (0..shape.0)
            .flat_map(|i| (0..shape.1).map(move |j| (i, j)))
            .map(|(i, j)| (a(i, j) - b(i, j)).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn block_folding_equals_row_folding() {
        // Blocks that are whole and not, a column of zeros, right-hand sides behind the triangle, pieces that are whole and not.
        for (m, k, d) in [(5, 1, 1), (40, 33, 34), (70, 64, 67), (90, 150, 300)] {
            let entry = |i: usize, j: usize| if j == 20 { 0.0 } else { value(i, j) };
            let start = Mat::from_fn(k, d, |i, j| match () {
                () if i > j => 0.0,
                // Of either sign: rows are turned over.
                () if i == j => value(i, j + 1) * if j % 3 == 0 { -1.0 } else { 1.0 },
                () => value(i + 2, j),
            });
            let (mut one, mut other) = (start.clone(), start);
            let (mut rows, mut same) = (Slab::from_fn(m, d, entry), Slab::from_fn(m, d, entry));
            fleetfoot_data::arch().dispatch(Fold { r: &mut one, rows: &mut rows, from: 0, to: k, until: d });
            rows.values[..k * rows.stride].fill(0.0);
            fold_rows(&mut other, &mut same);
            assert!(apart(|i, j| one[(i, j)], |i, j| other[(i, j)], (k, d)) < 1e-12, "{m} {k} {d}");
            assert!(apart(|i, j| rows.column(j)[i], |i, j| same.column(j)[i], (m, d)) < 1e-12, "{m} {k} {d}");
        }
    }

    #[test]
    fn block_staircases_equal_row_staircases() {
        for (k, q, step) in [(1, 0, 1), (33, 1, 2), (64, 3, 1), (150, 200, 3)] {
            // Column j ends at a row that is not before j; some have nothing to reflect.
            let last: Vec<usize> = (0..k).map(|j| if j < 5 { j } else { j + j / 4 * step }).collect();
            let rows = last[k - 1] + 1;
            let entry = |i: usize, j: usize| if j >= k || i <= last[j] { value(i, j) } else { 0.0 };
            let (mut one, mut other) = (Slab::from_fn(rows, k + q, entry), Slab::from_fn(rows, k + q, entry));
            let mut v = vec![0.0; one.stride()];
            for (column, &last) in last.iter().enumerate() {
                fleetfoot_data::arch().dispatch(Reduce { values: &mut one, v: &mut v, column, last, until: k + q });
            }
            reduce_columns(&mut other, &last, &mut |_, _, _| ());
            assert!(apart(|i, j| one.column(j)[i], |i, j| other.column(j)[i], (rows, k + q)) < 1e-12, "{k} {q}");
        }
    }

    #[test]
    fn bits_do_not_depend_on_threads() {
        let (m, k, d) = (300, 200, 600);
        let fold = |_: usize| {
            let (mut r, mut rows) = (Mat::zeros(k, d), Slab::from_fn(m, d, value));
            fold_rows(&mut r, &mut rows);
            (r, rows)
        };
        // Within a piece of other work a reduction may have one thread, outside of it all.
        let inside = parallel_all(2, fold);
        let alone = fold(0);
        assert!(inside.iter().all(|folded| *folded == alone));
    }
}

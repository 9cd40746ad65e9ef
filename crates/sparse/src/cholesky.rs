//! Solves with a positive semidefinite matrix, whose columns may depend on each other.

use faer::{
    Accum, Mat, MatRef, Par,
    diag::Diag,
    dyn_stack::{MemBuffer, MemStack},
    linalg::{
        cholesky::llt::{factor, solve, update::rank_r_update_clobber},
        matmul::{
            matmul,
            triangular::{self, BlockStructure},
        },
        triangular_solve::solve_lower_triangular_in_place,
    },
};
use fleetfoot_data::checkpoint;

use crate::kernel::{Slab, norm};

/// Columns that are eliminated at once.
const PANEL: usize = 256;

/// A solution of `M x = b`, M symmetric (k x k, both triangles): by Cholesky, and where the square of a pivot would be below `level` of the diagonal,
/// by one that passes over the columns that depend on the ones before; they get 0.
pub(crate) fn solve(matrix: &Mat<f64>, b: &[f64], level: f64) -> Vec<f64> {
    match Factor::of(matrix.clone(), level) {
        Some(factor) => factor.solve(b),
        None => solve_dependent(matrix, b, level),
    }
}

/// Trace of `M^-1 A` (k x k both), M as in [`solve`].
pub(crate) fn trace_of_ratio(a: &Mat<f64>, matrix: &Mat<f64>, level: f64) -> f64 {
    let k = matrix.nrows();
    match Factor::of(matrix.clone(), level) {
        Some(factor) => {
            let ratio = factor.solve_all(a.clone());
            (0..k).map(|i| ratio[(i, i)]).sum()
        }
        None => (0..k).map(|i| solve_dependent(matrix, a.col_as_slice(i), level)[i]).sum(),
    }
}

/// The Cholesky factor of a matrix whose columns do not depend on each other, in its lower triangle.
pub(crate) struct Factor(Mat<f64>);

impl Factor {
    /// Factors in place; only the lower triangle is read. `None` where the square of a pivot would be below `level` of the diagonal.
    pub(crate) fn of(matrix: Mat<f64>, level: f64) -> Option<Self> {
        let diagonal: Vec<f64> = (0..matrix.nrows()).map(|i| matrix[(i, i)]).collect();
        Self::checked(matrix, &diagonal, level)
    }

    /// As [`Factor::of`], pivots relative to another diagonal.
    fn checked(mut matrix: Mat<f64>, diagonal: &[f64], level: f64) -> Option<Self> {
        let k = matrix.nrows();
        // Panel by panel: between them it can be stopped.
        for first in (0..k).step_by(PANEL) {
            checkpoint();
            let width = PANEL.min(k - first);
            let (done, rest) = matrix.as_mut().split_at_col_mut(first);
            let done = done.as_ref().subrows(first, k - first);
            let mut panel = rest.subrows_mut(first, k - first).subcols_mut(0, width);
            matmul(panel.as_mut(), Accum::Add, done, done.subrows(0, width).transpose(), -1.0, Par::Seq);
            let (mut top, below) = panel.split_at_row_mut(width);
            let scratch = factor::cholesky_in_place_scratch::<f64>(width, Par::Seq, Default::default());
            let mut memory = MemBuffer::new(scratch);
            let stack = MemStack::new(&mut memory);
            factor::cholesky_in_place(top.as_mut(), Default::default(), Par::Seq, stack, Default::default()).ok()?;
            solve_lower_triangular_in_place(top.as_ref(), below.transpose_mut(), Par::Seq);
        }
        let pivots = diagonal.iter().enumerate().all(|(i, diagonal)| matrix[(i, i)].powi(2) > level * diagonal);
        pivots.then_some(Self(matrix))
    }

    /// The solution of `M x = b`.
    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let solution = self.solve_all(Mat::from_fn(b.len(), 1, |i, _| b[i]));
        solution.col_as_slice(0).to_vec()
    }

    /// The solutions of `M X = B`, in the place of B (k x m).
    fn solve_all(&self, mut right: Mat<f64>) -> Mat<f64> {
        solve::solve_in_place(self.0.as_ref(), right.as_mut(), Par::Seq, MemStack::new(&mut []));
        right
    }
}

/// A Cholesky factor whose columns join and leave in blocks, in the lower triangle of a matrix with room for more. What stands above and the room are not
/// touched: they take no memory before they are.
#[derive(Default)]
pub(crate) struct GrowingFactor {
    lower: Slab,
    columns: usize,
}

impl GrowingFactor {
    fn lower(&self) -> MatRef<'_, f64> {
        self.lower.as_mat().submatrix(0, 0, self.columns, self.columns)
    }

    /// Columns join behind those that are there: entries of the matrix with these (k x a), and with each other (a x a). False, and nothing done, where the square
    /// of a pivot would be below `level` of the diagonal.
    pub(crate) fn append(&mut self, mut with: Mat<f64>, corner: Mat<f64>, level: f64) -> bool {
        let (k, a) = (self.columns, corner.nrows());
        if a == 0 {
            return true;
        }
        let diagonal: Vec<f64> = (0..a).map(|i| corner[(i, i)]).collect();
        // L^-1 of the entries, and what it leaves of the new ones.
        solve_lower_triangular_in_place(self.lower(), with.as_mut(), Par::Seq);
        let mut left = corner;
        triangular::matmul(
            left.as_mut(),
            BlockStructure::TriangularLower,
            Accum::Add,
            with.transpose(),
            BlockStructure::Rectangular,
            with.as_ref(),
            BlockStructure::Rectangular,
            -1.0,
            Par::Seq,
        );
        let Some(Factor(left)) = Factor::checked(left, &diagonal, level) else { return false };
        self.reserve(k + a);
        for j in 0..k {
            let entries = self.lower.column_mut(j)[k..k + a].iter_mut().enumerate();
            entries.for_each(|(i, entry)| *entry = with[(j, i)]);
        }
        for j in 0..a {
            self.lower.column_mut(k + j)[k + j..k + a].copy_from_slice(&left.col_as_slice(j)[j..]);
        }
        self.columns = k + a;
        true
    }

    fn reserve(&mut self, columns: usize) {
        if columns > self.lower.rows() {
            let mut lower = Slab::zeros(columns + columns / 2, columns + columns / 2);
            for j in 0..self.columns {
                lower.column_mut(j)[j..self.columns].copy_from_slice(&self.lower.column(j)[j..self.columns]);
            }
            self.lower = lower;
        }
    }

    /// The columns at these places, ascending, leave: what they explained returns to those behind them by a rotation (Golub and Van Loan 2013, section 6.5.4).
    /// False where rounding does not let them.
    pub(crate) fn remove(&mut self, places: &[usize]) -> bool {
        let Some(&first) = places.first() else { return true };
        let kept: Vec<usize> = (first..self.columns).filter(|at| places.binary_search(at).is_err()).collect();
        let mut returns = Mat::zeros(kept.len(), places.len());
        for (k, &place) in places.iter().enumerate() {
            let column = self.lower.column(place);
            let entries = returns.col_as_slice_mut(k).iter_mut().zip(&kept).filter(|(_, row)| **row > place);
            entries.for_each(|(entry, &row)| *entry = column[row]);
        }
        for (to, from) in (0..first).chain(kept.iter().copied()).enumerate() {
            let mut column = self.lower.column(from)[..self.columns].to_vec();
            kept.iter().enumerate().for_each(|(at, &row)| column[first + at] = column[row]);
            let left = to..first + kept.len();
            self.lower.column_mut(to)[left.clone()].copy_from_slice(&column[left]);
        }
        self.columns = first + kept.len();
        let trailing = self.lower.as_mat_mut().submatrix_mut(first, first, kept.len(), kept.len());
        let mut ones = Diag::<f64>::ones(places.len());
        rank_r_update_clobber(trailing, returns.as_mut(), ones.as_mut()).is_ok()
    }

    /// The solution of `M x = b`.
    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut right = Mat::from_fn(b.len(), 1, |i, _| b[i]);
        solve::solve_in_place(self.lower(), right.as_mut(), Par::Seq, MemStack::new(&mut []));
        right.col_as_slice(0).to_vec()
    }
}

/// As [`solve`], whatever depends on what: row by row, because faer's factorisation stops at the first column that depends on others.
pub(crate) fn solve_dependent(matrix: &Mat<f64>, b: &[f64], level: f64) -> Vec<f64> {
    // Index, entries before the pivot, pivot, and entry of the forward substitution.
    let mut kept: Vec<(usize, Vec<f64>, f64, f64)> = Vec::new();
    for j in 0..b.len() {
        checkpoint();
        let mut row: Vec<f64> = Vec::with_capacity(kept.len());
        let mut known = b[j];
        for (i, above, pivot, value) in &kept {
            let products: f64 = above.iter().zip(&row).map(|(a, b)| a * b).sum();
            row.push((matrix[(*i, j)] - products) / pivot);
            known -= row[row.len() - 1] * value;
        }
        let left = matrix[(j, j)] - row.iter().map(|entry| entry * entry).sum::<f64>();
        if left > level * matrix[(j, j)] {
            let pivot = left.sqrt();
            kept.push((j, row, pivot, known / pivot));
        }
    }
    let mut solution = vec![0.0; b.len()];
    for k in (0..kept.len()).rev() {
        let (j, row, pivot, value) = std::mem::take(&mut kept[k]);
        solution[j] = value / pivot;
        for (below, entry) in kept[..k].iter_mut().zip(&row) {
            below.3 -= entry * solution[j];
        }
    }
    solution
}

/// Direction along which the fit of dependent columns stays constant while the penalty falls. It is the gradient that a
/// step leaves on the columns that it passed over, with the answer of the other columns. `None` if a step leaves no
/// gradient.
pub(crate) fn flat(matrix: &Mat<f64>, wanted: &[f64], step: &[f64], level: f64) -> Option<Vec<f64>> {
    /// The part of the gradient that is more than rounding.
    const LEFT: f64 = 1e-9;
    let product = |v: &[f64], a: usize| v.iter().enumerate().map(|(b, v)| matrix[(a, b)] * v).sum::<f64>();
    let left: Vec<f64> = wanted.iter().enumerate().map(|(a, wanted)| wanted - product(step, a)).collect();
    // The columns that the solution uses are left nothing but rounding.
    let left: Vec<f64> = left.iter().zip(step).map(|(left, step)| if *step == 0.0 { *left } else { 0.0 }).collect();
    if norm(left.iter().copied()) <= LEFT * norm(wanted.iter().copied()) {
        return None;
    }
    let answer: Vec<f64> = (0..left.len()).map(|a| -product(&left, a)).collect();
    let others = solve(matrix, &answer, level);
    Some(left.iter().zip(&others).map(|(left, other)| left + other).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_make_one_factor() {
        let k = 2 * PANEL + 37;
        let entry = |i: usize, j: usize| (-0.1 * (i as f64 - j as f64).abs()).exp() + f64::from(u8::from(i == j));
        let matrix = Mat::from_fn(k, k, entry);
        let b: Vec<f64> = (0..k).map(|i| (0.3 * i as f64).sin()).collect();
        let solution = Factor::of(matrix.clone(), 1e-14).expect("definite").solve(&b);
        for i in 0..k {
            let product: f64 = (0..k).map(|j| matrix[(i, j)] * solution[j]).sum();
            assert!((product - b[i]).abs() < 1e-12);
        }
        let mut singular = matrix;
        (0..k).for_each(|i| (singular[(k - 1, i)], singular[(i, k - 1)]) = (entry(3, i), entry(3, i)));
        singular[(k - 1, k - 1)] = entry(3, 3);
        assert!(Factor::of(singular, 1e-14).is_none());
    }

    #[test]
    fn columns_join_and_leave() {
        let x = Mat::from_fn(30, 12, |i, j| ((i * (2 * j + 3) + 5 * j) as f64 * 0.37).sin());
        let matrix = x.transpose() * &x;
        let part = |rows: &[usize], columns: &[usize]| {
            Mat::from_fn(rows.len(), columns.len(), |i, j| matrix[(rows[i], columns[j])])
        };
        let mut factor = GrowingFactor::default();
        let mut order: Vec<usize> = Vec::new();
        // Columns that leave, and columns that join then.
        let steps: [(&[usize], &[usize]); 6] = [
            (&[], &[3, 0, 7, 5]),
            (&[1], &[]),
            (&[0, 2], &[11, 2, 9, 4, 8]),
            (&[2, 3, 5], &[0, 1]),
            (&[], &[10]),
            (&[0, 1, 2, 3, 4, 5], &[6]),
        ];
        for (leaving, joining) in steps {
            assert!(factor.remove(leaving));
            for &place in leaving.iter().rev() {
                order.remove(place);
            }
            assert!(factor.append(part(&order, joining), part(joining, joining), 1e-14));
            order.extend(joining);
            let b: Vec<f64> = (0..order.len()).map(|i| i as f64 - 1.5).collect();
            let (solution, expected) = (factor.solve(&b), solve(&part(&order, &order), &b, 1e-14));
            assert!(solution.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "{order:?}");
        }
        // A column once more.
        assert!(!factor.append(part(&order, &[6]), part(&[6], &[6]), 1e-14));
        assert_eq!(factor.solve(&[1.0]).len(), 1);
    }

    #[test]
    fn dependent_columns_are_passed_over() {
        let x = Mat::from_fn(6, 4, |i, j| (1.3 * (i * 5 + j * 2) as f64).sin());
        // The third column is a copy of the first.
        let column = |j: usize| if j == 2 { 0 } else { j };
        let x = Mat::from_fn(6, 4, |i, j| x[(i, column(j))]);
        let matrix = x.transpose() * &x;
        let b: Vec<f64> = (0..4).map(|j| (0..6).map(|i| x[(i, j)] * (i as f64 - 2.0)).sum()).collect();
        let solution = solve(&matrix, &b, 1e-14);
        assert_eq!(solution[2], 0.0);
        for i in 0..4 {
            let product: f64 = (0..4).map(|j| matrix[(i, j)] * solution[j]).sum();
            assert!((product - b[i]).abs() < 1e-13);
        }
        // The same without the copy, by the other way.
        let kept = [0, 1, 3];
        let small = Mat::from_fn(3, 3, |i, j| matrix[(kept[i], kept[j])]);
        let direct = solve(&small, &kept.map(|j| b[j]), 1e-14);
        assert!(kept.iter().zip(&direct).all(|(&j, value)| (solution[j] - value).abs() < 1e-12));
    }
}

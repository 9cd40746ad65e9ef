//! Solves with a positive semidefinite matrix, whose columns may depend on each other.

use faer::{
    Mat, Par,
    dyn_stack::{MemBuffer, MemStack},
    linalg::cholesky::llt::{factor, solve},
};
use fleetfoot_data::checkpoint;

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
    pub(crate) fn of(mut matrix: Mat<f64>, level: f64) -> Option<Self> {
        let k = matrix.nrows();
        let diagonal: Vec<f64> = (0..k).map(|i| matrix[(i, i)]).collect();
        let scratch = factor::cholesky_in_place_scratch::<f64>(k, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        factor::cholesky_in_place(matrix.as_mut(), Default::default(), Par::Seq, stack, Default::default()).ok()?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dependent_columns_are_passed_over() {
        let x = Mat::from_fn(6, 4, |i, j| (1.3 * (i * 5 + j * 2) as f64).sin());
        // The third column is a copy of the first.
        let column = |j: usize| if j == 2 { 0 } else { j };
        let x = Mat::from_fn(6, 4, |i, j| x[(i, column(j))]);
        let matrix = x.transpose() * &x;
        let b: Vec<f64> = (0..4).map(|j| (0..6).map(|i| x[(i, j)] * (i as f64 - 2.0)).sum()).collect();
        let found = solve(&matrix, &b, 1e-14);
        assert_eq!(found[2], 0.0);
        for i in 0..4 {
            let product: f64 = (0..4).map(|j| matrix[(i, j)] * found[j]).sum();
            assert!((product - b[i]).abs() < 1e-13);
        }
        // The same without the copy, by the other way.
        let kept = [0, 1, 3];
        let small = Mat::from_fn(3, 3, |i, j| matrix[(kept[i], kept[j])]);
        let direct = solve(&small, &kept.map(|j| b[j]), 1e-14);
        assert!(kept.iter().zip(&direct).all(|(&j, value)| (found[j] - value).abs() < 1e-12));
    }
}

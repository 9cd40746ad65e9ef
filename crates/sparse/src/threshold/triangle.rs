//! Columns of a triangle, made triangular again.

use fleetfoot_stats::householder::reduce_columns;

use crate::kernel::{Slab, least_length, solve_upper, solve_upper_transposed};

/// `[R z]`: a square upper triangle and its right-hand sides.
#[derive(Debug, Clone)]
pub(super) struct Triangle {
    /// R, then the columns of z (k rows).
    values: Slab,
    columns: usize,
}

impl Triangle {
    /// From an upper triangle, its right-hand sides, and one more row `diagonal[j] e_j'` a column (zeros: none).
    ///
    /// The rows are interleaved, `R_0, D_0, R_1, D_1, ...`: column j ends at row `2 j + 1`, so a staircase is left to reduce.
    pub(super) fn stacked(r: faer::MatRef<'_, f64>, z: faer::MatRef<'_, f64>, diagonal: &[f64]) -> Self {
        let (p, q) = (r.ncols(), z.ncols());
        if diagonal.iter().all(|&value| value == 0.0) {
            let entry = |i: usize, j: usize| {
                if j >= p {
                    z[(i, j - p)]
                } else if i <= j {
                    r[(i, j)]
                } else {
                    0.0
                }
            };
            return Self { values: Slab::from_fn(p, p + q, entry), columns: p };
        }
        let entry = |i: usize, j: usize| match (j >= p, i.is_multiple_of(2)) {
            (true, true) => z[(i / 2, j - p)],
            (false, true) if i / 2 <= j => r[(i / 2, j)],
            (false, false) if i / 2 == j => diagonal[j],
            _ => 0.0,
        };
        let last: Vec<usize> = (0..p).map(|j| 2 * j + 1).collect();
        Self::reduced(Slab::from_fn(2 * p, p + q, entry), &last)
    }

    /// Number of columns of R.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// Entry of R, `i <= j`.
    pub(super) fn r(&self, i: usize, j: usize) -> f64 {
        self.values.column(j)[i]
    }

    /// A right-hand side (k).
    pub(super) fn z(&self, target: usize) -> &[f64] {
        &self.values.column(self.columns + target)[..self.columns]
    }

    /// Some of the columns, ascending, and one of the right-hand sides: what the others explain is dropped.
    pub(super) fn select(&self, columns: &[usize], target: usize) -> Self {
        let rows = columns.last().map_or(0, |last| last + 1);
        let k = columns.len();
        let mut values = Slab::zeros(rows, k + 1);
        for (to, &from) in columns.iter().chain([&(self.columns + target)]).enumerate() {
            values.column_mut(to)[..rows].copy_from_slice(&self.values.column(from)[..rows]);
        }
        Self::reduced(values, columns)
    }

    /// The same columns, the first right-hand side less what these coefficients (k) explain of it.
    pub(super) fn less(&self, coefficients: &[f64]) -> Self {
        let mut selected = self.clone();
        let mut left = self.z(0).to_vec();
        for (j, coefficient) in coefficients.iter().enumerate().filter(|(_, coefficient)| **coefficient != 0.0) {
            left.iter_mut().zip(&self.values.column(j)[..=j]).for_each(|(left, r)| *left -= coefficient * r);
        }
        selected.values.column_mut(self.columns)[..self.columns].copy_from_slice(&left);
        selected
    }

    /// Householder reduction of columns that end at the rows `last`, ascending; right-hand sides stand behind them.
    fn reduced(mut values: Slab, last: &[usize]) -> Self {
        let k = last.len();
        reduce_columns(&mut values, last);
        let entry = |i: usize, j: usize| if j >= k || i <= j { values.column(j)[i] } else { 0.0 };
        Self { values: Slab::from_fn(k, values.columns(), entry), columns: k }
    }

    /// `R^-1 x` in place.
    pub(super) fn solve(&self, x: &mut [f64]) {
        solve_upper(|k| self.values.column(k), &mut x[..self.columns]);
    }

    /// `R^-T x` in place.
    pub(super) fn solve_transposed(&self, x: &mut [f64]) {
        solve_upper_transposed(|k| self.values.column(k), &mut x[..self.columns]);
    }

    /// The least length of `R diag(1/units) x` over unit x, from above and usually within a factor of two.
    pub(super) fn least(&self, units: &[f64]) -> f64 {
        least_length(|k| self.values.column(k), &units[..self.columns])
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    fn value(i: usize, j: usize) -> f64 {
        (1.3 * (i * 7 + j * 3) as f64).sin() + 0.1 * j as f64
    }

    /// `R'R` and `R'z` of a triangle are those of the rows it was made from.
    fn same(triangle: &Triangle, product: impl Fn(usize, usize) -> f64, with_target: impl Fn(usize) -> f64) {
        let k = triangle.columns();
        for a in 0..k {
            for b in 0..=a {
                let made: f64 = (0..=b).map(|i| triangle.r(i, a) * triangle.r(i, b)).sum();
                assert!((made - product(a, b)).abs() < 1e-12, "{a} {b}: {made} {}", product(a, b));
            }
            let made: f64 = (0..=a).map(|i| triangle.r(i, a) * triangle.z(0)[i]).sum();
            assert!((made - with_target(a)).abs() < 1e-12);
        }
    }

    #[test]
    fn stacked_rows_and_selected_columns_keep_inner_products() {
        for p in [1, 2, 5, 13, 29] {
            let r = Mat::from_fn(p, p, |i, j| if i <= j { value(i, j) } else { 0.0 });
            let z = Mat::from_fn(p, 2, |i, t| value(i + 3, p + t));
            let diagonal: Vec<f64> = (0..p).map(|j| if j % 3 == 1 { 0.0 } else { 0.5 + j as f64 }).collect();
            let products = |a: usize, b: usize| {
                let product: f64 = (0..p).map(|i| r[(i, a)] * r[(i, b)]).sum();
                product + if a == b { diagonal[a] * diagonal[a] } else { 0.0 }
            };
            let with_target = |t: usize| {
                move |a: usize| -> f64 {
                    (0..p).map(|i| value(i + 3, p + t) * if i <= a { value(i, a) } else { 0.0 }).sum()
                }
            };
            let stacked = Triangle::stacked(r.as_ref(), z.as_ref(), &diagonal);
            same(&stacked, products, with_target(0));
            let columns: Vec<usize> = (0..p).filter(|j| j % 4 != 2).collect();
            let some = stacked.select(&columns, 1);
            same(&some, |a, b| products(columns[a], columns[b]), |a| with_target(1)(columns[a]));
            let again: Vec<usize> = (0..columns.len()).step_by(2).collect();
            let fewer = some.select(&again, 0);
            same(&fewer, |a, b| products(columns[again[a]], columns[again[b]]), |a| with_target(1)(columns[again[a]]));
        }
    }

    #[test]
    fn solves_are_inverse_products_and_the_least_length_is_near() {
        let r = Mat::from_fn(6, 6, |i, j| {
            if i == j {
                2.0 + j as f64
            } else if i < j {
                0.3 * value(i, j)
            } else {
                0.0
            }
        });
        let triangle = Triangle::stacked(r.as_ref(), Mat::zeros(6, 1).as_ref(), &[0.0; 6]);
        let x: Vec<f64> = (0..6).map(|i| value(i, 1)).collect();
        let mut back: Vec<f64> = (0..6).map(|i| (i..6).map(|j| r[(i, j)] * x[j]).sum()).collect();
        triangle.solve(&mut back);
        let mut turned: Vec<f64> = (0..6).map(|j| (0..=j).map(|i| r[(i, j)] * x[i]).sum()).collect();
        triangle.solve_transposed(&mut turned);
        assert!((0..6).all(|i| (back[i] - x[i]).abs() < 1e-13 && (turned[i] - x[i]).abs() < 1e-13));
        // [1 c; 0 s] with c^2 + s^2 = 1 has the least singular value sqrt(1 - c).
        let (c, s) = (0.999_f64, (1.0_f64 - 0.999 * 0.999).sqrt());
        let r = Mat::from_fn(2, 2, |i, j| [[5.0, c], [0.0, s]][i][j]);
        let least = Triangle::stacked(r.as_ref(), Mat::zeros(2, 1).as_ref(), &[0.0; 2]).least(&[5.0, 1.0]);
        assert!((least / (1.0 - c).sqrt() - 1.0).abs() < 1e-6, "{least}");
    }
}

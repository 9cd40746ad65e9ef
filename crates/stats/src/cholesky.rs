//! Cholesky factorisation with diagonal pivoting.

use pulp::{Simd, WithSimd};

use crate::kernel::{Slab, dot_in, padded};

/// Part of a Cholesky factor of a positive semidefinite matrix: C with `C'C` its leading p columns up to what was set aside, and `C^-T` times the
/// columns behind them.
#[derive(Debug, Clone)]
pub struct PivotedCholesky {
    /// The pivots in their order: what is not among the p columns was set aside.
    pub order: Vec<usize>,
    /// As many rows as there are pivots count (p x d), columns in their own order: triangular in the order of the pivots only.
    pub factor: Slab,
    /// What the factor leaves of every diagonal entry (d).
    pub left: Vec<f64>,
    /// The least share of its own diagonal entry that was left of a pivot; 1 without pivots.
    pub least: f64,
}

impl PivotedCholesky {
    /// Factors the leading p of d columns, always the one of which the largest share of its diagonal entry is left (Higham 2002, section 10.3, of the
    /// matrix scaled to unit diagonal); of equal ones the first. Columns of which not more than `floor` (p) is left are set aside.
    pub fn new(p: usize, d: usize, entry: impl Fn(usize, usize) -> f64, floor: &[f64]) -> Self {
        let diagonal: Vec<f64> = (0..d).map(|k| entry(k, k)).collect();
        let mut found =
            Self { order: Vec::with_capacity(p), factor: Slab::zeros(p, d), left: diagonal.clone(), least: 1.0 };
        let mut open: Vec<usize> = (0..p).collect();
        loop {
            let share = |k: usize| if found.left[k] > floor[k] { found.left[k] / diagonal[k] } else { 0.0 };
            let best = (0..open.len()).reduce(|best, at| if share(open[at]) > share(open[best]) { at } else { best });
            let Some((best, share)) = best.map(|best| (best, share(open[best]))).filter(|&(_, share)| share > 0.0)
            else {
                return found;
            };
            found.least = found.least.min(share);
            let pivot = open.remove(best);
            pulp::Arch::new().dispatch(Eliminate { found: &mut found, entry: &entry, pivot, open: &open, p });
        }
    }

    /// Number of pivots.
    pub fn rank(&self) -> usize {
        self.order.len()
    }
}

/// One row of the factor: its pivot, and the entries of the columns that are open or stand behind the first p.
struct Eliminate<'a, E> {
    found: &'a mut PivotedCholesky,
    entry: &'a E,
    pivot: usize,
    open: &'a [usize],
    p: usize,
}

impl<E: Fn(usize, usize) -> f64> WithSimd for Eliminate<'_, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { found, entry, pivot, open, p } = self;
        let row = found.order.len();
        let root = found.left[pivot].sqrt();
        let known = padded(row);
        let above = found.factor.column(pivot)[..known].to_vec();
        for j in open.iter().copied().chain(p..found.left.len()) {
            let column = found.factor.column_mut(j);
            let value = (entry(pivot, j) - dot_in(simd, &above, &column[..known])) / root;
            column[row] = value;
            found.left[j] -= value * value;
        }
        found.factor.column_mut(pivot)[row] = root;
        found.left[pivot] = 0.0;
        found.order.push(pivot);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(i: usize, j: usize) -> f64 {
        (0.7 * (i * (j + 1)) as f64 + 0.3 * j as f64).sin()
    }

    #[test]
    fn the_factor_gives_the_matrix_and_sets_dependent_columns_aside() {
        let (n, p, d) = (23, 11, 13);
        // Column 4 is the sum of two others.
        let x = |i: usize, j: usize| if j == 4 { value(i, 1) + value(i, 9) } else { value(i, j) };
        let product = |a: usize, b: usize| (0..n).map(|i| x(i, a) * x(i, b)).sum::<f64>();
        let floor: Vec<f64> = (0..p).map(|k| 1e-12 * product(k, k)).collect();
        let found = PivotedCholesky::new(p, d, product, &floor);
        assert_eq!(found.rank(), 10);
        assert!([1, 4, 9].iter().any(|j| !found.order.contains(j)));
        for a in 0..d {
            for b in 0..p {
                let made: f64 = (0..found.rank()).map(|k| found.factor.column(a)[k] * found.factor.column(b)[k]).sum();
                assert!((made - product(a, b)).abs() < 1e-12 * n as f64, "{a} {b}: {made} {}", product(a, b));
            }
            let made: f64 = (0..found.rank()).map(|k| found.factor.column(a)[k].powi(2)).sum();
            assert!((found.left[a] - (product(a, a) - made)).abs() < 1e-12 * n as f64);
        }
        // In the order of the pivots it is triangular.
        for (at, &column) in found.order.iter().enumerate() {
            assert!(found.factor.column(column)[at + 1..].iter().all(|&entry| entry == 0.0));
        }
        let last = found.factor.column(found.order[9])[9].powi(2) / product(found.order[9], found.order[9]);
        assert!((found.least / last - 1.0).abs() < 1e-6);
    }
}

//! Small solves on the square-root form: least squares of minimum norm, and ridge.

use faer::{Mat, MatRef};

use crate::{
    SquareRoot,
    householder::{Reflectors, fold_rows, solve_upper},
    kernel::{self, MANY_COLUMNS, Slab},
    separation::{Separation, separate},
};

/// A linear model with an intercept, `y = x'beta + b`, for each target.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Coefficients in raw units (p x q).
    pub coefficients: Mat<f64>,
    /// Intercepts (q).
    pub intercept: Vec<f64>,
    /// Independent regressors in the rows, the intercept not counted.
    pub rank: usize,
    /// Estimated condition number of the independent regressors, centred and scaled to unit length.
    pub condition: f64,
    /// Groups of regressors that the data cannot separate, each ascending; a constant regressor is a group of itself.
    pub confounded: Vec<Vec<usize>>,
    /// Weighted residual sum of squares on the rows of the fit (q).
    pub rss: Vec<f64>,
}

/// Least squares: the minimiser of `sum w (y - x'beta - b)^2` over beta and b, per target.
///
/// If several minimisers exist, this is the one of least `sum_j (scale_j beta_j)^2`: minimum norm in standardised
/// units, the intercept free. `scale` (p) holds one positive unit a column, usually its standard deviation over the
/// training rows; an entry that is not positive counts as 1. A regressor that is constant in the rows gets the
/// coefficient 0.
///
/// The rank is that of a column-pivoted QR in units of the columns' noise ([`SquareRoot::noise`]). With full rank
/// `R beta = z` is solved by substitution, else a complete orthogonal decomposition gives the minimum norm (Golub and
/// Van Loan 2013, section 5.5).
///
/// # Panics
/// When `scale` has another length than p.
pub fn least_squares(root: &SquareRoot, scale: &[f64]) -> Solution {
    let units = units(root, scale);
    let separation = separate(&root.r, &root.column_noise(), root.z.clone());
    let coefficients = minimum_norm(&separation, &root.column_noise(), &units);
    finish(root, coefficients, &separation)
}

/// Ridge regression towards a prior: the minimiser over beta and b, per target, of
///
/// `1/(2n) sum w (y - x'beta - b)^2 + lambda/2 sum_j (scale_j (beta_j - prior_j))^2`, n = sum of the weights.
///
/// `prior` (p x q) is zero when not given; the intercept is not penalised. Solved as the least-squares problem with the rows
/// `sqrt(n lambda) diag(scale)` below R, so that nothing is squared. `lambda = 0` is [`least_squares`], except that minimum norm is
/// counted from the prior. `rank`, `condition` and `confounded` describe the rows, without the penalty; `rss` is without the penalty.
///
/// # Panics
/// When the shapes disagree.
pub fn ridge(root: &SquareRoot, scale: &[f64], lambda: f64, prior: Option<MatRef<'_, f64>>) -> Solution {
    let (p, q) = (root.regressors(), root.targets());
    let units = units(root, scale);
    let noise = root.column_noise();
    let data = separate(&root.r, &noise, Mat::zeros(p, 0));
    // Solved for beta - prior: z becomes what the prior does not explain.
    let mut stacked = Mat::from_fn(p, p + q, |i, j| if j < p { root.r[(i, j)] } else { root.z[(i, j - p)] });
    if let Some(prior) = prior {
        assert_eq!((prior.nrows(), prior.ncols()), (p, q), "a p x q prior");
        for t in 0..q {
            for i in 0..p {
                stacked[(i, p + t)] -= (i..p).map(|j| root.r[(i, j)] * prior[(j, t)]).sum::<f64>();
            }
        }
    }
    let penalty = (root.weight * lambda).sqrt();
    if penalty > 0.0 {
        let mut rows = Slab::zeros(p, p + q);
        (0..p).for_each(|j| rows.column_mut(j)[j] = penalty * units[j]);
        fold_rows(&mut stacked, &mut rows);
    }
    let r = Mat::from_fn(p, p, |i, j| stacked[(i, j)]);
    let z = Mat::from_fn(p, q, |i, t| stacked[(i, p + t)]);
    let mut coefficients = minimum_norm(&separate(&r, &noise, z), &noise, &units);
    if let Some(prior) = prior {
        coefficients += prior;
    }
    finish(root, coefficients, &data)
}

fn units(root: &SquareRoot, scale: &[f64]) -> Vec<f64> {
    assert_eq!(scale.len(), root.regressors(), "one unit a regressor");
    scale.iter().map(|&unit| if unit > 0.0 && unit.is_finite() { unit } else { 1.0 }).collect()
}

/// The solution of least norm `|units * beta|` of the separated problem (p x q).
fn minimum_norm(separation: &Separation, noise: &[f64], units: &[f64]) -> Mat<f64> {
    let Separation { order, rank, r, rhs, constant, .. } = separation;
    let (rank, p, q) = (*rank, order.len(), rhs.ncols());
    let mut known = Mat::from_fn(rank, q, |i, t| rhs[(i, t)]);
    let mut coefficients = Mat::zeros(p, q);
    if rank == p {
        solve_upper(r, rank, &mut known);
        for (k, &column) in order.iter().enumerate() {
            (0..q).for_each(|t| coefficients[(column, t)] = known[(k, t)] / noise[column]);
        }
        return coefficients;
    }
    if p < MANY_COLUMNS {
        return minimum_norm_of_few(separation, noise, units, known);
    }
    // M gamma = c with gamma = units * beta and M = [R11 R12] in those units, without the columns that are zero; with M' = Q U, gamma = Q U^-T c. Rows and
    // columns in reverse make a staircase of M': as many entries below its diagonal as there are columns beyond the rank.
    let kept: Vec<(usize, usize)> =
        order.iter().copied().enumerate().filter(|&(_, column)| !constant[column]).collect();
    let m = kept.len();
    let mut rows = Slab::zeros(m, rank);
    for (at, &(k, column)) in kept.iter().enumerate() {
        for i in 0..rank.min(k + 1) {
            rows.column_mut(rank - 1 - i)[m - 1 - at] = r[(i, k)] * (noise[column] / units[column]);
        }
    }
    let last: Vec<usize> = (0..rank).map(|i| m - rank + i).collect();
    let reflectors = Reflectors::of_columns(&mut rows, &last);
    // M has full row rank up to the noise; a zero here can only come from underflow.
    if (0..rank).any(|i| rows.column(i)[i] == 0.0) {
        return coefficients;
    }
    for t in 0..q {
        let mut gamma: Vec<f64> = known.col_as_slice(t).iter().rev().copied().collect();
        kernel::solve_upper_transposed(|i| rows.column(i), &mut gamma);
        gamma.resize(m, 0.0);
        reflectors.apply(&mut gamma);
        for (&(_, column), gamma) in kept.iter().zip(gamma.iter().rev()) {
            coefficients[(column, t)] = gamma / units[column];
        }
    }
    coefficients
}

/// [`minimum_norm`] of few columns below full rank, `known` being what R11 and R12 are to make: the identity is carried through the reduction of M', which leaves
/// Q' beside L'. The steps, and the bits, are those of always.
fn minimum_norm_of_few(separation: &Separation, noise: &[f64], units: &[f64], mut known: Mat<f64>) -> Mat<f64> {
    let Separation { order, rank, r, .. } = separation;
    let (rank, p, q) = (*rank, order.len(), known.ncols());
    let mut coefficients = Mat::zeros(p, q);
    let mut rows = Slab::zeros(p, rank + p);
    for (k, &column) in order.iter().enumerate() {
        for i in 0..rank {
            rows.column_mut(i)[k] = if k >= i { r[(i, k)] * (noise[column] / units[column]) } else { 0.0 };
        }
        rows.column_mut(rank + k)[k] = 1.0;
    }
    let mut reduced = Mat::zeros(rank, rank + p);
    fold_rows(&mut reduced, &mut rows);
    // As for many columns.
    if (0..rank).any(|i| reduced[(i, i)] == 0.0) {
        return coefficients;
    }
    for t in 0..q {
        kernel::solve_upper_transposed(|k| reduced.col_as_slice(k), &mut known.col_as_slice_mut(t)[..rank]);
        for (k, &column) in order.iter().enumerate() {
            let gamma: f64 = (0..rank).map(|i| reduced[(i, rank + k)] * known[(i, t)]).sum();
            coefficients[(column, t)] = gamma / units[column];
        }
    }
    coefficients
}

fn finish(root: &SquareRoot, coefficients: Mat<f64>, separation: &Separation) -> Solution {
    let intercept: Vec<f64> = (0..root.targets())
        .map(|t| {
            root.mean_x.iter().enumerate().fold(root.mean_y[t], |left, (j, mean)| left - mean * coefficients[(j, t)])
        })
        .collect();
    Solution {
        rss: root.error(coefficients.as_ref(), &intercept),
        coefficients,
        intercept,
        rank: separation.rank,
        condition: separation.condition,
        confounded: separation.confounded(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Factor;

    /// Fewer rows than columns, a column that does not vary, and one that is another: the solution of least norm is that of the pseudoinverse.
    #[test]
    fn least_norm_matches_pseudoinverse() {
        let (n, p) = (201, 300);
        let x = Mat::from_fn(n, p, |i, j| match j {
            7 => 3.0,
            290 => (0.731 * (i * 23) as f64).sin(),
            _ => (0.731 * (i * (2 * j + 3)) as f64).sin(),
        });
        let y: Vec<f64> = (0..n).map(|i| (0.37 * (i * i) as f64).cos()).collect();
        let rows = Mat::from_fn(n, p + 1, |i, j| if j < p { x[(i, j)] } else { y[i] });
        let mut factor = Factor::new(p, 1);
        factor.push(rows.as_ref(), None);
        let scale: Vec<f64> = (0..p).map(|j| 1.0 + 0.01 * j as f64).collect();
        let solution = least_squares(&factor.square_root(), &scale);
        // Centred, in the units of the norm.
        let mean = |values: &dyn Fn(usize) -> f64| (0..n).map(values).sum::<f64>() / n as f64;
        let means: Vec<f64> = (0..p).map(|j| mean(&|i| x[(i, j)])).collect();
        let centred = Mat::from_fn(n, p, |i, j| if j == 7 { 0.0 } else { (x[(i, j)] - means[j]) / scale[j] });
        let target = Mat::from_fn(n, 1, |i, _| y[i] - mean(&|i| y[i]));
        let svd = centred.thin_svd().unwrap();
        let (u, s, v) = (svd.U(), svd.S().column_vector(), svd.V());
        let rank = (0..n).filter(|&k| s[k] > 1e-10 * s[0]).count();
        let mut expected = vec![0.0; p];
        for k in 0..rank {
            let share = (0..n).map(|i| u[(i, k)] * target[(i, 0)]).sum::<f64>() / s[k];
            (0..p).for_each(|j| expected[j] += share * v[(j, k)] / scale[j]);
        }
        assert_eq!((solution.rank, solution.coefficients[(7, 0)]), (rank, 0.0));
        // Amplification by the least singular value.
        let tolerance = 1e-13 * s[0] / s[rank - 1];
        for (j, expected) in expected.iter().enumerate() {
            let coefficient = solution.coefficients[(j, 0)];
            assert!((coefficient - expected).abs() < tolerance, "{j}: {coefficient} {expected}, {tolerance:e}");
        }
    }
}

//! Compressed rows: a least-squares problem whose constant, if it has one, is a column like the others.

use faer::{Mat, MatRef};

use crate::{SquareRoot, householder::fold_rows, kernel::Slab, square_root::sum_of_squares};

/// Least squares of q targets on p columns without an intercept of its own: for coefficients b (p) of one target,
/// `rss = |R b - z|^2 + residual`.
///
/// The form that thresholding works on: the constant is a candidate, and may be fixed, penalised or dropped.
#[derive(Debug, Clone, PartialEq)]
pub struct Compressed {
    /// Rows of positive weight.
    pub rows: u64,
    /// Sum of the weights.
    pub weight: f64,
    /// R, upper triangular (p x p), raw units: `R'R` is X'X.
    pub r: Mat<f64>,
    /// Q'y (p x q).
    pub z: Mat<f64>,
    /// Squared norm of the part that no column explains (q).
    pub residual: Vec<f64>,
    /// Sum of squares of every target about its mean (q).
    pub total: Vec<f64>,
    /// Rounding of every column of `r` (p): shorter columns hold no information.
    pub noise: Vec<f64>,
    /// Mean squared error of the targets (q), such as that of a difference for a derivative: below it no model is
    /// better than another. 0 unless set by [`Compressed::known_to`].
    pub resolution: Vec<f64>,
}

impl SquareRoot {
    /// The problem without its intercept; with `constant`, a column of ones stands before the regressors.
    ///
    /// The means return as one more row, `sqrt(weight) [1 mean_x | mean_y]`.
    pub fn compressed(&self, constant: bool) -> Compressed {
        let (p, q, first) = (self.regressors(), self.targets(), usize::from(constant));
        let size = self.weight.sqrt();
        let mut stack = Slab::zeros(p + 1, first + p + q);
        if constant {
            stack.column_mut(0)[0] = size;
        }
        for (j, mean) in self.mean_x.iter().chain(&self.mean_y).enumerate() {
            let column = stack.column_mut(first + j);
            column[0] = size * mean;
            let factor = if j < p { self.r.col_as_slice(j) } else { self.z.col_as_slice(j - p) };
            column[1..=p].copy_from_slice(&factor[..p]);
        }
        let means = constant.then_some(f64::EPSILON * size);
        let noise = means.into_iter().chain(self.column_noise()).collect();
        let shared = (self.rows, self.weight);
        Compressed::triangular(shared, first + p, &mut stack, &self.residual, self.total.clone(), noise)
    }
}

impl Compressed {
    /// From rows `[X y]` of p columns and the targets, and what they leave.
    fn triangular(
        (rows, weight): (u64, f64),
        p: usize,
        stack: &mut Slab,
        residual: &[f64],
        total: Vec<f64>,
        noise: Vec<f64>,
    ) -> Self {
        let q = residual.len();
        let mut factor = Mat::zeros(p, p + q);
        fold_rows(&mut factor, stack);
        let left = |t: usize| sum_of_squares(stack.column(p + t));
        Self {
            rows,
            weight,
            r: Mat::from_fn(p, p, |i, j| factor[(i, j)]),
            z: Mat::from_fn(p, q, |i, t| factor[(i, p + t)]),
            residual: (0..q).map(|t| residual[t] + left(t)).collect(),
            total,
            noise,
            resolution: vec![0.0; q],
        }
    }

    /// The same problem, its targets known to these mean squared errors (q).
    ///
    /// # Panics
    /// When there is not one a target.
    #[must_use]
    pub fn known_to(self, resolution: &[f64]) -> Self {
        assert_eq!(resolution.len(), self.targets(), "one mean squared error a target");
        Self { resolution: resolution.to_vec(), ..self }
    }

    /// Number of columns, p.
    pub fn columns(&self) -> usize {
        self.noise.len()
    }

    /// Number of targets, q.
    pub fn targets(&self) -> usize {
        self.residual.len()
    }

    /// The problem with some of the columns only, in the order given; what the others explained joins the residual.
    ///
    /// # Panics
    /// When a column does not exist.
    pub fn select(&self, columns: &[usize]) -> Self {
        let (k, q, p) = (columns.len(), self.targets(), self.columns());
        let mut stack = Slab::zeros(p, k + q);
        for (to, &column) in columns.iter().enumerate() {
            stack.column_mut(to)[..p].copy_from_slice(self.r.col_as_slice(column));
        }
        for t in 0..q {
            stack.column_mut(k + t)[..p].copy_from_slice(self.z.col_as_slice(t));
        }
        let noise = columns.iter().map(|&column| self.noise[column]).collect();
        Self::triangular((self.rows, self.weight), k, &mut stack, &self.residual, self.total.clone(), noise)
            .known_to(&self.resolution)
    }

    /// The weighted sum of squared errors, per target, of coefficients (p x q); they may have been fitted on any rows.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn error(&self, coefficients: MatRef<'_, f64>) -> Vec<f64> {
        let (p, q) = (self.columns(), self.targets());
        assert_eq!((coefficients.nrows(), coefficients.ncols()), (p, q), "p x q coefficients");
        (0..q)
            .map(|t| {
                let mut left: Vec<f64> = self.z.col_as_slice(t).iter().map(|z| -z).collect();
                for j in 0..p {
                    let beta = coefficients[(j, t)];
                    let column = &self.r.col_as_slice(j)[..=j];
                    left.iter_mut().zip(column).for_each(|(left, r)| *left += beta * r);
                }
                sum_of_squares(&left) + self.residual[t]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Factor, Preconditioner, least_squares};

    fn rows() -> Mat<f64> {
        Mat::from_fn(60, 5, |i, j| {
            let x = |k: usize| 3.0 + (i as f64 * (0.3 + 0.21 * k as f64)).sin();
            match j {
                0..3 => x(j),
                3 => 1.0 + 2.0 * x(0) - x(2) + 0.1 * (i as f64).cos(),
                _ => x(1) * x(1),
            }
        })
    }

    #[test]
    fn errors_match_rows() {
        let x = rows();
        let change = Preconditioner::from_pilot(x.as_ref(), 3);
        let mut z = x.clone();
        change.apply(z.as_mut());
        let root = change.square_root(&crate::Gram::of_rows(z.as_ref(), None));
        let beta = Mat::from_fn(4, 2, |i, t| 0.3 * (i as f64) - 0.7 * (t as f64) + 0.2);
        for (constant, columns) in [(true, vec![0, 1, 2, 3]), (false, vec![0, 1, 2])] {
            let problem = root.compressed(constant);
            let p = problem.columns();
            let b = beta.as_ref().get(..p, ..);
            let error = problem.error(b);
            for t in 0..2 {
                let direct: f64 = (0..60)
                    .map(|i| {
                        let value =
                            |j: usize| if constant { if j == 0 { 1.0 } else { x[(i, j - 1)] } } else { x[(i, j)] };
                        (x[(i, 3 + t)] - (0..p).map(|j| value(j) * b[(j, t)]).sum::<f64>()).powi(2)
                    })
                    .sum();
                assert!((error[t] - direct).abs() < 1e-10 * direct, "{} {direct}", error[t]);
            }
            assert_eq!(problem.select(&columns).columns(), p);
        }
    }

    #[test]
    fn selected_columns_leave_the_rest_to_the_residual() {
        let x = rows();
        let mut factor = Factor::new(3, 2);
        factor.push(x.as_ref(), None);
        let root = factor.square_root();
        let problem = root.compressed(true);
        let some = problem.select(&[2, 0]);
        // Least squares on column 1 (of the regressors) and the constant, by the centred form.
        let one = least_squares(&root.select(&[1]), &[1.0]);
        for (residual, rss) in some.residual.iter().zip(&one.rss) {
            assert!((residual - rss).abs() < 1e-10 * rss, "{residual} {rss}");
        }
    }
}

//! One least-squares problem of rows whose features are, part by part, affine maps of the regressors: maps that are tied to each other across parts.

use faer::Mat;

use crate::{SquareRoot, householder::fold_rows, kernel::Slab, square_root::sum_of_squares};

/// Features of the rows of a part: `u = L x + l`.
#[derive(Debug, Clone)]
pub struct Features {
    /// L, features x regressors.
    pub linear: Mat<f64>,
    /// l, one number a feature.
    pub constant: Vec<f64>,
}

impl SquareRoot {
    /// The square-root form of the rows of all parts together, with the features of each in place of its regressors.
    ///
    /// The centred rows of every part, `R L'`, stand above the differences of the parts' means from the mean of all; reflectors make them a triangle, so
    /// that nothing is squared. Parts without rows leave no trace; `None` where none has any.
    ///
    /// # Panics
    /// When parts disagree about the number of features or targets.
    pub fn pooled(parts: &[(&SquareRoot, Features)]) -> Option<SquareRoot> {
        let parts: Vec<&(&SquareRoot, Features)> = parts.iter().filter(|(root, _)| root.weight > 0.0).collect();
        let (first, features) = parts.first()?;
        let (k, q) = (features.constant.len(), first.targets());
        let agree = |(root, features): &&(&SquareRoot, Features)| root.targets() == q && features.constant.len() == k;
        assert!(parts.iter().all(agree), "as many features and targets in every part");
        let weight: f64 = parts.iter().map(|(root, _)| root.weight).sum();
        let means: Vec<Vec<f64>> = parts.iter().map(|(root, features)| features.of(&root.mean_x)).collect();
        let mean_of = |value: &dyn Fn(usize) -> f64| {
            parts.iter().enumerate().map(|(at, (root, _))| root.weight / weight * value(at)).sum::<f64>()
        };
        let mean_x: Vec<f64> = (0..k).map(|j| mean_of(&|at| means[at][j])).collect();
        let mean_y: Vec<f64> = (0..q).map(|t| mean_of(&|at| parts[at].0.mean_y[t])).collect();
        let (mut factor, mut residual) = (Mat::zeros(k, k + q), vec![0.0; q]);
        for ((root, features), mean) in parts.iter().zip(&means) {
            let p = root.regressors();
            let mut rows = Slab::zeros(p + 1, k + q);
            let size = root.weight.sqrt();
            for j in 0..k {
                let column = rows.column_mut(j);
                for (i, value) in column[..p].iter_mut().enumerate() {
                    *value = (i..p).map(|x| root.r[(i, x)] * features.linear[(j, x)]).sum();
                }
                column[p] = size * (mean[j] - mean_x[j]);
            }
            for t in 0..q {
                let column = rows.column_mut(k + t);
                column[..p].copy_from_slice(root.z.col_as_slice(t));
                column[p] = size * (root.mean_y[t] - mean_y[t]);
            }
            fold_rows(&mut factor, &mut rows);
            for (t, left) in residual.iter_mut().enumerate() {
                *left += root.residual[t] + sum_of_squares(rows.column(k + t));
            }
        }
        let magnitude = |j: usize| {
            let of = |(root, features): &&(&SquareRoot, Features)| {
                let terms = root.magnitude.iter().enumerate().map(|(x, size)| features.linear[(j, x)].abs() * size);
                terms.sum::<f64>() + root.weight.sqrt() * features.constant[j].abs()
            };
            parts.iter().map(of).map(|size| size * size).sum::<f64>().sqrt()
        };
        let largest = |of: fn(&SquareRoot) -> f64| parts.iter().map(|(root, _)| of(root)).fold(0.0, f64::max);
        Some(SquareRoot::assemble(
            (parts.iter().map(|(root, _)| root.rows).sum(), weight),
            (mean_x, mean_y),
            factor,
            residual,
            largest(|root| root.condition),
            largest(|root| root.noise),
            (0..k).map(magnitude).collect(),
        ))
    }

    /// With rows of a ridge below: as if `penalty_j (beta_j - prior_j)` had been seen to be zero, for each regressor. The intercept is free as before.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn towards(&self, penalty: &[f64], prior: faer::MatRef<'_, f64>) -> SquareRoot {
        let (p, q) = (self.regressors(), self.targets());
        assert_eq!(
            (penalty.len(), prior.nrows(), prior.ncols()),
            (p, p, q),
            "a number for each regressor, and a p x q prior"
        );
        let mut factor = Mat::from_fn(p, p + q, |i, j| if j < p { self.r[(i, j)] } else { self.z[(i, j - p)] });
        let entry = |i: usize, j: usize| match j.checked_sub(p) {
            None => {
                if i == j {
                    penalty[i]
                } else {
                    0.0
                }
            }
            Some(t) => penalty[i] * prior[(i, t)],
        };
        let mut rows = Slab::from_fn(p, p + q, entry);
        fold_rows(&mut factor, &mut rows);
        let residual = (0..q).map(|t| self.residual[t] + sum_of_squares(rows.column(p + t))).collect();
        let means = (self.mean_x.clone(), self.mean_y.clone());
        let magnitude = self.magnitude.clone();
        Self::assemble((self.rows, self.weight), means, factor, residual, self.condition, self.noise, magnitude)
    }
}

impl Features {
    /// Of the regressors as they are.
    fn of(&self, x: &[f64]) -> Vec<f64> {
        let feature = |(j, constant): (usize, &f64)| {
            x.iter().enumerate().fold(*constant, |sum, (i, x)| sum + self.linear[(j, i)] * x)
        };
        self.constant.iter().enumerate().map(feature).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Gram, Preconditioner, least_squares};

    /// Columns of rows (x0, x1, y).
    fn columns(from: usize, rows: usize) -> Vec<Vec<f64>> {
        let x = |i: usize, j: usize| ((from + i) as f64 * [0.731, 0.417][j]).sin() * [2.0, 0.3][j] + 1.0;
        let y = |i: usize| (1.3 * x(i, 0)).sin() + x(i, 1).abs();
        vec![(0..rows).map(|i| x(i, 0)).collect(), (0..rows).map(|i| x(i, 1)).collect(), (0..rows).map(y).collect()]
    }

    fn root(columns: &[Vec<f64>]) -> SquareRoot {
        let p = columns.len() - 1;
        let n = columns[0].len();
        let all = columns.concat();
        let z = faer::MatRef::from_column_major_slice(&all, n, p + 1);
        let preconditioner = Preconditioner::from_pilot(z, p);
        let mut work = all.clone();
        preconditioner.apply(faer::MatMut::from_column_major_slice_mut(&mut work, n, p + 1));
        preconditioner.square_root(&Gram::of_rows(faer::MatRef::from_column_major_slice(&work, n, p + 1), None))
    }

    #[test]
    fn parts_with_features_are_the_rows_with_features() {
        let (a, b) = (columns(0, 40), columns(100, 25));
        // u0 = x0, and u1 = x1 + 2 in the first part, 3 x0 - x1 - 1 in the second.
        let features = |linear: [[f64; 2]; 2], constant: [f64; 2]| Features {
            linear: Mat::from_fn(2, 2, |i, j| linear[i][j]),
            constant: constant.to_vec(),
        };
        let first = features([[1.0, 0.0], [0.0, 1.0]], [0.0, 2.0]);
        let second = features([[1.0, 0.0], [3.0, -1.0]], [0.0, -1.0]);
        let pooled = SquareRoot::pooled(&[(&root(&a), first.clone()), (&root(&b), second.clone())]).unwrap();
        let of = |features: &Features, columns: &[Vec<f64>], i: usize| features.of(&[columns[0][i], columns[1][i]]);
        let feature = |j: usize| {
            let (n, m) = (a[0].len(), b[0].len());
            (0..n).map(|i| of(&first, &a, i)[j]).chain((0..m).map(|i| of(&second, &b, i)[j])).collect::<Vec<f64>>()
        };
        let y = [a[2].as_slice(), &b[2]].concat();
        let direct = root(&[feature(0), feature(1), y]);
        let (one, other) = (least_squares(&pooled, &[1.0; 2]), least_squares(&direct, &[1.0; 2]));
        for j in 0..2 {
            assert!((one.coefficients[(j, 0)] - other.coefficients[(j, 0)]).abs() < 1e-12);
        }
        assert!((one.intercept[0] - other.intercept[0]).abs() < 1e-12 && (one.rss[0] - other.rss[0]).abs() < 1e-11);
        assert_eq!((pooled.rows, pooled.weight), (65, 65.0));
        assert!((pooled.total[0] - direct.total[0]).abs() < 1e-11);
    }

    #[test]
    fn ridge_rows_match_ridge() {
        let square_root = root(&columns(3, 30));
        let prior = Mat::from_fn(2, 1, |i, _| [0.4, -2.0][i]);
        let scale = [0.7, 0.2];
        let lambda = 0.3;
        let penalty: Vec<f64> = scale.iter().map(|scale| (square_root.weight * lambda).sqrt() * scale).collect();
        let one = least_squares(&square_root.towards(&penalty, prior.as_ref()), &scale);
        let other = crate::ridge(&square_root, &scale, lambda, Some(prior.as_ref()));
        for j in 0..2 {
            assert!((one.coefficients[(j, 0)] - other.coefficients[(j, 0)]).abs() < 1e-12);
        }
    }
}

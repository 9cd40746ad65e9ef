//! Scores of given coefficients on the rows behind a statistic.

use crate::{Gram, Preconditioner};

/// Moments of the errors `e = y - x'beta` (no intercept) that coefficients make on the rows of a statistic.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// `sum w x e` (p), raw units: half the gradient of the squared errors, downhill.
    pub gradient: Vec<f64>,
    /// `sum w e`.
    pub sum: f64,
    /// `sum w e^2`.
    pub squares: f64,
}

impl Preconditioner {
    /// The score of coefficients beta (p, raw units) of one target on the rows of a Gram matrix of preconditioned rows.
    ///
    /// In preconditioned coordinates the error is `e0 + z'v`, with v = (B - T beta, s): what the coefficients differ from the pilot's own. With the mean
    /// m, scatter S and weight W of the rows, `sum w z e = S v + W m (e0 + m'v)`, and nothing of the size of y'y cancels.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn score(&self, gram: &Gram, target: usize, beta: &[f64]) -> Score {
        let (p, d) = (self.regressors(), self.dimension());
        assert_eq!((gram.dimension(), beta.len()), (d, p), "the columns of the preconditioner");
        assert!(target < self.targets(), "a target of the preconditioner");
        let mut v = vec![0.0; d];
        v[..=p + target].copy_from_slice(self.column(p + target));
        let mut constant = self.centre()[p + target];
        for (k, &column) in self.order().iter().enumerate() {
            constant -= self.centre()[column] * beta[column];
            v.iter_mut().zip(self.column(k)).for_each(|(v, t)| *v -= t * beta[column]);
        }
        let mean = constant + gram.mean.iter().zip(&v).map(|(m, v)| m * v).sum::<f64>();
        let centred: Vec<f64> = (0..d).map(|i| (0..d).map(|j| gram.get(i, j) * v[j]).sum()).collect();
        let sum = gram.weight * mean;
        let mut gradient = vec![0.0; p];
        for (k, &column) in self.order().iter().enumerate() {
            let terms = self.column(k).iter().enumerate().map(|(i, t)| t * (centred[i] + gram.mean[i] * sum));
            gradient[column] = self.centre()[column] * sum + terms.sum::<f64>();
        }
        let spread: f64 = centred.iter().zip(&v).map(|(a, v)| a * v).sum();
        Score { gradient, sum, squares: spread.max(0.0) + sum * mean }
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    #[test]
    fn scores_match_rows() {
        let (n, p) = (90, 4);
        let value = |i: usize, j: usize| {
            let t = i as f64 * 0.1;
            [1.0 + t.sin(), 1e3 + 5.0 * (0.7 * t).cos() + t.sin(), 1e-4 * t, t * t, 3.0 + t, t.cos() - 2.0][j]
        };
        let rows = Mat::from_fn(n, p + 2, value);
        let weights: Vec<f64> = (0..n).map(|i| 0.5 + (i % 3) as f64).collect();
        let preconditioner = Preconditioner::from_pilot(rows.subrows(0, 40), p);
        let mut changed = rows.clone();
        preconditioner.apply(changed.as_mut());
        let gram = Gram::of_rows(changed.as_ref(), Some(&weights));
        let beta = [0.3, -2e-3, 4e3, 0.01];
        for target in 0..2 {
            let score = preconditioner.score(&gram, target, &beta);
            let error = |i: usize| rows[(i, p + target)] - (0..p).map(|j| rows[(i, j)] * beta[j]).sum::<f64>();
            let sum = |value: &dyn Fn(usize) -> f64| (0..n).map(|i| weights[i] * value(i)).sum::<f64>();
            let close = |a: f64, value: &dyn Fn(usize) -> f64| {
                let size = sum(&|i| value(i).abs());
                assert!((a - sum(value)).abs() < 1e-12 * size, "{a} {}", sum(value));
            };
            close(score.sum, &error);
            close(score.squares, &|i| error(i) * error(i));
            (0..p).for_each(|j| close(score.gradient[j], &|i| rows[(i, j)] * error(i)));
        }
    }
}

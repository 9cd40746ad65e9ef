//! Spread of a latent's candidate functions in training, from the statistic of a task that has them.

use std::ops::Range;

use fleetfoot_stats::{Gram, Preconditioner, SquareRoot, least_squares};

/// Mean, covariance and rank of functions over the rows of a statistic.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Mean of every function.
    pub mean: Vec<f64>,
    /// Covariance (divisor: weight), packed lower triangle by rows.
    pub covariance: Vec<f64>,
    /// Numerical rank of the functions about their mean.
    pub rank: usize,
    /// Condition number of the standardised functions.
    pub condition: f64,
    /// Groups of functions (indices) that the rows cannot separate.
    pub confounded: Vec<Vec<usize>>,
}

impl Spread {
    /// Of the functions that are `factor` times smaller than the columns `columns` of a task's statistic.
    ///
    /// # Panics
    /// When a column does not exist.
    pub fn of(root: &SquareRoot, columns: Range<usize>, factor: f64) -> Self {
        let wanted: Vec<usize> = columns.clone().collect();
        let size = root.weight * factor * factor;
        let covariance = root.scatter(columns.clone()).into_iter().map(|product| product / size).collect();
        let some = root.select(&wanted);
        let scale: Vec<f64> = some.deviation().iter().map(|&value| if value > 0.0 { value } else { 1.0 }).collect();
        let solution = least_squares(&some, &scale);
        Self {
            mean: root.mean_x[columns].iter().map(|mean| mean / factor).collect(),
            covariance,
            rank: solution.rank,
            condition: solution.condition,
            confounded: solution.confounded,
        }
    }

    /// Of the columns `columns` of a raw Gram matrix.
    ///
    /// # Panics
    /// When a column does not exist.
    pub fn of_gram(gram: &Gram, columns: Range<usize>) -> Self {
        let some = gram.select(&columns.collect::<Vec<_>>());
        let count = some.dimension();
        Self::of(&Preconditioner::identity(count, 0).square_root(&some), 0..count, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use fleetfoot_stats::{Gram, Preconditioner};

    use super::*;

    #[test]
    fn moments_match_functions() {
        let value = |i: usize, j: usize| ((i * i + 1) as f64 * 0.37 * (j + 1) as f64).sin();
        // Columns -2 f_0, -2 f_1, another, the target.
        let x = Mat::from_fn(9, 4, |i, j| if j < 2 { -2.0 * value(i, j) } else { value(i, j) });
        let root = Preconditioner::identity(3, 1).square_root(&Gram::of_rows(x.as_ref(), None));
        let spread = Spread::of(&root, 0..2, -2.0);
        let mean = |j: usize| (0..9).map(|i| value(i, j)).sum::<f64>() / 9.0;
        let covariance =
            |a: usize, b: usize| (0..9).map(|i| (value(i, a) - mean(a)) * (value(i, b) - mean(b))).sum::<f64>() / 9.0;
        assert!((0..2).all(|j| (spread.mean[j] - mean(j)).abs() < 1e-14));
        let expected = [covariance(0, 0), covariance(1, 0), covariance(1, 1)];
        assert!(spread.covariance.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{:?}", spread.covariance);
        assert_eq!((spread.rank, spread.confounded.len()), (2, 0));
        let gram = Gram::of_rows(Mat::from_fn(9, 3, value).as_ref(), None);
        let raw = Spread::of_gram(&gram, 0..2);
        assert!(raw.covariance.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14) && raw.rank == 2);
    }
}

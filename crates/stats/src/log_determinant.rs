//! Information that a set of rows holds about an affine model: the log-determinant of its regressors' Gram matrix
//! (D-optimality).

use crate::{Gram, PivotedCholesky};

/// Share of a column's variance that the columns before it must leave unexplained for it to count as independent.
const LEAST_PIVOT: f64 = 1e-12;

/// The log-determinant of a Gram matrix with its constant column, a row.
#[derive(Debug, Clone, PartialEq)]
pub struct LogDeterminant {
    /// Natural logarithm, in the columns' units; minus infinity when some columns depend on the others.
    pub value: f64,
    /// Columns that are constant or combinations of the others, ascending; none when the value is finite.
    pub dependent: Vec<usize>,
}

impl Gram {
    /// `ln det((1/W) [1 X]'[1 X])`: by Schur's complement of the constant's entry this is `ln det` of the covariance matrix (divisor W)
    /// of the columns, so it does not depend on where the columns' origins are.
    ///
    /// It is what D-optimal design maximises (Kiefer and Wolfowitz 1960; Goodwin and Payne 1977, section 6.2): the volume of the confidence
    /// ellipsoid of an affine model's coefficients falls as `exp(-value / 2)`. Other units add a constant, so the difference between
    /// two logs of the same columns has no unit. Computed by Cholesky factorisation of the correlation matrix with diagonal pivoting.
    pub fn log_determinant(&self) -> LogDeterminant {
        let d = self.dimension();
        let deviation = self.deviations();
        let floor: Vec<f64> =
            (0..d).map(|j| if deviation[j] > 0.0 { LEAST_PIVOT * self.get(j, j) } else { f64::INFINITY }).collect();
        let cholesky = PivotedCholesky::new(d, d, |i, j| self.get(i, j), &floor);
        let pivot = |(row, &column): (usize, &usize)| cholesky.factor.column(column)[row].powi(2) / self.weight;
        let value: f64 = cholesky.order.iter().enumerate().map(|pivot_of| pivot(pivot_of).ln()).sum();
        let dependent: Vec<usize> = (0..d).filter(|j| !cholesky.order.contains(j)).collect();
        LogDeterminant { value: if dependent.is_empty() { value } else { f64::NEG_INFINITY }, dependent }
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    fn rows(columns: usize, n: usize) -> Mat<f64> {
        Mat::from_fn(n, columns, |i, j| ((i * (j + 2)) as f64 * 0.37).sin() + 0.3 * (i as f64 * 0.11).cos() + 5.0)
    }

    #[test]
    fn determinant_matches_elimination() {
        let (n, d) = (500, 4);
        let x = rows(d, n);
        let got = Gram::of_rows(x.as_ref(), None).log_determinant();
        let augmented = |i: usize, row: usize| if i == 0 { 1.0 } else { x[(row, i - 1)] };
        let mut g: Vec<Vec<f64>> = (0..=d)
            .map(|i| {
                (0..=d).map(|j| (0..n).map(|r| augmented(i, r) * augmented(j, r)).sum::<f64>() / n as f64).collect()
            })
            .collect();
        let mut expected = 0.0;
        for k in 0..=d {
            expected += g[k][k].ln();
            for i in k + 1..=d {
                let factor = g[i][k] / g[k][k];
                for j in k..=d {
                    g[i][j] -= factor * g[k][j];
                }
            }
        }
        // Elimination of the uncentred matrix loses the square of mean over deviation.
        assert!((got.value - expected).abs() < 1e-10, "{} {expected}", got.value);
        assert!(got.dependent.is_empty());
    }

    #[test]
    fn units_add_a_constant_and_origins_nothing() {
        let x = rows(3, 300);
        let moved = Mat::from_fn(300, 3, |i, j| 10.0 * x[(i, j)] - 7.0);
        let values = [x, moved].map(|x| Gram::of_rows(x.as_ref(), None).log_determinant().value);
        assert!((values[1] - values[0] - 6.0 * 10f64.ln()).abs() < 1e-11, "{values:?}");
    }

    #[test]
    fn constants_and_combinations_are_named() {
        let x = rows(5, 300);
        let bound = Mat::from_fn(300, 5, |i, j| match j {
            1 => 0.1,
            4 => 2.0 * x[(i, 0)] - x[(i, 2)] + 1.0,
            _ => x[(i, j)],
        });
        let determinant = Gram::of_rows(bound.as_ref(), None).log_determinant();
        assert_eq!(determinant.value, f64::NEG_INFINITY);
        assert_eq!(determinant.dependent.len(), 2);
        assert!(
            determinant.dependent.contains(&1) && determinant.dependent.iter().any(|j| [0, 2, 4].contains(j)),
            "{determinant:?}"
        );
        assert_eq!(Gram::new(2).log_determinant().dependent, [0, 1]);
    }
}

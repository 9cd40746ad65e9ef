//! Collinearity of the columns of a Gram matrix: eigenvalues of their correlations, and the coefficients that each
//! direction harms.

use faer::Mat;

use crate::{Gram, svd};

/// Deviations below this share of the mean are the rounding of a constant.
const ROUNDING: f64 = 1e-13;

/// The collinearity of standardised columns (Belsley, Kuh, Welsch, Regression Diagnostics, 1980, section 3.2).
#[derive(Debug, Clone, PartialEq)]
pub struct Collinearity {
    /// The columns that vary, ascending (m).
    pub columns: Vec<usize>,
    /// Eigenvalues of their correlation matrix, descending (m); they sum to m, and all are 1 when no two columns move together.
    pub eigenvalues: Vec<f64>,
    /// Variance inflation factors: how many times the variance of each column's coefficient is what it would be if no other column moved with it (m). A column that
    /// depends on the others has a factor of the order of the inverse of rounding.
    pub inflation: Vec<f64>,
    /// Of the variance of each column's coefficient, the share that comes from each direction: directions x columns (m x m). The shares of a column sum to 1.
    pub proportions: Vec<Vec<f64>>,
}

impl Gram {
    /// The standard deviation of each column (divisor W), 0 for those that are constant up to rounding.
    pub(crate) fn deviations(&self) -> Vec<f64> {
        let deviation = |j: usize| (self.get(j, j) / self.weight).max(0.0).sqrt();
        let moves = |j: usize| deviation(j) > ROUNDING * self.mean[j].abs() && deviation(j).is_finite();
        (0..self.dimension()).map(|j| if moves(j) { deviation(j) } else { 0.0 }).collect()
    }

    /// The collinearity of the columns; `None` if no column varies, or if the moments are not finite.
    pub fn collinearity(&self) -> Option<Collinearity> {
        let deviation = self.deviations();
        let columns: Vec<usize> = (0..self.dimension()).filter(|&j| deviation[j] > 0.0).collect();
        let m = columns.len();
        if m == 0 {
            return None;
        }
        let correlation = Mat::from_fn(m, m, |i, j| {
            let (i, j) = (columns[i], columns[j]);
            self.get(i, j) / self.weight / (deviation[i] * deviation[j])
        });
        // Of a symmetric matrix without negative eigenvalues these are the singular values.
        let factors = svd(correlation.as_ref())?;
        // Values below the rounding of the correlations are as good as zero.
        let least = m as f64 * f64::EPSILON;
        let harm =
            |direction: usize, column: usize| factors.v[(column, direction)].powi(2) / factors.s[direction].max(least);
        let all: Vec<f64> = (0..m).map(|column| (0..m).map(|direction| harm(direction, column)).sum()).collect();
        let shares = |direction: usize| (0..m).map(|column| harm(direction, column) / all[column]).collect();
        let proportions = (0..m).map(shares).collect();
        let eigenvalues = factors.s.iter().map(|&value| if value > least { value } else { 0.0 }).collect();
        Some(Collinearity { columns, eigenvalues, inflation: all, proportions })
    }
}

impl Collinearity {
    /// The condition index of a direction: the root of the largest eigenvalue over its own; infinite where that is zero.
    ///
    /// # Panics
    /// If there is no such direction.
    pub fn index(&self, direction: usize) -> f64 {
        (self.eigenvalues[0] / self.eigenvalues[direction]).sqrt()
    }

    /// The logarithm of the determinant of the correlation matrix: 0 when no two columns move together, minus infinity when some depend on the others.
    pub fn log_determinant(&self) -> f64 {
        self.eigenvalues.iter().map(|value| value.ln()).sum()
    }

    /// Groups of columns of which the directions from `index` on take more than `share` of the variance: two coefficients at least, the weakest direction first.
    /// Weak directions that share a column are told as one.
    pub fn together(&self, index: f64, share: f64) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let weak: Vec<usize> = (0..self.columns.len()).rev().filter(|&k| self.index(k) >= index).collect();
        for &direction in &weak {
            // Several weak directions may part the variance of a coefficient among them.
            let joint = |column: usize| weak.iter().map(|&k| self.proportions[k][column]).sum::<f64>();
            let takes_part = |&column: &usize| {
                joint(column) > share && self.proportions[direction][column] > share / weak.len() as f64
            };
            let mut group: Vec<usize> =
                (0..self.columns.len()).filter(takes_part).map(|column| self.columns[column]).collect();
            while let Some(at) = groups.iter().position(|other| other.iter().any(|column| group.contains(column))) {
                group.extend(groups.remove(at));
            }
            group.sort_unstable();
            group.dedup();
            if group.len() > 1 {
                groups.push(group);
            }
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns that are orthogonal over the rows, and one that is almost the sum of two of them.
    fn columns(rest: f64) -> Vec<Vec<f64>> {
        let wave = |k: f64| (0..64).map(|row| (std::f64::consts::TAU * k * f64::from(row) / 64.0).cos()).collect();
        let (a, b, c): (Vec<f64>, Vec<f64>, Vec<f64>) = (wave(1.0), wave(2.0), wave(3.0));
        let d: Vec<f64> = wave(5.0);
        let sum = a.iter().zip(&b).zip(&d).map(|((a, b), d)| 1e3 * (a + b + rest * d) + 7.0).collect();
        vec![a, b, c, sum, vec![2.5; 64]]
    }

    fn of_rest(rest: f64) -> Collinearity {
        let columns = columns(rest);
        let views: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        Gram::of_columns(&views, None).collinearity().unwrap()
    }

    #[test]
    fn eigenvalues_match_correlations() {
        let weakest = of_rest(0.0);
        assert_eq!(weakest.columns, [0, 1, 2, 3], "the constant column is left out");
        // Correlations of the sum with its parts: 1/sqrt(2). Of that block the eigenvalues are 2, 1 and 0.
        for (value, exact) in weakest.eigenvalues.iter().zip([2.0, 1.0, 1.0, 0.0]) {
            assert!((value - exact).abs() < 1e-14, "{:?}", weakest.eigenvalues);
        }
        assert_eq!(weakest.log_determinant(), f64::NEG_INFINITY);
        assert_eq!(weakest.together(30.0, 0.5), [vec![0, 1, 3]]);
    }

    #[test]
    fn collinear_columns_alone_are_named() {
        let weak = of_rest(1e-2);
        assert!(weak.index(3) > 100.0 && weak.index(3) < 300.0, "{}", weak.index(3));
        assert_eq!(weak.together(30.0, 0.5), [vec![0, 1, 3]]);
        for column in 0..4 {
            let sum: f64 = weak.proportions.iter().map(|shares| shares[column]).sum();
            assert!((sum - 1.0).abs() < 1e-12);
        }
        let strong = of_rest(2.0);
        assert!(strong.together(30.0, 0.5).is_empty());
        // Of two columns alone the factor is 1 over 1 less the square of their correlation.
        let pair = |angle: f64| {
            let wave = |k: f64| (0..64).map(move |row| (std::f64::consts::TAU * k * f64::from(row) / 64.0).cos());
            let mixed: Vec<f64> = wave(1.0).zip(wave(2.0)).map(|(a, b)| angle.cos() * a + angle.sin() * b).collect();
            Gram::of_columns(&[&wave(1.0).collect::<Vec<_>>(), &mixed], None).collinearity().unwrap().inflation
        };
        for inflation in pair(0.3) {
            assert!((inflation - 1.0 / (1.0 - 0.3f64.cos().powi(2))).abs() < 1e-10);
        }
        // The determinant of the block: 1 less the squares of both correlations.
        assert!((strong.log_determinant() - (1.0f64 - 2.0 / 6.0).ln()).abs() < 1e-13);
    }

    #[test]
    fn columns_that_do_not_move_have_none() {
        assert_eq!(Gram::of_columns(&[&[1.0, 1.0], &[3.0, 3.0]], None).collinearity(), None);
        assert_eq!(Gram::new(3).collinearity(), None);
    }
}

//! Paths of solutions over decreasing lambda.

use crate::{Penalty, Solution, SparseError, estimator::Estimator, penalty::check_strength};

/// Why a path ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PathStatus {
    /// It reached lambda = 0.
    Complete,
    /// It reached lambda = 0 with as many independent active columns as there are rows: the data are interpolated.
    Saturated,
    /// It reached the smallest lambda that was asked for.
    LambdaMin,
    /// Another column would have entered than was allowed.
    MaxFeatures,
    /// It has as many knots as were allowed.
    MaxKnots,
    /// Rounding hid how it goes on: ill-conditioned columns. The path is valid down to its last knot.
    Stalled,
}

/// A regularisation path over decreasing lambda: of LARS linear between its knots, of other penalties the solutions at a grid of lambdas.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Path {
    /// Knots, lambda strictly decreasing. Above the first one, the coefficients are those of the first.
    pub knots: Vec<Solution>,
    /// Why it ended.
    pub status: PathStatus,
    /// Columns left out because only rounding separates them from the active ones at the end of the path. Their
    /// remainder beyond those is below 1e-9 of their length (square-root form; about 1e-7 in Gram form), or below their
    /// own rounding.
    pub collinear: Vec<usize>,
    /// Columns left out because they do not vary.
    pub constant: Vec<usize>,
    pub(crate) columns: usize,
    pub(crate) penalty: Penalty,
    pub(crate) l2: f64,
    /// Estimator whose objective the solutions minimise.
    pub(crate) estimator: Estimator,
    /// True if the path is linear between its knots.
    pub(crate) linear: bool,
}

impl Path {
    /// Coefficients (p, raw units) at any lambda of the path, by interpolation between the knots: exact up to rounding. A path that is not linear is known at its
    /// knots.
    ///
    /// # Errors
    /// When `lambda` is negative, not finite, below the end of a path that was stopped, or between two knots of a path that is not linear.
    pub fn coefficients(&self, lambda: f64) -> Result<Vec<f64>, SparseError> {
        check_strength("lambda", lambda)?;
        let end = self.knots.last().map_or(0.0, |knot| knot.l1);
        if lambda < end {
            return Err(SparseError::BelowPath { lambda, end });
        }
        let after = self.knots.partition_point(|knot| knot.l1 > lambda);
        let below = &self.knots[after.min(self.knots.len() - 1)];
        let mut dense = below.dense(self.columns);
        if after > 0 && below.l1 < lambda {
            if !self.linear {
                return Err(SparseError::BetweenKnots { lambda });
            }
            let above = &self.knots[after - 1];
            let share = (lambda - below.l1) / (above.l1 - below.l1);
            dense.iter_mut().for_each(|value| *value *= 1.0 - share);
            above.support.iter().zip(&above.coefficients).for_each(|(&j, &value)| dense[j] += share * value);
        }
        Ok(dense)
    }
}

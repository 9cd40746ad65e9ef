//! Solutions, and the paths that they lie on.

use fleetfoot_data::checkpoint;

use crate::{
    Certificate, Penalty, Quadratic, SparseError,
    certificate::certify,
    estimator::Estimator,
    kernel::Slab,
    penalty::{Weights, check_strength},
    shape::{Columns, Shape},
};

/// Solutions that are certified at once, as one matrix product.
const BATCH: usize = 64;

/// The minimiser at one pair of strengths, in raw units.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Solution {
    /// Weight of the absolute values; for an elastic net given by `lambda` and `l1_ratio`, their product. Of group penalties, lambda.
    pub l1: f64,
    /// Weight of the squares.
    pub l2: f64,
    /// Columns whose coefficients are not zero, ascending.
    pub support: Vec<usize>,
    /// Their coefficients.
    pub coefficients: Vec<f64>,
    /// The intercept; 0 for problems without one.
    pub intercept: f64,
    /// Weighted residual sum of squares over n.
    pub mse: f64,
    /// Share of the target's variance that is explained (of its mean square, without an intercept); 0 for a target that does not vary.
    pub r2: f64,
    /// How far this is from the minimum.
    pub certificate: Certificate,
    /// Whether the solver met its tolerance; a knot of a path is exact up to rounding.
    pub converged: bool,
}

impl Solution {
    /// All p coefficients.
    pub fn dense(&self, columns: usize) -> Vec<f64> {
        let mut dense = vec![0.0; columns];
        self.support.iter().zip(&self.coefficients).for_each(|(&j, &value)| dense[j] = value);
        dense
    }

    /// The coefficient of one column.
    pub fn coefficient(&self, column: usize) -> f64 {
        self.support.binary_search(&column).map_or(0.0, |at| self.coefficients[at])
    }

    /// Signs of the coefficients of the support, 1 or -1.
    pub fn signs(&self) -> Vec<f64> {
        self.coefficients.iter().map(|value| value.signum()).collect()
    }
}

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
    /// Columns left out because nothing but rounding tells them from the active ones at the end of the path: what they have beyond those is below 1e-9
    /// of their length (square-root form; about 1e-7 in Gram form), or below their own rounding.
    pub collinear: Vec<usize>,
    /// Columns left out because they do not vary.
    pub constant: Vec<usize>,
    pub(crate) columns: usize,
    pub(crate) penalty: Penalty,
    pub(crate) l2: f64,
    /// What its solutions minimise.
    pub(crate) estimator: Estimator,
    /// Whether it is linear between its knots.
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

    /// The solution at any lambda of the path, certified; of a path that is not linear it is solved for.
    ///
    /// # Errors
    /// As [`Path::coefficients`], and when `problem` has another number of columns than the path.
    pub fn at(&self, problem: &Quadratic, lambda: f64) -> Result<Solution, SparseError> {
        if problem.columns() != self.columns {
            return Err(SparseError::OtherProblem { found: self.columns, expected: problem.columns() });
        }
        if !self.linear {
            check_strength("lambda", lambda)?;
            let mut found = self.estimator.solutions(problem, &self.penalty, &[lambda])?;
            return Ok(found.remove(0));
        }
        let raw = self.coefficients(lambda)?;
        let size = problem.target_length();
        let delta = raw.iter().enumerate().filter(|(_, value)| **value != 0.0);
        let delta = delta.map(|(j, value)| (j, value * (problem.length[j] / size))).collect();
        let weights = Weights::new(problem, &self.penalty)?;
        let mut found = finish(problem, &weights, vec![Point { l1: lambda, l2: self.l2, delta, converged: true }]);
        Ok(found.remove(0))
    }
}

/// Coefficients in correlation form at raw strengths.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) l1: f64,
    pub(crate) l2: f64,
    pub(crate) delta: Vec<(usize, f64)>,
    pub(crate) converged: bool,
}

/// Solutions in raw units with their certificates.
pub(crate) fn finish(problem: &Quadratic, weights: &Weights, points: Vec<Point>) -> Vec<Solution> {
    let shape = |point: &Point| Columns { weights, l1: point.l1 / weights.tau, l2: point.l2 };
    finish_shaped(problem, weights, points, shape)
}

/// [`finish`] for any penalty, by its shape at every point.
pub(crate) fn finish_shaped<S: Shape>(
    problem: &Quadratic,
    weights: &Weights,
    mut points: Vec<Point>,
    shape: impl Fn(&Point) -> S,
) -> Vec<Solution> {
    let mut solutions = Vec::with_capacity(points.len());
    for point in &mut points {
        point.delta.retain(|(_, delta)| *delta != 0.0);
        point.delta.sort_by_key(|(j, _)| *j);
    }
    // A run of equal ridges is one product.
    for run in points.chunk_by(|a, b| a.l2 == b.l2) {
        for batch in run.chunks(BATCH) {
            checkpoint();
            let mut delta = Slab::zeros(problem.columns(), batch.len());
            for (k, point) in batch.iter().enumerate() {
                point.delta.iter().for_each(|&(j, value)| delta.column_mut(k)[j] = value);
            }
            let shapes: Vec<S> = batch.iter().map(&shape).collect();
            let certified = certify(problem, weights, batch[0].l2, &shapes, &delta);
            let finished = batch.iter().zip(certified).map(|(point, found)| solution(problem, point, found));
            solutions.extend(finished);
        }
    }
    solutions
}

fn solution(problem: &Quadratic, point: &Point, (certificate, rss): (Certificate, f64)) -> Solution {
    let support: Vec<usize> = point.delta.iter().map(|(j, _)| *j).collect();
    let coefficients: Vec<f64> = point.delta.iter().map(|&(j, delta)| problem.raw(j, delta)).collect();
    let deviation = problem.target_length() / problem.weight().sqrt();
    let varies = problem.target_deviation() > 0.0;
    Solution {
        l1: point.l1,
        l2: point.l2,
        intercept: problem.intercept(support.iter().copied().zip(coefficients.iter().copied())),
        mse: rss * deviation * deviation,
        r2: if varies { 1.0 - rss } else { 0.0 },
        support,
        coefficients,
        certificate,
        converged: point.converged,
    }
}

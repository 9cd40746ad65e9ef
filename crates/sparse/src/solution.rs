//! Solutions in raw units, with their certificates.

use fleetfoot_data::checkpoint;

use crate::{
    Certificate, Quadratic,
    certificate::certify,
    kernel::Slab,
    penalty::Weights,
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
    /// Distance from the minimum.
    pub certificate: Certificate,
    /// True if the solver met its tolerance; a knot of a path is exact up to rounding.
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
            let finished = batch.iter().zip(certified).map(|(point, certified)| solution(problem, point, certified));
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

/// A solution, and what it cost.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Descended {
    /// The solution.
    pub solution: Solution,
    /// Sweeps over the working set, all working sets of this lambda together; 0 where the start met the tolerance.
    pub epochs: usize,
}

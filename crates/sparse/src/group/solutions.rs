//! The solutions along lambda.

use super::{
    descent::Descent,
    lasso::{GroupLasso, Posed},
};
use crate::{
    Penalty, Quadratic, SparseError,
    penalty::{check_strength, check_tolerance},
    solution::{Descended, Point, finish_shaped},
};

/// The smallest lambda at which every penalised coefficient is zero. Exact: the largest dual norm of a group.
pub(crate) fn lambda_max(lasso: &GroupLasso, problem: &Quadratic, penalty: &Penalty) -> Result<f64, SparseError> {
    let posed = Posed::new(lasso, problem, penalty)?;
    let mut descent = Descent::new(problem, &posed.blocks);
    descent.solve(f64::INFINITY, lasso.tolerance, lasso.max_epochs)?;
    let penalised = posed.blocks.iter().filter(|block| block.penalised());
    let entries = penalised.map(|block| block.critical(&descent.left.gradient, |j| problem.noise[j]));
    let largest = entries.fold(0.0, f64::max) * posed.weights.tau;
    Ok(if problem.target_deviation() > 0.0 { largest } else { 0.0 })
}

/// The minimisers at every lambda, each started from the one before, the first from `start` (p, raw units) or from zero.
pub(crate) fn descend(
    lasso: &GroupLasso,
    problem: &Quadratic,
    penalty: &Penalty,
    lambdas: &[f64],
    start: Option<&[f64]>,
) -> Result<Vec<Descended>, SparseError> {
    check_tolerance(lasso.tolerance)?;
    for &lambda in lambdas {
        check_strength("lambda", lambda)?;
    }
    let posed = Posed::new(lasso, problem, penalty)?;
    let mut descent = Descent::new(problem, &posed.blocks);
    if let Some(start) = start {
        descent.start(&posed.scaled(problem, start, "the start")?);
    }
    let (mut points, mut epochs) = (Vec::with_capacity(lambdas.len()), Vec::with_capacity(lambdas.len()));
    for &lambda in lambdas {
        let (converged, used) = descent.solve(lambda / posed.weights.tau, lasso.tolerance, lasso.max_epochs)?;
        let delta = descent.left.delta.iter().copied().enumerate().filter(|(_, value)| *value != 0.0).collect();
        points.push(Point { l1: lambda, l2: 0.0, delta, converged });
        epochs.push(used);
    }
    let solutions = finish_shaped(problem, &posed.weights, points, |point| posed.at(point.l1)).into_iter();
    Ok(solutions.zip(epochs).map(|(solution, epochs)| Descended { solution, epochs }).collect())
}

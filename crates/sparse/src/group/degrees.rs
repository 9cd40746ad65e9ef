//! Degrees of freedom of a group-sparse fit.

use super::{
    block::Block,
    descent::Descent,
    lasso::{GroupLasso, Posed},
    small::{Part, Small},
};
use crate::{Penalty, Quadratic, Solution, SparseError};

/// Trace of `A (A'A + P)^-1 A'` over the support, P the curvature of the groups' norms at the solution: the divergence of the fit, an unbiased estimate (Vaiter,
/// Deledalle, Peyré, Fadili, Dossal 2012). The intercept is not counted.
pub(crate) fn degrees_of_freedom(
    lasso: &GroupLasso,
    problem: &Quadratic,
    penalty: &Penalty,
    solution: &Solution,
) -> Result<f64, SparseError> {
    let posed = Posed::new(lasso, problem, penalty)?;
    let delta = posed.scaled(problem, &solution.dense(problem.columns()), "the solution")?;
    let active = |block: &Block| block.columns.iter().any(|&j| delta[j] != 0.0);
    let kept = posed.blocks.iter().filter(|block| !block.penalised() || active(block));
    let mut descent = Descent::new(problem, &posed.blocks);
    let (mut parts, mut columns) = (Vec::new(), Vec::new());
    for block in kept {
        let rule = block.at(solution.l1 / posed.weights.tau);
        parts.push(Part { first: columns.len(), rule, spectrum: None });
        columns.extend(block.members());
    }
    let v: Vec<f64> = columns.iter().map(|(j, unit)| delta[*j] * unit).collect();
    let matrix = descent.matrix(&columns);
    let target = vec![0.0; matrix.stride()];
    Ok(Small { matrix, target, parts }.degrees_of_freedom(&v))
}

//! The adaptive lasso: penalty factors from a first fit.

use crate::{
    Penalty, Quadratic, Solution, SparseError,
    factor::Factor,
    penalty::{Weights, check_strength},
};

/// The fit that adaptive weights are made from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Initial {
    /// Least squares: for columns that do not depend on each other.
    LeastSquares,
    /// Ridge with this weight of the squares ([`Strength::l2`](crate::Strength)).
    Ridge {
        /// The weight.
        l2: f64,
    },
}

/// The penalty of the adaptive lasso (Zou 2006): the factors of `penalty` divided by `|u_j b_j|^exponent`, b a first fit without l1 penalty and
/// u the units of the penalty. Columns that the first fit leaves at zero get an infinite factor: they are left out. Give it to any solver.
///
/// # Errors
/// When the penalty or an option is out of range, or [`Initial::LeastSquares`] meets columns that depend on others.
pub fn adaptive(
    problem: &Quadratic,
    penalty: &Penalty,
    initial: Initial,
    exponent: f64,
) -> Result<Penalty, SparseError> {
    if !(exponent > 0.0 && exponent.is_finite()) {
        return Err(SparseError::Exponent { value: exponent });
    }
    let l2 = match initial {
        Initial::LeastSquares => 0.0,
        Initial::Ridge { l2 } => check_strength("l2 of the first fit", l2)?,
    };
    let weights = Weights::new(problem, penalty)?;
    let mut factor = Factor::new(problem, &weights, l2);
    let p = problem.columns();
    let columns: Vec<usize> = (0..p).filter(|&j| weights.used(j) && !factor.append(j, 0.0)).collect();
    if !columns.is_empty() {
        return Err(SparseError::NeedsRidge { columns });
    }
    let (solution, _) = factor.solutions();
    let deviation = problem.deviation();
    let mut factors = vec![f64::INFINITY; p];
    for (&j, &delta) in factor.order.iter().zip(&solution) {
        let base = penalty.factors.get(j).copied().unwrap_or(1.0);
        let unit = if penalty.standardise { deviation[j] } else { 1.0 };
        let size = (unit * problem.raw(j, delta)).abs().powf(exponent);
        factors[j] = if base == 0.0 { 0.0 } else { base / size };
    }
    Ok(Penalty { factors, ..penalty.clone() })
}

/// Effective degrees of freedom of a solution, the intercept not counted: the rank of the support for the lasso (Tibshirani and Taylor 2012), and
/// `tr A (A'A + ridge)^-1 A'` over the support with a ridge (Zou, Hastie, Tibshirani 2007).
///
/// # Errors
/// When the penalty is not valid.
pub fn degrees_of_freedom(problem: &Quadratic, penalty: &Penalty, solution: &Solution) -> Result<f64, SparseError> {
    let weights = Weights::new(problem, penalty)?;
    let mut factor = Factor::new(problem, &weights, solution.l2);
    for &j in solution.support.iter().filter(|&&j| j < problem.columns() && weights.used(j)) {
        factor.append(j, 0.0);
    }
    let lost = factor.order.iter().zip(factor.inverse_diagonal());
    Ok(factor.order.len() as f64 - lost.map(|(&j, inverse)| solution.l2 * weights.rho[j] * inverse).sum::<f64>())
}

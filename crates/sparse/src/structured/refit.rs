//! Least squares on a support.

use fleetfoot_stats::SquareRoot;
use fleetfoot_sums::structured::Structure;

use super::{Assembly, assemble};
use crate::{
    Penalty, Sign, SparseError,
    lars::{LarsOptions, lars},
};

/// Least squares on the support, with priors, Tikhonov term and signs, without an l1 penalty: the last line of Algorithm 1. `theta` (p) is 0 elsewhere.
///
/// If columns of the support depend on each other, the first ones carry the fit.
///
/// # Errors
/// The errors of [`assemble()`]; a column of the support that does not exist.
pub fn refit(
    structure: &Structure,
    roots: &[SquareRoot],
    assembly: &Assembly,
    support: &[usize],
) -> Result<Vec<f64>, SparseError> {
    let p = structure.coefficients();
    if let Some(&column) = support.iter().find(|&&column| column >= p) {
        return Err(SparseError::Length { what: "the regression", actual: p, expected: column + 1 });
    }
    let assembled = assemble(structure, roots, assembly)?;
    let penalty = least_squares_penalty(&assembled.penalty, p, support);
    let path = lars(&assembled.problem, &penalty, &LarsOptions::default())?;
    Ok(path.knots.last().map_or_else(|| vec![0.0; p], |solution| assembled.coefficients(solution)))
}

/// The penalty whose minimiser is least squares on the support.
pub(crate) fn least_squares_penalty(penalty: &Penalty, p: usize, support: &[usize]) -> Penalty {
    let mut factors = vec![f64::INFINITY; p];
    for &j in support {
        if penalty.factors.get(j).is_none_or(|factor| factor.is_finite()) {
            factors[j] = 0.0;
        }
    }
    let free = penalty.signs.iter().all(|sign| *sign == Sign::Free);
    Penalty { standardise: false, factors, signs: if free { Vec::new() } else { penalty.signs.clone() } }
}

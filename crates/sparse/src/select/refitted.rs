//! The held-out error of the model that is written: its support, refitted on every fold's training rows.

use fleetfoot_data::{Progress, parallel_map};

use super::{Folds, SelectError, cross_validation::fold_roots};
use crate::structured::{Assembly, Banks, Structure, refit};

/// Mean squared error of every measured task (priors not) on held-out rows, in the units of its target: least squares on `support` ([`refit`]) is made again
/// on every fold's training rows. Means weigh each fold by its held-out rows.
///
/// # Errors
/// As [`refit`], and when folds and members disagree, a fold holds out nothing, or the user stops it.
pub fn held_out_refit(
    structure: &Structure,
    banks: &Banks,
    assembly: &Assembly,
    folds: &Folds,
    support: &[usize],
    progress: &dyn Progress,
) -> Result<Vec<f64>, SelectError> {
    let roots = fold_roots(banks, folds, progress)?;
    let k = folds.len();
    let found = parallel_map(k, progress, |fold| {
        let theta = refit(structure, &roots[fold], assembly, support)?;
        let test = &roots[k + fold];
        let errors = structure.errors(test, &theta);
        let measured = (0..errors.len()).filter(|&task| !structure.tasks[task].prior);
        let squares: Vec<[f64; 2]> =
            measured.map(|task| [test[task].weight * errors[task].rms().powi(2), test[task].weight]).collect();
        match squares.iter().all(|[_, weight]| *weight > 0.0) {
            true => Ok(squares),
            false => Err(SelectError::EmptyFold { fold, side: "test" }),
        }
    })?;
    let tasks = found.first().map_or(0, Vec::len);
    let sum = |task: usize, at: usize| found.iter().map(|squares| squares[task][at]).sum::<f64>();
    Ok((0..tasks).map(|task| sum(task, 0) / sum(task, 1)).collect())
}

//! The held-out error of the model that is written: its support, refitted on every fold's training rows.

use fleetfoot_data::{Cancelled, Progress, parallel_map};
use fleetfoot_stats::SquareRoot;

use super::{Folds, SelectError, cross_validation::fold_roots};
use fleetfoot_sums::structured::{Banks, Structure};

/// Mean squared error of every measured task (priors not) on held-out rows, in the units of its target: the coefficients are fitted again to every fold's training
/// rows, by `fit` of their square-root forms. Means weigh each fold by its held-out rows.
///
/// # Errors
/// Those of `fit`, and when folds and members disagree, a fold holds out nothing, or the user stops it.
pub fn held_out_refit<E: From<SelectError> + From<Cancelled> + Send>(
    structure: &Structure,
    banks: &Banks,
    folds: &Folds,
    fit: impl Fn(&[SquareRoot]) -> Result<Vec<f64>, E> + Sync,
    progress: &dyn Progress,
) -> Result<Vec<f64>, E> {
    let roots = fold_roots(banks, folds, progress)?;
    let k = folds.len();
    let results = parallel_map(k, progress, |fold| {
        let theta = fit(&roots[fold])?;
        let test = &roots[k + fold];
        let errors = structure.errors(test, &theta);
        let measured = (0..errors.len()).filter(|&task| !structure.tasks[task].prior);
        let squares: Vec<[f64; 2]> =
            measured.map(|task| [test[task].weight * errors[task].rms().powi(2), test[task].weight]).collect();
        match squares.iter().all(|[_, weight]| *weight > 0.0) {
            true => Ok::<_, E>(squares),
            false => Err(SelectError::EmptyFold { fold, side: "test" }.into()),
        }
    })?;
    let tasks = results.first().map_or(0, Vec::len);
    let sum = |task: usize, at: usize| results.iter().map(|squares| squares[task][at]).sum::<f64>();
    Ok((0..tasks).map(|task| sum(task, 0) / sum(task, 1)).collect())
}

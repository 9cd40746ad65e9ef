//! Effective number of independent rows.

use fleetfoot_stats::BatchMeans;

use super::SelectError;
use crate::SparseError;
use fleetfoot_sums::structured::{Banks, Structure};

/// Rows that count as independent, by the batch means of the residuals of the coefficients `theta` (p) over the chunks: the fewest of the measured tasks
/// ([`BatchMeans`]), whatever the scale of the weights.
///
/// # Errors
/// When the lengths disagree, or the statistics have no rows.
pub fn effective_rows(structure: &Structure, banks: &Banks, theta: &[f64]) -> Result<f64, SelectError> {
    let (p, count) = (structure.coefficients(), theta.len());
    if count != p {
        return Err(SparseError::Length { what: "the coefficients", actual: count, expected: p }.into());
    }
    let (tasks, count) = (structure.tasks.len(), banks.tasks().len());
    if count != tasks {
        return Err(
            SparseError::Length { what: "the list of the tasks' statistics", actual: count, expected: tasks }.into()
        );
    }
    let mut least: Option<f64> = None;
    let totals = banks.total();
    for (task, (preconditioner, bank)) in banks.tasks().iter().enumerate() {
        if structure.tasks[task].prior {
            continue;
        }
        let coefficients: Vec<f64> = structure.columns(task).into_iter().map(|j| theta[j]).collect();
        if preconditioner.dimension() != coefficients.len() + 1 {
            let (dimension, expected) = (preconditioner.dimension(), coefficients.len() + 1);
            return Err(SparseError::Length { what: "a task's statistic", actual: dimension, expected }.into());
        }
        // The residual is linear in the preconditioned row z: `(centre + z A) e`.
        let error: Vec<f64> = coefficients.iter().map(|theta| -theta).chain([1.0]).collect();
        let (centre, map) = preconditioner.raw_map();
        let weights = |i: usize| (0..error.len()).map(|j| map[(i, j)] * error[j]).sum::<f64>();
        let weights: Vec<f64> = (0..error.len()).map(weights).collect();
        let constant: f64 = centre.iter().zip(&error).map(|(centre, error)| centre * error).sum();
        let root = &totals[task];
        // Weights of mean 1: their scale says nothing of the number of rows.
        let unit_weight = root.weight / root.rows as f64;
        let mut means = BatchMeans::new(1);
        for k in 0..bank.len() {
            let chunk = bank.member(k);
            let mean: f64 = chunk.mean.iter().zip(&weights).map(|(mean, weight)| mean * weight).sum();
            means.add(banks.keys()[k].episode, chunk.weight / unit_weight, &[constant + mean]);
        }
        let squares = root.error(faer::MatRef::from_column_major_slice(&coefficients, coefficients.len(), 1), &[0.0]);
        let squares: Vec<f64> = squares.iter().map(|square| square / unit_weight).collect();
        let rows = means.effective_weight(root.rows as f64, &squares);
        least = Some(least.map_or(rows, |least| least.min(rows)));
    }
    least.filter(|rows| *rows > 0.0).ok_or(SparseError::NoRows.into())
}

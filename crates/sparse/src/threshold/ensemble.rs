//! Ensembles of models: over replicates of the rows, and over draws of the candidate functions.

use fleetfoot_data::{Progress, mix, parallel_map};
use fleetfoot_stats::Compressed;

use super::{
    Optimizer, Scaling, Step, Terms, ThresholdError,
    error::share,
    optimize,
    prepared::Prepared,
    select::{check_terms, same_shape},
};

/// Options of an ensemble.
#[derive(Debug, Clone, PartialEq)]
pub struct EnsembleOptions {
    /// Candidate functions that are left out of each model at random (library bagging); 0: none.
    pub leave_out: usize,
    /// Models of each replicate; more than one is useful only with library bagging.
    pub draws: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Share of the models that must select a term for it to be in the final one.
    pub probability: f64,
}

impl Default for EnsembleOptions {
    /// One model a replicate, no candidate left out, terms of more than half of the models.
    fn default() -> Self {
        Self { leave_out: 0, draws: 1, seed: 0, probability: 0.5 }
    }
}

/// Consensus of the models of one target, p candidate columns.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Ensemble {
    /// Models that were offered each column (p).
    pub offered: Vec<usize>,
    /// Share of them that selected it (p): the inclusion probability. 0 for columns that were never offered.
    pub inclusion: Vec<f64>,
    /// Mean of its coefficient over them, zeros included (p): bagging.
    pub mean: Vec<f64>,
    /// Median of its coefficient over them, zeros included (p): bragging.
    pub median: Vec<f64>,
    /// Standard deviation of its coefficient over them, zeros included, divisor: their number (p).
    pub deviation: Vec<f64>,
    /// Least squares, on all rows, on the columns with an inclusion probability of at least the wanted one, and the fixed ones.
    pub model: Step,
}

/// Ensemble SINDy (Fasel, Kutz, Brunton and Brunton 2022): models of every target on every replicate of the rows, and on random parts of the library.
///
/// `replicates` are the problem with its rows, chunks or episodes reweighted, from the same statistics; where there are none, all models are made on
/// `problem`, and differ by the candidates that they are offered. `terms` has one entry a target. Which candidates a model is offered follows from
/// the seed, its number and the column alone; the bits do not depend on the number of threads.
///
/// # Errors
/// As [`optimize`], and when shapes disagree, nothing would be left in, an option is out of its range, or the user stops it.
pub fn ensemble(
    problem: &Compressed,
    replicates: &[Compressed],
    terms: &[Terms],
    optimizer: &Optimizer,
    options: &EnsembleOptions,
    progress: &dyn Progress,
) -> Result<Vec<Ensemble>, ThresholdError> {
    share("the probability that a term needs", options.probability)?;
    let targets = problem.targets();
    check_terms(terms, targets)?;
    for (index, replicate) in replicates.iter().enumerate() {
        same_shape("replicate", index, replicate, problem)?;
    }
    if options.draws == 0 {
        return Err(ThresholdError::NotPositive { name: "the number of models a replicate", value: 0.0 });
    }
    let models = replicates.len().max(1) * options.draws;
    progress.stage("models of the ensemble");
    let models_of_members = parallel_map(models * targets, progress, |at| {
        let (target, model) = (at / models, at % models);
        let rows = replicates.get(model / options.draws).unwrap_or(problem);
        let offered = offer(problem, &terms[target], options, model)?;
        let trail = optimize(rows, target, optimizer, &offered)?;
        let step = &trail.steps[trail.chosen];
        let coefficients = step.support.iter().map(|&j| (j, step.coefficients[j])).collect();
        Ok::<_, ThresholdError>(Model { offered, coefficients })
    })?;
    let all = models_of_members.chunks(models).enumerate();
    all.map(|(target, members)| summary(problem, target, &terms[target], members, options)).collect()
}

/// One model of the ensemble.
struct Model {
    offered: Terms,
    /// Its terms.
    coefficients: Vec<(usize, f64)>,
}

/// The terms that a model may use: all but `leave_out` of the candidates, those with the smallest hashes.
fn offer(
    problem: &Compressed,
    terms: &Terms,
    options: &EnsembleOptions,
    model: usize,
) -> Result<Terms, ThresholdError> {
    if options.leave_out == 0 {
        return Ok(terms.clone());
    }
    let checked = terms.checked(problem)?;
    let key = mix(mix(options.seed).wrapping_add(model as u64));
    let free = checked.open.iter().copied().filter(|&j| !checked.fixed[j]);
    let mut drawn: Vec<(u64, usize)> = free.map(|j| (mix(key.wrapping_add(j as u64)), j)).collect();
    if options.leave_out >= drawn.len() {
        return Err(ThresholdError::Dropped { dropped: options.leave_out, candidates: drawn.len() });
    }
    drawn.sort_unstable();
    let mut allowed = vec![false; problem.columns()];
    checked.open.iter().for_each(|&j| allowed[j] = true);
    drawn[..options.leave_out].iter().for_each(|&(_, j)| allowed[j] = false);
    Ok(Terms { allowed: Some(allowed), ..terms.clone() })
}

fn summary(
    problem: &Compressed,
    target: usize,
    terms: &Terms,
    models: &[Model],
    options: &EnsembleOptions,
) -> Result<Ensemble, ThresholdError> {
    let p = problem.columns();
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); p];
    let mut selected = vec![0_usize; p];
    for model in models {
        for (j, values) in values.iter_mut().enumerate() {
            if model.offered.allowed.as_ref().is_none_or(|allowed| allowed[j]) {
                values.push(0.0);
            }
        }
        for &(j, value) in &model.coefficients {
            selected[j] += 1;
            if let Some(last) = values[j].last_mut() {
                *last = value;
            }
        }
    }
    let offered: Vec<usize> = values.iter().map(Vec::len).collect();
    let inclusion: Vec<f64> = selected.iter().zip(&offered).map(|(&k, &n)| k as f64 / n.max(1) as f64).collect();
    let mean: Vec<f64> = values.iter().map(|values| values.iter().sum::<f64>() / values.len().max(1) as f64).collect();
    let spread = |(values, mean): (&Vec<f64>, &f64)| {
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        (squares / values.len().max(1) as f64).sqrt()
    };
    let deviation = values.iter().zip(&mean).map(spread).collect();
    let median = values.iter_mut().map(|values| median(values)).collect();
    let prepared = Prepared::new(problem, terms, Scaling::Physical, 0.0)?;
    let enough = |j: usize| offered[j] > 0 && selected[j] > 0 && inclusion[j] >= options.probability;
    let support: Vec<usize> = prepared.open.iter().copied().filter(|&j| prepared.fixed[j] || enough(j)).collect();
    let solved = prepared.refit(&support, target);
    let model = Step { parameter: options.probability, ..prepared.step(target, support, solved, false) };
    Ok(Ensemble { offered, inclusion, mean, median, deviation, model })
}

/// The middle value, or the mean of the two; 0 of none.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

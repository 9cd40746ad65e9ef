//! The choice of lambda.

use fleetfoot_data::Progress;
use fleetfoot_sparse::{
    CriteriaOptions, CrossValidation, Folds, Lambdas, LarsOptions, RandomSplits, SelectError, SelectOptions,
    bach_lambda, cross_validate, effective_rows, lambda_max, lars, task_criteria,
};

use super::{Criterion, FoldRule, LambdaRule, SparseOptions, problem::Problem};
use crate::Error;

/// Chunks beside held-out ones of the same episode that do not train.
const PURGE: u32 = 1;

/// Lambdas that are compared, and the least of them over the largest. Equations of physics may be nearly exact, and a strong prior makes the largest one
/// large: so the least is smaller than usual.
const LAMBDAS: usize = 161;
const LEAST_LAMBDA: f64 = 1e-8;

/// Lambda, and where it comes from.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct LambdaChoice {
    /// Lambda, in the objective of `fleetfoot_sparse`.
    pub value: f64,
    /// How it was chosen, for people.
    pub how: String,
    /// The smallest lambda at which every penalised coefficient is zero.
    pub largest: f64,
    /// Number of folds of the held-out errors; 0 where there are none.
    pub folds: usize,
    /// The held-out errors, where there are folds.
    pub validation: Option<CrossValidation>,
    /// Index of lambda in them.
    pub index: usize,
}

impl LambdaChoice {
    /// Mean over the folds of the held-out squared error of every measured task, in the units of its target squared.
    pub fn held_out(&self) -> Option<Vec<f64>> {
        let validation = self.validation.as_ref()?;
        let rows: f64 = validation.rows.iter().sum();
        let mean = |task: usize| {
            let errors =
                validation.rows.iter().enumerate().map(|(fold, n)| n * validation.tasks[task][(self.index, fold)]);
            errors.sum::<f64>() / rows
        };
        Some((0..validation.tasks.len()).map(mean).collect())
    }
}

/// Chooses lambda; held-out errors come with it where there are folds. Notes say what could not be done.
pub(super) fn choose(
    problem: &Problem<'_>,
    options: &SparseOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<LambdaChoice, Error> {
    let largest = lambda_max(&problem.assembled.problem, &problem.assembled.penalty, options.l1_ratio.max(1e-3))?;
    let (value, how) = match options.lambda {
        LambdaRule::Value(value) => (value, "given".to_owned()),
        LambdaRule::OverRoot(value) => {
            (bach_lambda(value, problem.rows()), format!("{value}/sqrt(n), n = {}", problem.rows()))
        }
        LambdaRule::Auto => match options.criterion {
            Criterion::CrossValidation | Criterion::OneStandardError => {
                return validated(problem, options, largest, notes, progress);
            }
            criterion => by_criterion(problem, options, criterion)?,
        },
    };
    let mut choice = LambdaChoice { value, how, largest, folds: 0, validation: None, index: 0 };
    progress.stage("folds");
    match validate(problem, options, Lambdas::List(vec![value]), progress) {
        Ok((folds, validation)) => {
            choice.folds = folds;
            choice.validation = Some(validation);
        }
        Err(Error::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(error) => notes.push(format!("no held-out errors: {error}")),
    }
    Ok(choice)
}

/// By cross-validation.
fn validated(
    problem: &Problem<'_>,
    options: &SparseOptions,
    largest: f64,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<LambdaChoice, Error> {
    progress.stage("folds");
    let grid = Lambdas::Grid { count: LAMBDAS, ratio: LEAST_LAMBDA };
    let (folds, validation) = validate(problem, options, grid, progress).map_err(|error| match error {
        Error::Cancelled(cancelled) => Error::Cancelled(cancelled),
        other => Error::Request(format!(
            "lambda cannot be chosen by cross-validation: {other}; give `--lambda`, choose by `--select bic`, or give more data"
        )),
    })?;
    let (index, rule) = match options.criterion {
        Criterion::CrossValidation => (validation.best, "least held-out error"),
        _ => (validation.one_standard_error, "one standard error from the least held-out error"),
    };
    if validation.best + 1 == validation.lambdas.len() {
        notes.push(
            "the least held-out error is at the smallest lambda that was tried: less penalty may be better still, give `--lambda`".into(),
        );
    }
    if !validation.inexact.is_empty() {
        notes.push(format!("at {} lambdas of the folds a solver did not meet its tolerance", validation.inexact.len()));
    }
    let how = format!("{rule}, {}", folds_in_words(options.folds, folds));
    Ok(LambdaChoice { value: validation.lambdas[index], how, largest, folds, validation: Some(validation), index })
}

fn folds_in_words(rule: FoldRule, count: usize) -> String {
    match rule {
        FoldRule::Count(_) => format!("{count} folds"),
        FoldRule::Episodes => format!("every one of {count} episodes left out once"),
        FoldRule::Splits(_) => format!("{count} random splits with a third held out"),
    }
}

/// Held-out errors at some lambdas.
fn validate(
    problem: &Problem<'_>,
    options: &SparseOptions,
    lambdas: Lambdas,
    progress: &dyn Progress,
) -> Result<(usize, CrossValidation), Error> {
    let (keys, rows) = (problem.banks.keys(), problem.banks.rows());
    let folds = match options.folds {
        // Fewer chunks than folds: as many folds as there are chunks.
        FoldRule::Count(k) => Folds::k_fold(keys, rows, k.min(keys.len()), PURGE)?,
        FoldRule::Episodes => Folds::leave_one_episode_out(keys)?,
        FoldRule::Splits(repeats) => {
            let splits = RandomSplits { repeats, seed: options.seed, purge: PURGE, ..RandomSplits::default() };
            Folds::random_splits(keys, rows, &splits)?
        }
    };
    let select = SelectOptions { lambdas, l1_ratio: options.l1_ratio, ..SelectOptions::default() };
    let found = cross_validate(&problem.structure, &problem.banks, &problem.assembly, &folds, &select, progress);
    match found {
        Ok(found) => Ok((folds.len(), found)),
        Err(SelectError::Cancelled(cancelled)) => Err(cancelled.into()),
        Err(error) => Err(error.into()),
    }
}

/// By an information criterion at the knots of the path.
fn by_criterion(problem: &Problem<'_>, options: &SparseOptions, criterion: Criterion) -> Result<(f64, String), Error> {
    if options.l1_ratio < 1.0 {
        return Err(Error::Request(
            "information criteria compare the knots of the lasso's path, and an elastic net has none; use `--select cv`, or leave --l1-ratio away".into(),
        ));
    }
    let assembled = &problem.assembled;
    let path = lars(&assembled.problem, &assembled.penalty, &LarsOptions::default())?;
    let theta = path.knots.last().map_or_else(|| vec![0.0; assembled.scale.len()], |knot| assembled.coefficients(knot));
    let measured = problem.structure.tasks.iter().filter(|task| !task.prior).count() as f64;
    let independent = effective_rows(&problem.structure, &problem.banks, &theta)?;
    let criteria = CriteriaOptions { observations: Some(independent * measured), ..CriteriaOptions::default() };
    let found = task_criteria(&problem.structure, &problem.roots, &problem.assembly, assembled, &path, &criteria)?;
    let (best, name) = match criterion {
        Criterion::Aic => (found.best[0], "AIC"),
        Criterion::Ebic => (found.best[2], "EBIC"),
        _ => (found.best[1], "BIC"),
    };
    Ok((found.lambdas[best], format!("least {name}, {independent:.0} rows count as independent")))
}

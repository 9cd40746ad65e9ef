//! The choice of lambda.

use fleetfoot_data::Progress;
use fleetfoot_data::setting::{L1_RATIO, LAMBDA, SELECT};
use fleetfoot_recipe::Criterion;
use fleetfoot_sparse::{
    SparseError,
    bolasso::{bach_lambda, refit},
    estimator::{ElasticNet, Estimator, Stop},
    select::{
        CriteriaOptions, CrossValidation, Folds, Lambdas, SelectError, SelectOptions, cross_validate, effective_rows,
        task_criteria,
    },
};
use fleetfoot_stats::FoldError;

use super::{LambdaRule, SparseOptions, problem::Problem};
use crate::{
    error::Error,
    folds::{FoldRule, purge, reached},
};

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
    /// Criterion of the choice, for people.
    pub how: String,
    /// The smallest lambda at which every penalised coefficient is zero.
    pub largest: f64,
    /// Number of folds of the held-out errors; 0 where there are none.
    pub folds: usize,
    /// Rule by which rows were held out, for people; `None` without folds.
    pub fold_rule: Option<String>,
    /// The held-out errors of the penalised fits at every lambda that was compared, where there are folds.
    pub validation: Option<CrossValidation>,
}

/// The folds of a statistic of logs that were smoothed over so many rows. `None`, with a note, if there are none by
/// default.
pub(super) fn folds(
    problem: &Problem<'_>,
    options: &SparseOptions,
    smoothed: usize,
    notes: &mut Vec<String>,
) -> Result<Option<Folds>, Error> {
    let (keys, rows) = (problem.banks.keys(), problem.banks.rows());
    let validates = matches!(options.criterion, Criterion::CrossValidation | Criterion::OneStandardError);
    let shared = reached(problem.task.regression.expressions()) + smoothed;
    match options.folds.folds(keys, rows, options.seed, purge(shared, correlated(problem))) {
        Ok(folds) => Ok(Some(folds)),
        Err(error) if options.folds == FoldRule::Auto && !(options.lambda == LambdaRule::Auto && validates) => {
            notes.push(format!("no held-out errors: {error}"));
            Ok(None)
        }
        Err(error) => {
            let few = matches!(
                error,
                SelectError::EmptyFold { .. } | SelectError::TooFew { .. } | SelectError::Folds(FoldError::Rows { .. })
            );
            let message = format!(
                "{error}; without folds lambda can be given ({LAMBDA}), or chosen by {given_select}",
                given_select = SELECT.to("bic")
            );
            let rows = problem.rows() as u64;
            Err(if few { Error::too_few_rows(rows, rows + 1, message) } else { Error::undetermined(message) })
        }
    }
}

/// Rows over which the residuals of least squares on all columns are correlated; `None` if unknown.
fn correlated(problem: &Problem<'_>) -> Option<f64> {
    let all: Vec<usize> = (0..problem.structure.coefficients()).collect();
    let theta = refit(&problem.structure, &problem.roots, &problem.assembly, &all).ok()?;
    let independent = effective_rows(&problem.structure, &problem.banks, &theta).ok()?;
    Some(problem.rows() / independent)
}

/// Chooses lambda; held-out errors come with it if there are folds. Notes name the steps that could not be done.
pub(super) fn choose(
    problem: &Problem<'_>,
    options: &SparseOptions,
    folds: Option<&Folds>,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<LambdaChoice, Error> {
    let largest = largest(problem)?;
    let (value, how) = match options.lambda {
        LambdaRule::Value(value) => (value, "given".to_owned()),
        LambdaRule::OverRoot(value) => {
            (bach_lambda(value, problem.rows()), format!("{value}/sqrt(n), n = {}", problem.rows()))
        }
        LambdaRule::Auto => match options.criterion {
            Criterion::CrossValidation | Criterion::OneStandardError => {
                return match folds {
                    Some(folds) => validated(problem, options, folds, largest, notes, progress),
                    None => Err(SelectError::FoldCount { count: 0 }.into()),
                };
            }
            criterion => by_criterion(problem, options, criterion)?,
        },
    };
    let validation = folds.map(|folds| validate(problem, folds, Lambdas::List(vec![value]), progress));
    Ok(LambdaChoice { validation: validation.transpose()?, ..LambdaChoice::new(value, how, largest, folds) })
}

/// The smallest lambda at which every penalised coefficient is zero. Of an elastic net that is almost a ridge: that of
/// the net with the least share that has one.
fn largest(problem: &Problem<'_>) -> Result<f64, Error> {
    let (quadratic, penalty) = (&problem.assembled.problem, &problem.assembled.penalty);
    Ok(match problem.estimator.lambda_max(quadratic, penalty) {
        Err(SparseError::NoLambdaMax { .. }) => {
            Estimator::from(ElasticNet::new(1e-3)).lambda_max(quadratic, penalty)?
        }
        other => other?,
    })
}

impl LambdaChoice {
    fn new(value: f64, how: String, largest: f64, folds: Option<&Folds>) -> Self {
        let (count, fold_rule) = (folds.map_or(0, Folds::len), folds.map(|folds| folds.rule().to_owned()));
        Self { value, how, largest, folds: count, fold_rule, validation: None }
    }
}

/// By cross-validation.
fn validated(
    problem: &Problem<'_>,
    options: &SparseOptions,
    folds: &Folds,
    largest: f64,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<LambdaChoice, Error> {
    let grid = Lambdas::Grid { count: LAMBDAS, ratio: LEAST_LAMBDA };
    let validation = validate(problem, folds, grid, progress)?;
    let (index, rule) = match options.criterion {
        Criterion::CrossValidation => (validation.best, "least held-out error"),
        _ => (validation.one_standard_error, "one standard error from the least held-out error"),
    };
    if validation.best + 1 == validation.lambdas.len() {
        notes.push(
            format!("the least held-out error is at the smallest lambda that was tried: less penalty may be better still, give {LAMBDA}"),
        );
    }
    if !validation.inexact.is_empty() {
        notes.push(format!("at {} lambdas of the folds a solver did not meet its tolerance", validation.inexact.len()));
    }
    let (value, how) = (validation.lambdas[index], format!("{rule}, {}", folds.rule()));
    Ok(LambdaChoice { validation: Some(validation), ..LambdaChoice::new(value, how, largest, Some(folds)) })
}

/// Held-out errors at some lambdas.
fn validate(
    problem: &Problem<'_>,
    folds: &Folds,
    lambdas: Lambdas,
    progress: &dyn Progress,
) -> Result<CrossValidation, Error> {
    progress.stage("folds");
    let select = SelectOptions { lambdas, estimator: problem.estimator.clone() };
    let validation = cross_validate(&problem.structure, &problem.banks, &problem.assembly, folds, &select, progress);
    validation.map_err(|error| match error {
        SelectError::Cancelled(cancelled) => cancelled.into(),
        error => Error::undetermined(format!(
            "held-out errors: {error}; lambda can be given ({LAMBDA}), or chosen by {given_select}",
            given_select = SELECT.to("bic")
        )),
    })
}

/// By an information criterion at the knots of the path.
fn by_criterion(problem: &Problem<'_>, options: &SparseOptions, criterion: Criterion) -> Result<(f64, String), Error> {
    if options.l1_ratio < 1.0 && options.groups.is_none() {
        return Err(Error::conflict(format!(
            "information criteria compare the knots of the lasso's path, and an elastic net has none; use {given_select}, or remove {L1_RATIO}",
            given_select = SELECT.to("cv")
        )));
    }
    let assembled = &problem.assembled;
    let path = problem.estimator.path(&assembled.problem, &assembled.penalty, &Stop::default())?;
    let theta = path.knots.last().map_or_else(|| vec![0.0; assembled.scale.len()], |knot| assembled.coefficients(knot));
    let measured = problem.structure.tasks.iter().filter(|task| !task.prior).count() as f64;
    let independent = effective_rows(&problem.structure, &problem.banks, &theta)?;
    let criteria = CriteriaOptions { observations: Some(independent * measured), ..CriteriaOptions::default() };
    let task_criteria =
        task_criteria(&problem.structure, &problem.roots, &problem.assembly, assembled, &path, &criteria)?;
    let (best, name) = match criterion {
        Criterion::Aic => (task_criteria.best[0], "AIC"),
        Criterion::Ebic => (task_criteria.best[2], "EBIC"),
        _ => (task_criteria.best[1], "BIC"),
    };
    Ok((task_criteria.lambdas[best], format!("least {name}, {independent:.0} rows count as independent")))
}

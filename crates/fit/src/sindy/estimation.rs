//! Parameters inside expressions, by separable least squares: their coefficients are those of all candidates.

use fleetfoot_data::{Progress, Source};
use fleetfoot_estimate::{
    Estimate, LinearTarget, Options, Residual, SeparableOptions, nonlinear_least_squares, separable,
};
use fleetfoot_library::Expr;
use fleetfoot_task::{EquationTask, FittedEquation, Parameter, names};
use serde::Serialize;

use crate::error::Error;

/// An estimated number.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ParameterReport {
    /// Its name.
    pub name: String,
    /// The estimate.
    pub value: f64,
    /// Its standard error; NaN if it is not known.
    pub standard_error: f64,
    /// Its unit, when known.
    pub unit: Option<String>,
    /// True if the estimate is at one of its bounds.
    pub at_bound: bool,
}

/// Points between bounds that are tried beside the initial values: sums of squares over a lag or a delay have several minima.
const STARTS: usize = 12;
const DESCENTS: usize = 2;
/// Chunks of rows that the standard errors take for independent, about.
const CHUNKS: usize = 64;

/// Estimates the parameters of a task on its candidates, before any is dropped.
///
/// Equations share their parameters. With several, each counts by its own mean squared error, from a first fit in which each counts by the units of its target.
///
/// # Errors
/// Those of reading and of the estimate.
pub(super) fn estimate(
    task: &EquationTask,
    source: &dyn Source,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Vec<ParameterReport>, Error> {
    let parameters: Vec<fleetfoot_estimate::Parameter> = task
        .parameters
        .iter()
        .map(|parameter| {
            let [least, most] = parameter.bounds;
            fleetfoot_estimate::Parameter::new(&parameter.name, parameter.initial).between(least, most)
        })
        .collect();
    let bounded = task.parameters.iter().any(|parameter| parameter.bounds.iter().all(|bound| bound.is_finite()));
    let options =
        SeparableOptions { starts: if bounded { STARTS } else { 0 }, descents: DESCENTS, iteration: iteration(source) };
    if task.fitted.iter().any(|equation| has_parameter(task, [&equation.target].into_iter())) {
        return joint(task, parameters, source, notes, progress);
    }
    let targets = targets(task);
    let mut estimate = separable(&targets, &parameters, source, &options, progress)?;
    if targets.len() > 1 {
        let weight = |at: usize| estimate.targets.get(at).map_or(1.0, |fit| fit.rms.powi(-2));
        let weights: Vec<f64> = (0..targets.len()).map(weight).collect();
        if weights.iter().all(|weight| weight.is_finite()) {
            let again: Vec<LinearTarget> =
                targets.into_iter().zip(weights).map(|(target, weight)| target.weighted(weight)).collect();
            let near: Vec<fleetfoot_estimate::Parameter> = parameters
                .iter()
                .zip(&estimate.estimate.values)
                .map(|(parameter, &value)| fleetfoot_estimate::Parameter { initial: value, ..parameter.clone() })
                .collect();
            let options = SeparableOptions { iteration: options.iteration, ..SeparableOptions::default() };
            estimate = separable(&again, &near, source, &options, progress)?;
        }
    }
    Ok(reports(task, &estimate.estimate, notes))
}

/// Parameters in nominal parts or measured sides: all coefficients are parameters too, beginning at 0.
fn joint(
    task: &EquationTask,
    mut parameters: Vec<fleetfoot_estimate::Parameter>,
    source: &dyn Source,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Vec<ParameterReport>, Error> {
    let mut residuals = Vec::new();
    for target in targets(task) {
        let mut model = -&target.target;
        for (j, function) in target.functions.iter().enumerate() {
            let coefficient = format!("coefficient {j} of {}", target.name);
            model = model + Expr::column(coefficient.as_str()) * function;
            parameters.push(fleetfoot_estimate::Parameter::new(coefficient, 0.0));
        }
        residuals.push(Residual { name: target.name, target: Expr::number(0.0), model, weight: 1.0 });
    }
    let minimum = nonlinear_least_squares(&residuals, &parameters, source, &iteration(source), progress)?;
    Ok(reports(task, &minimum, notes))
}

/// The equations whose functions or targets have a parameter.
fn targets(task: &EquationTask) -> Vec<LinearTarget> {
    let root = task.weight.as_ref().map(Expr::sqrt);
    let weighted = |expression: &Expr| match &root {
        None => expression.clone(),
        Some(root) => (root * expression).simplified(),
    };
    let first = usize::from(task.constant);
    let of = |equation: &FittedEquation| {
        let allowed = (0..task.candidates()).filter(|&j| equation.allowed[j]);
        let one = Expr::number(1.0);
        let functions: Vec<&Expr> =
            allowed.map(|j| if j < first { &one } else { &task.functions[j - first] }).collect();
        has_parameter(task, functions.iter().copied().chain([&equation.target])).then(|| LinearTarget {
            name: equation.label.clone(),
            target: weighted(&equation.target),
            functions: functions.into_iter().map(weighted).collect(),
            weight: 1.0,
        })
    };
    task.fitted.iter().filter_map(of).collect()
}

fn has_parameter<'a>(task: &EquationTask, expressions: impl Iterator<Item = &'a Expr>) -> bool {
    let names = names(expressions);
    task.parameters.iter().any(|parameter| names.contains(&parameter.name))
}

/// The iteration, with chunks short enough that the standard errors have some tens of them.
fn iteration(source: &dyn Source) -> Options {
    Options { chunk_rows: (source.rows() / CHUNKS).clamp(256, 65_536), ..Options::default() }
}

fn reports(task: &EquationTask, estimate: &Estimate, notes: &mut Vec<String>) -> Vec<ParameterReport> {
    if !estimate.status.converged() {
        notes.push(format!("the parameters did not converge in {} steps", estimate.iterations));
    }
    let errors = estimate.clustered_errors().unwrap_or_else(|| estimate.standard_errors());
    let report = |(j, parameter): (usize, &Parameter)| {
        if estimate.undetermined.contains(&j) {
            notes.push(format!("the rows do not determine `{}`", parameter.name));
        }
        ParameterReport {
            name: parameter.name.clone(),
            value: estimate.values[j],
            standard_error: errors[j],
            unit: parameter.unit.clone(),
            at_bound: estimate.at_bounds.contains(&j),
        }
    };
    task.parameters.iter().enumerate().map(report).collect()
}

//! Residuals and parameters, checked; exact derivatives.

use std::collections::{HashMap, HashSet};

use fleetfoot_data::Source;
use fleetfoot_library::{Expr, Node};

use crate::EstimateError;

/// One equation: `target - model` should be small at every row.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// What it is called in messages.
    pub name: String,
    /// What is measured: an expression over columns.
    pub target: Expr,
    /// What should equal it: an expression over columns and parameters.
    pub model: Expr,
    /// Weight of its squares, usually 1 over the variance of its error.
    pub weight: f64,
}

impl Residual {
    /// Of weight 1, named after its target.
    pub fn new(target: Expr, model: Expr) -> Self {
        Self { name: target.to_string(), target, model, weight: 1.0 }
    }

    /// The same with another weight.
    pub fn weighted(self, weight: f64) -> Self {
        Self { weight, ..self }
    }
}

/// A number to be estimated; models use it by its name, like a column.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name: not that of a column.
    pub name: String,
    /// Where the iteration begins.
    pub initial: f64,
    /// Least and greatest value; infinite ends are open, equal ends fix it.
    pub bounds: [f64; 2],
}

impl Parameter {
    /// Without bounds.
    pub fn new(name: impl Into<String>, initial: f64) -> Self {
        Self { name: name.into(), initial, bounds: [f64::NEG_INFINITY, f64::INFINITY] }
    }

    /// The same with bounds.
    pub fn between(self, low: f64, high: f64) -> Self {
        Self { bounds: [low, high], ..self }
    }
}

/// A residual times the root of its weight, and its derivatives.
#[derive(Debug, Clone)]
pub(crate) struct Task {
    /// `sqrt(weight) target`.
    pub(crate) target: Expr,
    /// `sqrt(weight) (target - model)`.
    pub(crate) value: Expr,
    /// Index of every parameter that it depends on, and its derivative with respect to that.
    pub(crate) slopes: Vec<(usize, Expr)>,
}

/// What is minimised.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub(crate) tasks: Vec<Task>,
    /// Columns, with their lags, that the residuals read.
    pub(crate) leaves: Vec<Expr>,
    pub(crate) names: Vec<String>,
    pub(crate) bounds: Vec<[f64; 2]>,
}

impl Problem {
    pub(crate) fn new(
        residuals: &[Residual],
        parameters: &[Parameter],
        source: &dyn Source,
    ) -> Result<Self, EstimateError> {
        check_parameters(parameters, source)?;
        if let Some(bad) = residuals.iter().find(|residual| !(residual.weight >= 0.0 && residual.weight.is_finite())) {
            return Err(EstimateError::Weight { residual: bad.name.clone(), weight: bad.weight });
        }
        let index: HashMap<&str, usize> =
            parameters.iter().enumerate().map(|(j, parameter)| (parameter.name.as_str(), j)).collect();
        let (mut leaves, mut tasks, mut used) = (Vec::new(), Vec::new(), HashSet::new());
        for residual in residuals.iter().filter(|residual| residual.weight > 0.0) {
            let difference = residual.target.clone() - &residual.model;
            for leaf in columns_of(&difference) {
                let Node::Column { name, lag } = leaf.node() else { continue };
                match index.get(&**name) {
                    Some(_) if *lag != 0 => {
                        let name = name.to_string();
                        return Err(EstimateError::Lagged { residual: residual.name.clone(), name });
                    }
                    Some(&j) => _ = used.insert(j),
                    None if leaves.contains(&leaf) => {}
                    None => leaves.push(leaf),
                }
            }
            let weighted = |expr: Expr| (Expr::number(residual.weight.sqrt()) * expr).simplified();
            let (target, value) = (weighted(residual.target.clone()), weighted(difference));
            let slope = |(j, parameter): (usize, &Parameter)| {
                let slope = value.derivative(&parameter.name);
                (slope.as_number() != Some(0.0)).then_some((j, slope))
            };
            let slopes = parameters.iter().enumerate().filter_map(slope).collect();
            tasks.push(Task { target, value, slopes });
        }
        if let Some((_, parameter)) = parameters.iter().enumerate().find(|(j, _)| !used.contains(j)) {
            return Err(EstimateError::Unused { name: parameter.name.clone() });
        }
        Ok(Self {
            tasks,
            leaves,
            names: parameters.iter().map(|parameter| parameter.name.clone()).collect(),
            bounds: parameters.iter().map(|parameter| parameter.bounds).collect(),
        })
    }

    /// The expression with numbers in place of the parameters.
    pub(crate) fn at(&self, expr: &Expr, theta: &[f64]) -> Expr {
        substitute(&self.names, expr, theta)
    }
}

/// `expr` with numbers in place of the named parameters.
pub(crate) fn substitute(names: &[String], expr: &Expr, theta: &[f64]) -> Expr {
    expr.substituted(|name| names.iter().position(|known| known == name).map(|j| Expr::number(theta[j])))
}

fn check_parameters(parameters: &[Parameter], source: &dyn Source) -> Result<(), EstimateError> {
    if parameters.is_empty() {
        return Err(EstimateError::NoParameters);
    }
    let mut names = HashSet::new();
    for Parameter { name, initial, bounds: [low, high] } in parameters {
        let name = name.clone();
        if source.column_index(&name).is_some() {
            return Err(EstimateError::NameTaken { name, by: "a column" });
        }
        if !names.insert(name.clone()) {
            return Err(EstimateError::NameTaken { name, by: "another parameter" });
        }
        if !(initial.is_finite() && low <= initial && initial <= high) {
            return Err(EstimateError::Initial { name, initial: *initial, low: *low, high: *high });
        }
    }
    Ok(())
}

/// Every column of an expression with its lag, once.
fn columns_of(expr: &Expr) -> Vec<Expr> {
    let (mut columns, mut seen) = (Vec::new(), HashSet::new());
    expr.fold(|part, _: &[()]| {
        if matches!(part.node(), Node::Column { .. }) && seen.insert(part.clone()) {
            columns.push(part.clone());
        }
    });
    columns
}

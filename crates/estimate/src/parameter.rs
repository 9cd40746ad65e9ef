//! Numbers that are estimated, by their names in expressions.

use std::collections::HashSet;

use fleetfoot_data::Source;
use fleetfoot_library::Expr;

use crate::EstimateError;

/// A number to be estimated; models use it by its name, like a column.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name: not that of a column.
    pub name: String,
    /// Starting value of the iteration.
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

/// `expr` with numbers in place of the named parameters.
pub(crate) fn substitute(names: &[String], expr: &Expr, theta: &[f64]) -> Expr {
    expr.substituted(|name| names.iter().position(|known| known == name).map(|j| Expr::number(theta[j])))
}

pub(crate) fn check_parameters(parameters: &[Parameter], source: &dyn Source) -> Result<(), EstimateError> {
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

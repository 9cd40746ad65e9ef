//! Parameters and columns that expressions read; the columns decide if a row is complete.

use std::collections::HashSet;

use fleetfoot_data::Source;
use fleetfoot_library::{Expr, Filter, FilterKind, Node};

use crate::{EstimateError, Parameter};

/// Collects the parameters and columns that the expressions of a problem read.
///
/// A filter with parameters counts by its inputs, since the rows of a problem do not depend on its parameters. A lag
/// needs its input; a delay needs its input for as long as the delay may last within the bounds.
pub(crate) struct Reads<'a> {
    parameters: &'a [Parameter],
    source: &'a dyn Source,
    used: HashSet<String>,
    presence: Vec<Expr>,
}

impl<'a> Reads<'a> {
    pub(crate) fn new(parameters: &'a [Parameter], source: &'a dyn Source) -> Self {
        Self { parameters, source, used: HashSet::new(), presence: Vec::new() }
    }

    /// Adds an expression of the residual of this name.
    pub(crate) fn add(&mut self, residual: &str, expr: &Expr) -> Result<(), EstimateError> {
        for leaf in self.leaves(residual, expr)? {
            if !self.presence.contains(&leaf) {
                self.presence.push(leaf);
            }
        }
        Ok(())
    }

    /// Expressions that must be finite at a row of the problem.
    ///
    /// # Errors
    /// A parameter that nothing reads.
    pub(crate) fn presence(self) -> Result<Vec<Expr>, EstimateError> {
        match self.parameters.iter().find(|parameter| !self.used.contains(&parameter.name)) {
            Some(parameter) => Err(EstimateError::Unused { name: parameter.name.clone() }),
            None => Ok(self.presence),
        }
    }

    fn leaves(&mut self, residual: &str, expr: &Expr) -> Result<Vec<Expr>, EstimateError> {
        let mut leaves = Vec::new();
        for column in columns_of(expr) {
            let Node::Column { name, lag } = column.node() else { continue };
            if self.parameters.iter().any(|parameter| parameter.name == **name) {
                if *lag != 0 {
                    let (residual, name) = (residual.to_owned(), name.to_string());
                    return Err(EstimateError::Lagged { residual, name });
                }
                self.used.insert(name.to_string());
                continue;
            }
            match Filter::of(name).filter(|filter| self.source.column_index(name).is_none() && self.varies(filter)) {
                Some(filter) => {
                    leaves.extend(self.beneath(residual, &filter)?.into_iter().map(|leaf| leaf.shifted(*lag)));
                }
                None => leaves.push(column),
            }
        }
        Ok(leaves)
    }

    /// Returns true if a filter has a parameter.
    fn varies(&self, filter: &Filter) -> bool {
        filter.sources().iter().any(|name| self.parameters.iter().any(|parameter| parameter.name == **name))
    }

    fn beneath(&mut self, residual: &str, filter: &Filter) -> Result<Vec<Expr>, EstimateError> {
        let inputs = self.leaves(residual, &filter.input)?;
        self.leaves(residual, &filter.constant)?;
        match filter.kind {
            FilterKind::Lag1 | FilterKind::Lag1Slope => Ok(inputs),
            _ => {
                let longest = self.longest(filter)?;
                let present = |leaf| Filter::new(FilterKind::Present, leaf, longest).column();
                Ok(inputs.into_iter().map(present).collect())
            }
        }
    }

    /// The greatest value of a delay's constant at the corners of the bounds.
    fn longest(&self, filter: &Filter) -> Result<f64, EstimateError> {
        let names = filter.constant.columns();
        let bounds = |name: &str| self.parameters.iter().find(|parameter| parameter.name == name).map(|p| p.bounds);
        let corners = 1_u32.checked_shl(names.len() as u32).unwrap_or(0);
        let at = |corner: u32| {
            let end = |name: &str| {
                let place = names.iter().position(|known| **known == *name).unwrap_or(0);
                bounds(name).map_or(f64::NAN, |ends| ends[(corner >> place & 1) as usize])
            };
            filter.constant.value(|name, _| end(name), |_| f64::NAN)
        };
        let longest =
            (0..corners).map(at).fold(0.0, |most: f64, value| if value.is_nan() { value } else { most.max(value) });
        if longest.is_finite() { Ok(longest) } else { Err(EstimateError::Delay { filter: filter.to_string() }) }
    }
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

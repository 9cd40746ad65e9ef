//! A recipe resolved to given equations alone.

use fleetfoot_data::Column as DataColumn;
use fleetfoot_library::Expr;
use fleetfoot_model::{Column, Equation, Prediction};
use fleetfoot_recipe::{Aliases, Error, Recipe};

use crate::task::state_equation;

/// Given equations alone, and their columns.
#[derive(Debug, Clone, Default)]
pub struct KnownTask {
    /// The model's columns.
    pub columns: Vec<Column>,
    /// The columns of the view, and the expressions over the recording's fields that give them.
    pub aliases: Vec<(DataColumn, Expr)>,
    /// The equations.
    pub equations: Vec<Equation>,
}

impl KnownTask {
    /// Resolves a recipe in which every state is given.
    pub fn resolve(recipe: &Recipe, fields: &[DataColumn]) -> Result<Self, Error> {
        Self::over(recipe, Aliases::of_recipe(recipe, fields)?)
    }

    /// The equations over the columns of the aliases.
    pub(crate) fn over(recipe: &Recipe, mut aliases: Aliases<'_>) -> Result<Self, Error> {
        let mut equations = Vec::new();
        for (name, state) in &recipe.states {
            equations.push(state_equation(name, state, Prediction::Derivative, None, &mut aliases)?);
        }
        Ok(Self { columns: aliases.columns, aliases: aliases.expressions, equations })
    }
}

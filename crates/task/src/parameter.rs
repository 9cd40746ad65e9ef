//! Numbers inside expressions that are not known.

use std::collections::BTreeSet;

use fleetfoot_data::setting::PARAMETERS;
use fleetfoot_library::Expr;
use fleetfoot_recipe::{Aliases, Error, Recipe};

/// A number that is to be estimated.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Parameter {
    /// Its name in expressions.
    pub name: String,
    /// Starting value of the search.
    pub initial: f64,
    /// Least and greatest value; infinite where there is none.
    pub bounds: [f64; 2],
    /// Unit, when known.
    pub unit: Option<String>,
    /// True if it keeps its value.
    pub fixed: bool,
}

impl Parameter {
    /// Those of a recipe.
    pub(crate) fn all(recipe: &Recipe, aliases: &Aliases<'_>) -> Result<Vec<Self>, Error> {
        let parameter = |(name, section): (&String, &fleetfoot_recipe::ParameterSection)| {
            let place = PARAMETERS.entry(name).to_string();
            if aliases.has(name) {
                return Err(Error::name_taken(
                    name,
                    format!(
                        "{place}: a column has this name too; rename the parameter, so that expressions can tell them apart"
                    ),
                ));
            }
            let bounds = section.bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            if bounds.iter().any(|bound| bound.is_nan()) || bounds[0] >= bounds[1] {
                return Err(Error::value(format!(
                    "{place} bounds = [{}, {}]: write the least and the greatest value",
                    bounds[0], bounds[1]
                )));
            }
            if !section.initial.is_finite() || section.initial < bounds[0] || section.initial > bounds[1] {
                return Err(Error::value(format!(
                    "{place} initial = {}: write a number within the bounds {} to {}",
                    section.initial, bounds[0], bounds[1]
                )));
            }
            Ok(Self {
                name: name.clone(),
                initial: section.initial,
                bounds,
                unit: section.unit.clone(),
                fixed: section.fixed == Some(true),
            })
        };
        recipe.parameters.iter().map(parameter).collect()
    }
}

/// All names that expressions read in the end.
pub fn names<'a>(expressions: impl Iterator<Item = &'a Expr>) -> BTreeSet<String> {
    expressions.flat_map(Expr::sources).map(|name| name.to_string()).collect()
}

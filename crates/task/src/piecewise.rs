//! What `fit pwa` asks of a statistic.

use fleetfoot_data::Column;
use fleetfoot_pwa::Problem;
use fleetfoot_recipe::{Error, Recipe};
use fleetfoot_sums::system::System;

use crate::{
    partition::{placeholder, specification},
    task::Task,
};

/// What `fit pwa` is to identify in the one partition of a recipe, and the system that answers for it.
///
/// # Errors
/// What the recipe asks for is not there.
pub fn piecewise(recipe: &Recipe, fields: &[Column], step: f64) -> Result<(Problem, System), Error> {
    let labels: Vec<String> = specification(recipe)?.iter().filter_map(|one| one.label().map(str::to_owned)).collect();
    let problem = Task::resolve(recipe, fields, &labels, step)?.problem;
    let partition = placeholder(specification(recipe)?.as_ref(), &problem.partition_columns);
    let system = System { partition, ..fleetfoot_pwa::system(&problem) };
    Ok((problem, system))
}

//! Problem of `fit pwa` on a statistic.

use fleetfoot_data::Column;
use fleetfoot_pwa::Problem;
use fleetfoot_recipe::{Error, Recipe};
use fleetfoot_sums::system::System;

use crate::{
    partition::{placeholder, specification},
    task::Task,
};

/// Problem of `fit pwa` in the one partition of a recipe, and its system.
///
/// # Errors
/// A recipe that names something that does not exist.
pub fn piecewise(recipe: &Recipe, fields: &[Column], step: f64) -> Result<(Problem, System), Error> {
    let labels: Vec<String> = specification(recipe)?.iter().filter_map(|one| one.label().map(str::to_owned)).collect();
    let problem = Task::resolve(recipe, fields, &labels, step)?.problem;
    let partition = placeholder(specification(recipe)?.as_ref(), &problem.partition_columns);
    let system = System { partition, ..fleetfoot_pwa::system(&problem) };
    Ok((problem, system))
}

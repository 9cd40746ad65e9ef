//! What `fit pwa` asks of a statistic.

use fleetfoot_data::Column;
use fleetfoot_library::Expr;
use fleetfoot_model::Role;
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
    let targets: Vec<Expr> = problem.equations.iter().filter_map(|equation| equation.target.clone()).collect();
    let states = problem.columns.iter().filter(|column| column.role == Role::State);
    let states = states.map(|column| Expr::column(column.name.as_str()));
    let system = System {
        also: targets.iter().cloned().chain(states).collect(),
        weight: problem.weight.clone(),
        partition: placeholder(specification(recipe)?.as_ref(), &problem.partition_columns),
        ..System::new(problem.library.clone(), targets)
    };
    Ok((problem, system))
}

//! Estimate of the cost of opening robots' logs, before they are decoded.

use fleetfoot_data::Progress;
use fleetfoot_log::{Estimate, Selection};
use fleetfoot_recipe::Recipe;
use fleetfoot_task::{EquationTask, StructuredTask, Task};

use crate::{
    dataset::{Dataset, explained, fields, full_selection},
    error::Error,
    logs::Logs,
};

/// Estimates the cost of opening robots' logs for a recipe, with the columns and the task; `None` for tables, which are
/// opened to count their rows.
pub fn estimate(
    recipe: &Recipe,
    labels: &[String],
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<Option<(Task, Vec<String>, Estimate)>, Error> {
    let (fields, info) = fields(recipe, logs)?;
    let recipe = &recipe.expand(&fields)?;
    let task = Task::resolve(recipe, &fields, labels, 0.0).map_err(|error| explained(error, info.as_ref(), logs))?;
    let selection = full_selection(recipe, &task.problem.columns, &task.aliases)?;
    let estimate = cost(logs, &selection, progress)?;
    Ok(estimate.map(|estimate| (task, selection.columns, estimate)))
}

/// Estimates the cost of opening robots' logs for a structured regression, with its task and the fields that are read;
/// `None` for tables.
pub fn estimate_structure(
    recipe: &Recipe,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<Option<(StructuredTask, Vec<String>, Estimate)>, Error> {
    let (recipe, _, task) = Dataset::structure(recipe, logs)?;
    let selection = full_selection(&recipe, &task.columns, &task.aliases)?;
    let estimate = cost(logs, &selection, progress)?;
    Ok(estimate.map(|estimate| (task, selection.columns, estimate)))
}

/// Estimates the cost of opening robots' logs for a fit of equations, with its task and the fields that are read;
/// `None` for tables.
pub fn estimate_equations(
    recipe: &Recipe,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<Option<(EquationTask, Vec<String>, Estimate)>, Error> {
    let (recipe, task) = Dataset::equations(recipe, logs)?;
    let selection = full_selection(&recipe, &task.columns, &task.aliases)?;
    let estimate = cost(logs, &selection, progress)?;
    Ok(estimate.map(|estimate| (task, selection.columns, estimate)))
}

fn cost(logs: &Logs, selection: &Selection, progress: &dyn Progress) -> Result<Option<Estimate>, Error> {
    let files = logs.files();
    if files.len() < logs.len() {
        return Ok(None);
    }
    Ok(fleetfoot_log::estimate(&files, selection, progress)?)
}

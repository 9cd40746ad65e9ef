//! Plan and sums of a recipe's equations in a scan, with their cost.

use fleetfoot_data::setting::{FIT_NARX, FIT_SINDY};
use fleetfoot_data::{Column, Progress};
use fleetfoot_dataset::{Dataset, StatisticFile, covers, once, text::text_among};
use fleetfoot_pwa::Options;
use fleetfoot_recipe::Recipe;
use fleetfoot_sums::system::{System, SystemPlan};
use fleetfoot_task::{EquationTask, WeakForm, piecewise, placeholder, specification};

use super::{EquationGroup, EquationStatistic, StatisticError};
use crate::{
    error::Error,
    narx::Summed,
    pwa::PwaOptions,
    regions::{clustering, regions},
    sindy::Frozen,
};

/// Codes of texts are numbered by the files that are open, so that a statistic of other files would name other labels.
fn refuse_text_labels(recipe: &Recipe, task: &EquationTask, dataset: &Dataset) -> Result<(), Error> {
    let Some(label) = specification(recipe)?.and_then(|one| one.label().map(str::to_owned)) else { return Ok(()) };
    let alias = task.aliases.iter().find(|(column, _)| column.name == label);
    match alias.and_then(|(_, expression)| text_among(expression, dataset.source())) {
        Some(_) => Err(StatisticError::Text { column: label }.into()),
        None => Ok(()),
    }
}

/// Freezes the choices before the pass, from a sample of the rows and by clustering, and sums nothing yet.
///
/// # Errors
/// Those of reading and of clustering; texts in the columns.
pub(super) fn freeze(
    (recipe, fields): (&Recipe, &[Column]),
    tasks: &[EquationTask],
    (dataset, chunk_rows): (&Dataset, Option<usize>),
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<EquationStatistic, Error> {
    let view = dataset.view()?;
    let mut equation_statistic = EquationStatistic::default();
    for (recipe, task) in EquationStatistic::recipes(recipe)?.iter().zip(tasks) {
        refuse_text_labels(recipe, task, dataset)?;
        let mut narrowed: Vec<String> = task.narrowed_note().into_iter().collect();
        let frozen = Frozen::differentiated(task.clone(), &view, &mut narrowed)?;
        let frozen = frozen.windowed(WeakForm::new(&recipe.sindy)?, &view, &mut narrowed)?;
        let seed = recipe.sindy.seed.unwrap_or(0);
        let partition = frozen.partition(recipe, seed, dataset.step(), &view, &mut narrowed, progress)?;
        let plan = SystemPlan::new(frozen.task.summed(partition), chunk_rows, &view)?;
        equation_statistic.differences = frozen.task.settled_differences();
        equation_statistic.groups.push(EquationGroup::empty(plan));
        narrowed.retain(|note| !notes.contains(note));
        notes.append(&mut narrowed);
    }
    for recipe in EquationStatistic::recipes(recipe)? {
        // Errors of a recipe that `fit pwa` cannot read are left to `fit pwa`.
        let Ok((problem, mut system)) = piecewise(&recipe, fields, dataset.step()) else { continue };
        let one = specification(&recipe)?;
        let Ok(PwaOptions { identification: pwa, .. }) = PwaOptions::new(&recipe) else { continue };
        let alike = one.is_none() || finds_alike(&pwa, &clustering(recipe.sindy.seed.unwrap_or(0)));
        if alike && equation_statistic.covering(&system).is_some() {
            continue;
        }
        if let Some(one) = one {
            system.partition = Some(regions(&problem, one, pwa, &view, &mut Vec::new(), progress)?);
        }
        equation_statistic.groups.push(EquationGroup::empty(SystemPlan::new(system, chunk_rows, &view)?));
    }
    for recipe in EquationStatistic::recipes(recipe)? {
        let summed = match Summed::of(&recipe, fields) {
            Ok(Some(summed)) => summed,
            Ok(None) => break,
            Err(error) => {
                notes.push(format!("{FIT_NARX} will need the logs, the statistic has no sums for it: {error}"));
                break;
            }
        };
        let mut system = summed.system();
        if let Some(one) = specification(&recipe)? {
            let problem = summed.problem(dataset.step());
            let clusters = clustering(summed.options.seed);
            system.partition = Some(regions(&problem, one, clusters, &view, &mut Vec::new(), progress)?);
        }
        equation_statistic.groups.push(EquationGroup::empty(SystemPlan::new(system, chunk_rows, &view)?));
    }
    Ok(equation_statistic)
}

/// Passes at most, and bytes about, of the sums of a recipe's equations over so many rows; zeros where there are none.
pub(super) fn cost(recipe: &Recipe, fields: &[Column], rows: usize) -> (usize, usize) {
    let (Ok(recipes), Ok(tasks)) = (EquationStatistic::recipes(recipe), EquationStatistic::tasks(recipe, fields))
    else {
        return (0, 0);
    };
    let bytes = |(recipe, task): (&Recipe, &EquationTask)| {
        let one = specification(recipe).ok().flatten();
        let regions = one.map_or(1, |one| one.clusters().unwrap_or(2));
        SystemPlan::memory(&task.system(), regions, rows)
    };
    let narx = |recipe: &Recipe| {
        let regions = specification(recipe).ok().flatten().map_or(1, |one| one.clusters().unwrap_or(2));
        let summed = Summed::of(recipe, fields).ok().flatten();
        summed.map(|summed| SystemPlan::memory(&summed.system(), regions, rows))
    };
    let of_narx: Vec<usize> = recipes.iter().filter_map(narx).collect();
    // Sums for `fit sindy`, beside them for `fit pwa`, and for `fit narx`; all cluster each partition.
    let methods = if of_narx.is_empty() { 2 } else { 3 };
    let passes = methods * recipes.len() + methods * (recipes.len() - 1);
    (passes, recipes.iter().zip(&tasks).map(bytes).chain(of_narx).sum())
}

/// [`EquationStatistic::text`] of another recipe with the differences and chunks of this statistic. `scanned`: the
/// recipe of this statistic, with its fields.
///
/// # Errors
/// Those of [`EquationStatistic::tasks`].
pub(super) fn text_of(
    statistic: &EquationStatistic,
    (recipe, fields): (&Recipe, &[Column]),
    (scanned, scanned_fields): (&Recipe, &[Column]),
) -> Result<String, Error> {
    let raw = EquationTask::resolve(&EquationStatistic::whole(scanned), scanned_fields)?;
    let mut systems: Vec<System> = Vec::new();
    let recipes = EquationStatistic::recipes(recipe)?;
    for (recipe, task) in recipes.iter().zip(EquationStatistic::tasks(recipe, fields)?) {
        let mut task = task.differentiated_like(&raw, &statistic.differences);
        task.windows = WeakForm::new(&recipe.sindy)?
            .like(statistic.groups.first().and_then(|group| group.plan.system.weak.as_ref()));
        systems.push(task.summed(placeholder(specification(recipe)?.as_ref(), &task.partition_columns)));
    }
    for recipe in &recipes {
        let Ok((_, system)) = piecewise(recipe, fields, 0.0) else { continue };
        if !systems.iter().any(|held| covers(held, &system).is_some()) {
            systems.push(system);
        }
    }
    for recipe in &recipes {
        let Ok(Some(summed)) = Summed::of(recipe, fields) else { break };
        let partition = placeholder(specification(recipe)?.as_ref(), summed.partition_columns());
        systems.push(System { partition, ..summed.system() });
    }
    // Statistics without a counterpart have no chunks to compare either.
    let chunk_rows = |at: usize| statistic.groups.get(at).map_or(0, |group| group.plan.chunk_rows);
    Ok(once(systems.iter().enumerate().map(|(at, system)| SystemPlan::text_of(system, chunk_rows(at)))))
}

/// That a recipe with these fields asks for the equations that this statistic holds, where it holds any.
pub(super) fn accepts_equations(
    file: &StatisticFile,
    recipe: &Recipe,
    fields: &[Column],
    [left, right]: [&str; 2],
) -> Result<(), Error> {
    let Some(equations) = &file.equations else { return Ok(()) };
    let scanned = Recipe::parse(&file.recipe, "the recipe of the statistic")?;
    let wanted = text_of(equations, (recipe, fields), (&scanned, &file.fields))?;
    Ok(StatisticFile::refuse_difference(&equations.text(), &wanted, Vec::new(), [left, right])?)
}

/// Returns true if two clustering options give the same regions of the same rows.
fn finds_alike(one: &Options, other: &Options) -> bool {
    (one.seed, one.restarts, one.iterations, one.memory) == (other.seed, other.restarts, other.iterations, other.memory)
}

/// Why the equations of a recipe are not summed, for people.
pub(super) fn unserved(error: &dyn std::fmt::Display) -> String {
    format!("{FIT_SINDY} will need the logs, the statistic has no sums for it: {error}")
}

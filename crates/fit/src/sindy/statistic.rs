//! Equations from a `.stats` file: no pass.

use std::collections::BTreeMap;

use fleetfoot_data::setting::{DEGREE, FIT_SINDY, FIT_SPARSE, LIBRARY, PARAMETERS, SCAN};
use fleetfoot_dataset::{EquationGroup, EquationStatistic, StatisticFile};
use fleetfoot_library::Expr;
use fleetfoot_recipe::Recipe;
use fleetfoot_sums::system::{System, SystemScan};
use fleetfoot_task::{EquationTask, WeakForm};

use super::frozen::Frozen;
use crate::{error::Error, radial, sindy::Evidence};

impl Evidence {
    /// The sums of a statistic for a recipe that stands above that of the scan.
    ///
    /// # Errors
    /// Those of reading; a question that needs rows; candidates, targets or regions that were not summed.
    pub(super) fn of_statistic(
        recipe: &Recipe,
        scanned: &Recipe,
        file: &StatisticFile,
        notes: &mut Vec<String>,
    ) -> Result<Self, Error> {
        refuse_rows(recipe)?;
        let Some(equations) = &file.equations else { return Err(unserved(file, scanned)) };
        let task = EquationTask::resolve(&recipe.expand(&file.fields)?, &file.fields)?;
        let summed = EquationTask::resolve(&EquationStatistic::whole(scanned), &file.fields)?;
        let task = task.differentiated_like(&summed, &equations.differences);
        let group = equations.of(recipe, &task.partition_columns)?;
        let task = over(task, &group.plan.system)?;
        let scan = SystemScan::new(&group.plan, &group.sums)?;
        let known: BTreeMap<_, _> = file.episodes.iter().map(|episode| (episode.id, episode.trained())).collect();
        WeakForm::new(&recipe.sindy)?.check_statistic(group.plan.system.weak.as_ref())?;
        let system = group.plan.system.clone();
        notes.extend(task_notes(&task, group));
        let frozen = Frozen { task, parameters: Vec::new() };
        let evidence = Self::new(frozen, system, scan, file.step(), &known).smoothed_over(scanned.time.smoothed);
        evidence.check()?;
        Ok(evidence)
    }
}

/// Why a statistic has no equations.
fn unserved(file: &StatisticFile, recipe: &Recipe) -> Error {
    let reason = match EquationStatistic::tasks(recipe, &file.fields) {
        Err(error) => error.to_string(),
        Ok(_) => format!("its plan sums the tasks of {FIT_SPARSE} alone, because columns of the equations are texts"),
    };
    Error::other_statistic(format!(
        "the statistic has no sums of equations for {FIT_SINDY}: {reason}; give the logs, or {SCAN} them again with a recipe whose equations can be summed"
    ))
}

/// Refuses settings that a statistic cannot serve.
fn refuse_rows(recipe: &Recipe) -> Result<(), Error> {
    radial::refuse_statistic(recipe)?;
    match recipe.parameters.keys().next() {
        None => Ok(()),
        Some(name) => Err(Error::needs_rows(format!(
            "{entry}: an estimate inside expressions needs the rows, which a statistic lacks; give the logs instead",
            entry = PARAMETERS.entry(name)
        ))),
    }
}

/// Notes beside the fit.
fn task_notes(task: &EquationTask, group: &EquationGroup) -> Vec<String> {
    let mut notes = task.unit_notes();
    notes.extend(task.narrowed_note());
    if let Some(partition) = &group.plan.system.partition {
        notes.push(format!("{}: the regions are those of the scan, frozen with its plan", partition.specification));
    }
    notes
}

/// The same equations over the candidates of a scan, of which they may have those that they had before.
fn over(mut task: EquationTask, scanned: &System) -> Result<EquationTask, Error> {
    let wanted: Vec<&Expr> = task.fitted.iter().map(|equation| &equation.target).collect();
    if !scanned.targets.iter().eq(wanted.iter().copied()) || scanned.weight != task.weight {
        let weight = |weight: &Option<Expr>| weight.as_ref().map_or("1".to_owned(), Expr::to_string);
        let list =
            |targets: &mut dyn Iterator<Item = &Expr>| targets.map(Expr::to_string).collect::<Vec<_>>().join(", ");
        return Err(Error::other_statistic(format!(
            "the statistic is of other equations or weights: it has the left sides {} with the weight {}, the recipe asks for {} with {}; fit with the \
             recipe of its scan, scan again with this one, or give the logs",
            list(&mut scanned.targets.iter()),
            weight(&scanned.weight),
            list(&mut wanted.into_iter()),
            weight(&task.weight)
        )));
    }
    let first = usize::from(task.constant);
    let mut places: Vec<usize> = (0..first).collect();
    for function in &task.functions {
        let place = scanned.functions.iter().position(|known| known == function).ok_or_else(|| {
            Error::other_statistic(format!(
                "the statistic has no candidate `{function}`; name candidates that were scanned (there are {}), scan again with the {LIBRARY} or {DEGREE} that has it, \
                 or give the logs",
                scanned.functions.len()
            ))
        })?;
        places.push(first + place);
    }
    for equation in &mut task.fitted {
        let mut allowed = vec![false; first + scanned.functions.len()];
        equation
            .allowed
            .iter()
            .zip(&places)
            .filter(|(is_allowed, _)| **is_allowed)
            .for_each(|(_, &place)| allowed[place] = true);
        equation.allowed = allowed;
        equation.fixed = equation.fixed.iter().map(|&j| places[j]).collect();
        equation.fixed.sort_unstable();
    }
    task.limits.iter_mut().for_each(|limit| limit.candidate = places[limit.candidate]);
    task.functions = scanned.functions.clone();
    Ok(task)
}

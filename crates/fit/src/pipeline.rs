//! The common pipeline from logs, or from their statistic, to a model and a report of its errors. Its steps: open,
//! resolve, choose spans by rollouts, sum, fit the candidates, choose, refit to simulations if that is the objective,
//! report. The parts that differ between methods are a [`Method`].

use std::sync::Arc;

use fleetfoot_data::setting::SELECT;
use fleetfoot_data::{EpisodeId, Progress, Source};
use fleetfoot_dataset::{Logs, StatisticFile};
use fleetfoot_model::Model;
use fleetfoot_recipe::{Objective, Recipe};

use crate::{
    baselines::baselines,
    concentration,
    error::Error,
    folds::smoothed_rows,
    held_inputs,
    incomplete::incomplete_rows,
    last_rows,
    method::{Data, FitRequest, Fitted, Method, Opened},
    model_file::refuse_not_finite,
    not_finite, objective,
    objective::Refinement,
    plan::FitPlan,
    rollout_choice::{HeldOut, RolloutCandidate, RolloutChoice, RolloutRule, candidates, open_spans, settled, terms},
    simulated_folds::{FoldSimulations, Simulations, simulated_folds},
    summary::FitSummary,
};

/// Fits a model to logs, or to one `.stats` file without a pass.
///
/// # Errors
/// Those of the recipe, of reading and of solving; a fit of a statistic that needs rows; models by label ([`fit_all`]).
pub fn fit<M: Method>(
    recipe: &Recipe,
    request: &FitRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Fitted<M::Report>, Error> {
    if let Some(label) = &request.by {
        return Err(Error::conflict(format!(
            "by = {label}: this gives a model for each value of the label, and one model was asked for; remove it"
        )));
    }
    let mut fitted = fit_all::<M>(recipe, request, logs, progress)?;
    Ok(fitted.swap_remove(0))
}

/// Fits a model to logs, or to one `.stats` file without a pass; or one for every value of a label ([`FitRequest::by`]). There is one at least.
///
/// # Errors
/// As [`fit`].
pub fn fit_all<M: Method>(
    recipe: &Recipe,
    request: &FitRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Vec<Fitted<M::Report>>, Error> {
    let logs = &logs.into();
    // Errors in the words of the recipe are reported before the pass.
    let mut method = M::new(recipe, request)?;
    let mut notes = Vec::new();
    if logs.is_statistic() {
        let file = Arc::new(logs.statistic()?);
        let scanned = Recipe::parse(&file.recipe, "the recipe of the statistic")?;
        let recipe = M::above(recipe, &scanned, &file, &mut notes)?;
        method = M::new(&recipe, request)?;
        objective::refuse_statistic(method.objective())?;
        return of_statistic(&method, (&recipe, &scanned), &file, notes, progress);
    }
    match method.scan(recipe, logs, &mut notes, progress)? {
        Some(file) => of_statistic(&method, (recipe, recipe), &Arc::new(file), notes, progress),
        None => Ok(of_logs(method, recipe, logs, None, progress)?.into_iter().map(|(fitted, _)| fitted).collect()),
    }
}

/// Fits a model to logs, and simulates rows that did not train: fold by fold by the same candidate, fitted to the other folds.
///
/// Order, terms and partition are those that all rows chose; coefficients are those of each fold's training rows.
///
/// # Errors
/// As [`fit`]; folds that are shorter than the simulations.
pub fn fit_and_simulate<M: Method>(
    recipe: &Recipe,
    request: &FitRequest,
    logs: impl Into<Logs>,
    simulations: &Simulations,
    progress: &dyn Progress,
) -> Result<(Fitted<M::Report>, FoldSimulations), Error> {
    let method = M::new(recipe, request)?;
    let mut fitted = of_logs(method, recipe, &logs.into(), Some(simulations), progress)?;
    Ok(fitted.swap_remove(0))
}

/// Plan of a fit: data to read, statistics to keep, and work. Robots' logs are not decoded for it.
///
/// # Errors
/// Those of the recipe and of opening.
pub fn plan<M: Method>(
    recipe: &Recipe,
    request: &FitRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<FitPlan, Error> {
    let logs = &logs.into();
    let method = M::new(recipe, request)?;
    match logs.is_statistic() {
        true => Ok(FitPlan::of_statistic(&logs.statistic()?)),
        false => method.plan(recipe, logs, progress),
    }
}

/// A fit, and the simulations of its folds where they were asked for.
type Simulated<M> = (Fitted<<M as Method>::Report>, FoldSimulations);

fn of_logs<M: Method>(
    mut method: M,
    recipe: &Recipe,
    logs: &Logs,
    simulations: Option<&Simulations>,
    progress: &dyn Progress,
) -> Result<Vec<Simulated<M>>, Error> {
    let (dataset, task) = method.open(&settled(recipe, None), logs, progress)?;
    let mut opened = Opened { recipe: method.carried(recipe, None), task, dataset };
    let mut rollouts = None;
    if let Some(rule) = method.rollouts() {
        let choice = by_rollouts(&method, recipe, &opened, rule, progress)?;
        let chosen = &choice.candidates[choice.chosen];
        opened.task = method.with_span(recipe, &opened.task, chosen.over);
        opened.recipe = method.carried(recipe, chosen.over);
        method.take(choice.chosen);
        rollouts = Some(choice);
    }
    let mut notes = Vec::new();
    let sums = method.sum_logs(&mut opened, logs, &mut notes, progress)?;
    let Opened { recipe, task, dataset } = &opened;
    let view = dataset.view()?;
    let split = method.split(&view, dataset.step())?;
    let (rows, kept): (&dyn Source, Option<&dyn Source>) = match &split {
        Some([train, test]) => (train, Some(test)),
        None => (&view, None),
    };
    let step = dataset.step() * method.every() as f64;
    let data = Data { recipe, task, rows: Some(rows), kept, step };
    let solutions = method
        .find(data, &sums, &mut notes, progress)
        .map_err(|error| not_finite::with_reasons(error, dataset, method.expressions(task)))?;
    let named =
        |id: EpisodeId| dataset.episodes().iter().find(|episode| episode.id == id).map(|episode| episode.name.clone());
    let mut fitted = Vec::with_capacity(solutions.len());
    for mut solution in solutions {
        refuse_not_finite(M::model(&solution))?;
        let refinement = refined(&method, data, &sums, &mut solution, progress)?;
        let facts = method.facts(data, &sums, &solution);
        let mut summary_notes = dataset.notes().to_vec();
        summary_notes.extend(notes.iter().cloned());
        let incomplete = facts.left_out.get(1).copied().unwrap_or(0);
        summary_notes.extend(incomplete_rows(incomplete, dataset, method.expressions(task))?);
        summary_notes.extend(concentration::notes(&facts.concentrated, named));
        summary_notes.extend(objective::note(method.objective(), refinement.as_ref()));
        if refinement.is_none() {
            summary_notes.extend(held_inputs::note(M::model(&solution), rows)?);
        }
        // The model of simulations is another one, and `auto` has a test of its own.
        let one_step = refinement.as_ref().is_none_or(|refinement| !refinement.written);
        let by_time = match one_step && simulations.is_none() {
            true => last_rows::by_time(&method, data, &solution, smoothed_rows(recipe.time.smoothed, step), progress)?,
            false => None,
        };
        let summary = FitSummary {
            episodes: facts.episodes,
            files: logs.len(),
            left_out: facts.left_out,
            rollouts: rollouts.clone(),
            refinement,
            by_time,
            baselines: baselines(M::model(&solution), rows, progress)?,
            notes: summary_notes,
            verdict: None,
        };
        let folds = match simulations {
            Some(wanted) => simulated_folds(&method, data, &solution, wanted, progress)?,
            None => FoldSimulations::HeldOut(Vec::new()),
        };
        fitted.push((method.report(data, &sums, solution, summary, progress)?, folds));
    }
    Ok(fitted)
}

/// The same from the sums of a statistic, whose scan had a separate recipe.
fn of_statistic<M: Method>(
    method: &M,
    (recipe, scanned): (&Recipe, &Recipe),
    file: &Arc<StatisticFile>,
    mut notes: Vec<String>,
    progress: &dyn Progress,
) -> Result<Vec<Fitted<M::Report>>, Error> {
    let (task, sums) = method.of_statistic(recipe, scanned, file, &mut notes, progress)?;
    let data = Data { recipe, task: &task, rows: None, kept: None, step: file.step() };
    let named = |id: EpisodeId| file.episode(id).map(|episode| episode.name.clone());
    let mut fitted = Vec::new();
    for solution in method.find(data, &sums, &mut notes, progress)? {
        refuse_not_finite(M::model(&solution))?;
        let facts = method.facts(data, &sums, &solution);
        let mut summary_notes = notes.clone();
        summary_notes.extend(concentration::notes(&facts.concentrated, named));
        let summary = FitSummary {
            episodes: facts.episodes,
            files: file.files.len(),
            left_out: facts.left_out,
            notes: summary_notes,
            verdict: None,
            ..FitSummary::default()
        };
        fitted.push(method.report(data, &sums, solution, summary, progress)?);
    }
    Ok(fitted)
}

/// Compares candidates and open spans by rollouts: for every span all trials are fitted to the training rows of every fold.
fn by_rollouts<M: Method>(
    method: &M,
    recipe: &Recipe,
    opened: &Opened<M::Task>,
    rule: RolloutRule,
    progress: &dyn Progress,
) -> Result<RolloutChoice, Error> {
    let view = opened.dataset.view()?;
    let step = opened.dataset.step();
    let option =
        if open_spans(recipe).is_empty() { SELECT.to("rollout").to_string() } else { "over = \"auto\"".to_owned() };
    let held = HeldOut::new((&view, smoothed_rows(recipe.time.smoothed, step)), rule, option)?;
    let mut compared = Vec::new();
    for over in candidates(recipe) {
        let task = method.with_span(recipe, &opened.task, over);
        let (mut names, mut sizes) = (Vec::new(), Vec::new());
        let errors = held.errors(progress, |train| {
            let data = Data { recipe, task: &task, rows: Some(train), kept: None, step };
            let (labels, models): (Vec<String>, Vec<Model>) = method.trials(data, progress)?.into_iter().unzip();
            sizes.resize(models.len(), 0);
            sizes.iter_mut().zip(&models).for_each(|(size, model)| *size = terms(model).max(*size));
            names = labels;
            Ok(models)
        })?;
        compared.extend(names.into_iter().zip(sizes).zip(errors).map(|((partition, size), folds)| RolloutCandidate {
            partition,
            over,
            size,
            folds,
        }));
    }
    RolloutChoice::new(rule, compared)
}

/// Fits the chosen model to simulations if that is the objective, and takes the result if it is better.
fn refined<M: Method>(
    method: &M,
    data: Data<'_, M::Task>,
    sums: &M::Sums,
    solution: &mut M::Solution,
    progress: &dyn Progress,
) -> Result<Option<Refinement>, Error> {
    let (objective, Some(rows)) = (method.objective(), data.rows) else { return Ok(None) };
    if objective == Objective::OneStep {
        return Ok(None);
    }
    let smoothed = smoothed_rows(data.recipe.time.smoothed, data.step);
    let beginning = method.beginning(data, solution)?;
    let again = |train: &dyn Source| method.again(Data { rows: Some(train), kept: None, ..data }, solution, progress);
    let mut refinement = objective::refine(objective, &beginning, (rows, smoothed), progress, again)?;
    if let Some(refinement) = &mut refinement {
        method.refine(data, sums, solution, refinement)?;
    }
    Ok(refinement)
}

//! From files and a recipe to a piecewise-affine model.

mod fitted;
mod options;
mod residuals;
mod statistic;

pub use fitted::{Fitted, PwaRequest, rival};
use fleetfoot_data::{Progress, Source, Work};
use fleetfoot_dataset::{Dataset, Logs, ReadPlan, open};
use fleetfoot_estimate::Hold;
use fleetfoot_library::Expr;
use fleetfoot_model::{Model, Prediction, RadialFunctions};
use fleetfoot_pwa::{Identification, Options, Problem, Selection, Shrinkage, Stability};
use fleetfoot_recipe::{Derivative, Objective, Recipe};
use fleetfoot_task::Task;
pub use options::PwaOptions;
use residuals::move_residuals;
use serde::Serialize;
pub(crate) use statistic::served;

use crate::{
    concentration,
    error::Error,
    incomplete::incomplete_rows,
    model_file::refuse_not_finite,
    not_finite, objective,
    objective::{Beginning, Refinement},
    radial,
    rollout_choice::{HeldOut, RolloutCandidate, RolloutChoice, RolloutRule, candidates, open_spans, settled, terms},
    serialize,
};

/// What a fit would read and keep.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct FitPlan {
    /// What its passes would read.
    #[serde(flatten)]
    pub reading: ReadPlan,
    /// Columns of the regression, the constant left out.
    pub regressors: usize,
    /// Fitted equations.
    pub targets: usize,
    /// Partitions to choose from.
    #[serde(skip)]
    pub partitions: usize,
    /// How partitions and open spans would be compared by rollouts, where they would be.
    #[serde(skip)]
    pub rollouts: Option<RolloutRule>,
    /// How many spans would be compared; 1 where none is open.
    #[serde(skip)]
    pub spans: usize,
    /// Passes over the rows, at most.
    pub passes: usize,
    /// Those among them that the choice by rollouts takes.
    #[serde(skip)]
    pub choice_passes: usize,
    /// Passes of one identification.
    #[serde(skip)]
    pub fit_passes: usize,
    /// What coefficients are fitted to, which takes passes of its simulations beside [`Self::passes`].
    #[serde(skip)]
    pub objective: Objective,
    /// Whether its regions' maps are bounded.
    #[serde(skip)]
    pub bounded: bool,
    /// Rows that k-means keeps.
    pub clustered_rows: usize,
    /// Bytes, about.
    #[serde(rename = "memory_bytes")]
    pub memory: usize,
    /// What the models of all regions and folds take, passes over the rows left out.
    #[serde(rename = "operations", serialize_with = "serialize::operations")]
    pub work: Work,
    /// What was assumed or left out.
    #[serde(skip)]
    pub notes: Vec<String>,
}

/// Opens the files and tells what [`fit_pwa`] would do. Robots' logs are not decoded for it.
///
/// # Errors
/// Those of the recipe and of opening.
pub fn plan_pwa(recipe: &Recipe, logs: impl Into<Logs>, progress: &dyn Progress) -> Result<FitPlan, Error> {
    let logs = &logs.into();
    if logs.is_statistic() {
        return Err(Error::needs_rows(
            "--dry-run tells what a pass over logs would cost, and a statistic needs none; leave it away".into(),
        ));
    }
    let options = PwaOptions::new(recipe)?;
    let centres = radial::count(recipe)?.unwrap_or(0);
    let (rollouts, spans) = (options.rollouts, candidates(recipe).len());
    // The training rows of a fold are fewer, so that its passes are less than the fit's own.
    let choice_passes = rollouts.map_or(0, |rule| PWA_PASSES * rule.folds * spans);
    let recipe = &settled(recipe, None);
    let (task, reading, notes) = match open::estimate(recipe, &options.labels(), logs, progress)? {
        Some((task, columns, cost)) => (task, ReadPlan::of_messages(logs, columns, &cost), Vec::new()),
        None => {
            let (dataset, task) = Dataset::for_recipe(recipe, &options.labels(), logs, progress)?;
            (task, ReadPlan::of_tables(logs, &dataset), dataset.notes().to_vec())
        }
    };
    let cost = fleetfoot_pwa::cost(&task.problem, &options.identification, reading.rows);
    Ok(FitPlan {
        reading,
        regressors: task.problem.library.len() + centres,
        targets: task.problem.equations.iter().filter(|equation| equation.target.is_some()).count(),
        partitions: options.identification.partitions.len(),
        rollouts,
        spans,
        passes: cost.passes + choice_passes + usize::from(centres > 0),
        choice_passes,
        fit_passes: cost.passes,
        objective: options.objective,
        bounded: options.identification.stability.is_some() || !options.identification.ports.is_empty(),
        clustered_rows: cost.clustered_rows,
        memory: cost.bytes,
        work: work(&task.problem, &cost),
        notes,
    })
}

/// What the models of all regions and folds take.
fn work(problem: &Problem, cost: &fleetfoot_pwa::Cost) -> Work {
    Work {
        operations: cost.operations,
        parts: problem.equations.iter().filter(|equation| equation.target.is_some()).count().max(1),
        mend: "a smaller library (--degree, --lags), fewer regions or fewer folds (--folds 2) make it shorter",
    }
}

/// Passes of one identification: survey, scan, errors.
pub const PWA_PASSES: usize = 3;

/// All expressions over the aliases that a row needs.
fn functions(task: &Task, labels: &[String]) -> Vec<Expr> {
    let problem = &task.problem;
    let targets = problem.equations.iter().filter_map(|equation| equation.target.as_ref());
    let phase = task.phase.iter().map(|phase| &phase.column);
    let also = problem.partition_columns.iter().chain(&problem.weight).chain(phase);
    let labels = labels.iter().map(|label| Expr::column(label.as_str()));
    problem.library.iter().chain(targets).chain(also).cloned().chain(labels).collect()
}

/// Fits a piecewise-affine model to logs, or to one `.stats` file without a pass, as the recipe says: its partitions, else one region; chosen as `[pwa]` says.
///
/// Where `[pwa]` asks for it, and where a state's span is open (`derivative = { over = "auto" }`), the partition (and the span) are those whose rollouts on spans that
/// did not train err least: the models that are compared are fitted on the training rows of each fold. The model carries the recipe as it was said, which finds it again.
///
/// # Errors
/// Those of the recipe, of reading and of identifying; held-out spans shorter than the rollouts; every candidate of a choice by rollouts diverges.
pub fn fit_pwa(
    recipe: &Recipe,
    request: PwaRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    let logs = &logs.into();
    if logs.is_statistic() {
        return statistic::fit(recipe, request, logs);
    }
    let said = PwaOptions::new(recipe)?;
    let (dataset, mut task) = Dataset::for_recipe(&settled(recipe, None), &said.labels(), logs, progress)?;
    let mut options = said.of_step(dataset.step());
    options.keep_all = request.keep_all;
    let view = dataset.view()?;
    options.phase = task.phase_in(view.columns());
    let mut radial_notes = Vec::new();
    let clustering = (options.seed, &view as &dyn Source);
    let radial = radial::found(recipe, &task.variables, &task.problem, clustering, &mut radial_notes, progress)?;
    task.problem.library.extend(radial.iter().flat_map(RadialFunctions::expressions));
    let mut rollouts = None;
    if let Some(rule) = said.rollouts {
        let choice = by_rollouts(recipe, &task.problem, &options, &view, rule, progress)?;
        options.selection = Selection::Given(choice.chosen % options.partitions.len());
        task.problem = spanned(recipe, &task.problem, choice.candidates[choice.chosen].over);
        rollouts = Some(choice);
    }
    progress.expect(work(&task.problem, &fleetfoot_pwa::cost(&task.problem, &options, dataset.rows())));
    let found = fleetfoot_pwa::identify(&task.problem, &options, &view, progress);
    let mut identification =
        found.map_err(|error| not_finite::with_reasons(error.into(), &dataset, functions(&task, &said.labels())))?;
    refuse_not_finite(&identification.model)?;
    let refinement = refined(said.objective, &task.problem, &options, &mut identification, &view, progress)?;
    let text = recipe.to_toml();
    for model in std::iter::once(&mut identification.model).chain(&mut identification.models) {
        model.training.recipe.clone_from(&text);
        if let Some(radial) = &radial {
            radial.gather(model);
        }
    }
    let mut notes = dataset.notes().to_vec();
    notes.append(&mut radial_notes);
    notes.extend(options::unused(recipe));
    notes.extend(objective::note(said.objective, refinement.as_ref()));
    notes.extend(incomplete_rows(identification.incomplete, &dataset, functions(&task, &said.labels()))?);
    let told = identification.targets.iter().cloned().zip(identification.concentrated.iter().map(Option::as_ref));
    let name = |id| dataset.episodes().iter().find(|episode| episode.id == id).map(|episode| episode.name.clone());
    notes.extend(concentration::notes(told, name));
    notes.append(&mut identification.notes);
    Ok(Fitted { identification, episodes: dataset.episodes().len(), files: logs.len(), rollouts, refinement, notes })
}

/// Fits the chosen model to simulations where that is the objective, and takes what comes of it where it is the better one.
fn refined(
    objective: Objective,
    problem: &Problem,
    options: &Options,
    identification: &mut Identification,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Option<Refinement>, Error> {
    let chosen = &identification.candidates[identification.chosen];
    let mut trial = options.clone();
    (trial.folds, trial.keep_all, trial.tsqr) = (0, false, false);
    trial.partitions = vec![chosen.specification.clone()];
    let shrinkage = chosen.shrinkage;
    (trial.selection, trial.shrinkage) = (Selection::Given(0), Shrinkage::Rows(shrinkage));
    let beginning = |model: &Model, stability: Option<&Stability>| -> Result<Beginning, Error> {
        let hold = stability.map(|stability| objective::Bound::new(problem, stability)).transpose()?;
        Ok((model.clone(), hold.map(|hold| Box::new(hold) as Box<dyn Hold>)))
    };
    let fit = |train: &dyn Source| {
        let found = fleetfoot_pwa::identify(problem, &trial, train, progress)?;
        beginning(&found.model, found.candidates[found.chosen].stability.as_ref())
    };
    let bounded = chosen.stability.clone();
    let begin = beginning(&identification.model, bounded.as_ref())?;
    let mut refinement = objective::refine(objective, &begin, (source, options.smoothed), progress, fit)?;
    if let (Some(found), Some(stability)) = (&mut refinement, &bounded) {
        found.bound = Some(objective::Bound::new(problem, stability)?.told(stability, &found.fitted.model));
    }
    if let Some(found) = refinement.as_ref().filter(|found| found.written) {
        let before = std::mem::replace(&mut identification.model, found.fitted.model.clone());
        move_residuals(&before, &mut identification.model, &identification.roots);
        // That of the coefficients before.
        identification.model.partitions.iter_mut().for_each(|partition| partition.correlation = None);
    }
    Ok(refinement)
}

/// Compares partitions and open spans by rollouts: for every span, all partitions are fitted in the same passes over the training rows of every fold.
fn by_rollouts(
    recipe: &Recipe,
    problem: &Problem,
    options: &Options,
    source: &dyn Source,
    rule: RolloutRule,
    progress: &dyn Progress,
) -> Result<RolloutChoice, Error> {
    let held = HeldOut::new((source, options.smoothed), rule, "--select rollout")?;
    let mut trial = options.clone();
    (trial.folds, trial.keep_all, trial.tsqr) = (0, true, false);
    let mut found = Vec::new();
    for over in candidates(recipe) {
        let problem = spanned(recipe, problem, over);
        let mut sizes = vec![0; options.partitions.len()];
        let errors = held.errors(progress, |train| {
            let models = fleetfoot_pwa::identify(&problem, &trial, train, progress)?.models;
            sizes.iter_mut().zip(&models).for_each(|(size, model)| *size = (*size).max(terms(model)));
            Ok(models)
        })?;
        for ((partition, size), folds) in options.partitions.iter().zip(sizes).zip(errors) {
            found.push(RolloutCandidate { partition: partition.to_string(), over, size, folds });
        }
    }
    RolloutChoice::new(rule, found)
}

/// The problem with the targets of open spans settled.
fn spanned(recipe: &Recipe, problem: &Problem, over: Option<u32>) -> Problem {
    let (mut problem, open) = (problem.clone(), open_spans(recipe));
    for equation in &mut problem.equations {
        if equation.prediction == Prediction::Derivative
            && equation.target.is_some()
            && open.contains(&equation.subject)
        {
            let angle = problem.columns.iter().any(|column| column.name == equation.subject && column.angle);
            equation.target = Some(Derivative::settled(&Expr::column(equation.subject.as_str()), angle, over));
        }
    }
    problem
}

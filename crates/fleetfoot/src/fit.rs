//! From files and a recipe to a piecewise-affine model.

use std::path::{Path, PathBuf};

use fleetfoot_data::{Progress, Source};
use fleetfoot_library::Expr;
use fleetfoot_model::Prediction;
use fleetfoot_pwa::{Identification, Options, Problem, Selection, Specification};

use crate::{
    Dataset, Derivative, Error, HORIZON, Logs, Recipe, RolloutCandidate, RolloutChoice, RolloutRule, Task, dataset,
    left_out::left_out,
    not_finite,
    output::{refuse_not_finite, write_model},
    rollout_choice::{HeldOut, candidates, open_spans, settled, terms},
};

/// What a fit found, and on what.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Fitted {
    /// The model, its rivals, and their scores.
    pub identification: Identification,
    /// Episodes used.
    pub episodes: usize,
    /// Files used.
    pub files: usize,
    /// How partition and spans were chosen by rollouts, where they were.
    pub rollouts: Option<RolloutChoice>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Fitted {
    /// Writes the models of all candidates beside the chosen one's file, if they were kept ([`Options::keep_all`]); tells the files, in the
    /// order of the candidates.
    ///
    /// # Errors
    /// Those of writing.
    pub fn write_rivals(&self, chosen: &Path) -> Result<Vec<PathBuf>, Error> {
        let found = &self.identification;
        let mut written = Vec::with_capacity(found.models.len());
        for (model, candidate) in found.models.iter().zip(&found.candidates) {
            let path = rival(chosen, &candidate.specification);
            write_model(model, &path)?;
            written.push(path);
        }
        Ok(written)
    }
}

/// `model.json` and `kmeans:10` make `model_kmeans10.json`.
pub fn rival(chosen: &Path, specification: &Specification) -> PathBuf {
    let stem = chosen.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
    let name: String = specification
        .to_string()
        .chars()
        .filter(|&c| c != ':')
        .map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '-' })
        .collect();
    let extension = chosen.extension().map_or_else(|| "json".into(), |extension| extension.to_string_lossy());
    chosen.with_file_name(format!("{stem}_{name}.{extension}"))
}

/// What a fit would read and keep.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct FitPlan {
    /// Files.
    pub files: usize,
    /// Episodes; robots' logs are not decoded to count them.
    pub episodes: Option<usize>,
    /// Rows; of robots' logs at most, from the counts in the files.
    pub rows: usize,
    /// Bytes of decoded columns, where logs must be decoded, and whether the cache has them already.
    pub decoded: Option<(u64, bool)>,
    /// Columns that are read.
    pub columns: Vec<String>,
    /// Columns of the regression, the constant left out.
    pub regressors: usize,
    /// Fitted equations.
    pub targets: usize,
    /// Partitions to choose from.
    pub partitions: usize,
    /// Rows that k-means keeps.
    pub clustered_rows: usize,
    /// Bytes, about.
    pub memory: usize,
    /// What was assumed or left out.
    pub notes: Vec<String>,
}

/// Opens the files and tells what [`fit_pwa`] would do. Robots' logs are not decoded for it.
pub fn plan_pwa(
    recipe: &Recipe,
    options: &Options,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<FitPlan, Error> {
    let logs = &logs.into();
    let options = with_partitions(recipe, options)?;
    let recipe = &settled(recipe, None);
    let (task, columns, rows, episodes, decoded, notes) =
        match dataset::estimate(recipe, &labels(&options), logs, progress)? {
            Some((task, columns, cost)) => {
                (task, columns, cost.rows as usize, None, Some((cost.decoded_bytes, cost.cached)), Vec::new())
            }
            None => {
                let (dataset, task) = Dataset::for_recipe(recipe, &labels(&options), logs, progress)?;
                let (episodes, notes) = (dataset.episodes().len(), dataset.notes().to_vec());
                (task, dataset.columns(), dataset.rows(), Some(episodes), None, notes)
            }
        };
    let cost = fleetfoot_pwa::cost(&task.problem, &options, rows);
    Ok(FitPlan {
        files: logs.len(),
        episodes,
        rows,
        decoded,
        columns,
        regressors: task.problem.library.len(),
        targets: task.problem.equations.iter().filter(|equation| equation.target.is_some()).count(),
        partitions: options.partitions.len(),
        clustered_rows: cost.clustered_rows,
        memory: cost.bytes,
        notes,
    })
}

fn with_partitions(recipe: &Recipe, options: &Options) -> Result<Options, Error> {
    let mut options = options.clone();
    if let Some(text) = &recipe.model.partition {
        options.partitions = Specification::parse_list(text)?;
    }
    Ok(options)
}

fn labels(options: &Options) -> Vec<String> {
    options.partitions.iter().filter_map(|p| p.label().map(str::to_owned)).collect()
}

/// All expressions over the aliases that a row needs.
fn functions(task: &Task) -> Vec<Expr> {
    let problem = &task.problem;
    let targets = problem.equations.iter().filter_map(|equation| equation.target.as_ref());
    problem.library.iter().chain(targets).chain(&problem.partition_columns).chain(&problem.weight).cloned().collect()
}

/// Fits a piecewise-affine model.
///
/// The partitions are `options.partitions` when given there explicitly, else the recipe's, else one region. `purge` is the gap between held-out
/// and training rows, seconds; `None`: a tenth of a held-out span. Where a state's span is open (`derivative = { over = "auto" }`), it is chosen with the partition as in
/// [`fit_pwa_by_rollouts`].
///
/// # Errors
/// Those of the recipe, of reading and of identifying.
pub fn fit_pwa(
    recipe: &Recipe,
    options: &Options,
    purge: Option<f64>,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    let rule = (!open_spans(recipe).is_empty()).then(|| RolloutRule::new(HORIZON));
    fit(recipe, options, (purge, rule), &logs.into(), progress)
}

/// [`fit_pwa`], where the partition (and the spans that are open) are those whose rollouts on spans that did not train err least: the models that are compared are
/// fitted on the training rows of each fold.
///
/// # Errors
/// Those of [`fit_pwa`]; held-out spans shorter than the rollouts; every candidate diverges.
pub fn fit_pwa_by_rollouts(
    recipe: &Recipe,
    options: &Options,
    purge: Option<f64>,
    rule: RolloutRule,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    fit(recipe, options, (purge, Some(rule)), &logs.into(), progress)
}

fn fit(
    recipe: &Recipe,
    options: &Options,
    (purge, rule): (Option<f64>, Option<RolloutRule>),
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    let mut options = with_partitions(recipe, options)?;
    let (dataset, mut task) = Dataset::for_recipe(&settled(recipe, None), &labels(&options), logs, progress)?;
    if let (Some(seconds), true) = (purge, dataset.step() > 0.0) {
        options.purge = Some(options.purge.unwrap_or(0).max((seconds / dataset.step()).ceil() as usize));
    }
    let view = dataset.view()?;
    let mut used = recipe.clone();
    let mut rollouts = None;
    if let Some(rule) = rule {
        let choice = by_rollouts(recipe, &task.problem, &options, &view, rule, progress)?;
        let over = choice.candidates[choice.chosen].over;
        options.selection = Selection::Given(choice.chosen % options.partitions.len());
        (task.problem, used) = (spanned(recipe, &task.problem, over), settled(recipe, over));
        rollouts = Some(choice);
    }
    let found = fleetfoot_pwa::identify(&task.problem, &options, &view, progress);
    let mut identification =
        found.map_err(|error| not_finite::with_reasons(error.into(), &dataset, functions(&task)))?;
    refuse_not_finite(&identification.model)?;
    let text = used.to_toml();
    for model in std::iter::once(&mut identification.model).chain(&mut identification.models) {
        model.training.recipe.clone_from(&text);
    }
    let mut notes = dataset.notes().to_vec();
    notes.extend(left_out(identification.incomplete, &dataset, functions(&task))?);
    notes.append(&mut identification.notes);
    Ok(Fitted { identification, episodes: dataset.episodes().len(), files: logs.len(), rollouts, notes })
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
    let held = HeldOut::new(source, rule)?;
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

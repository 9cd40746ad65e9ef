//! From logs, or from their statistic, to a sparse model of shared latents.

mod frequencies;
mod influence;
mod intervals;
mod lambda;
mod limits;
mod model;
mod options;
mod problem;
mod report;
mod shown_path;
mod solve;
mod support;

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use fleetfoot_data::{EpisodeId, Progress, Source};
use fleetfoot_dataset::{Dataset, Logs, StatisticFile, condition::refuse_other_rows, open::OpenedStructure};
use fleetfoot_model::{Equation, Model};
use fleetfoot_recipe::{Recipe, RequestError};
use fleetfoot_sparse::{
    bolasso::refit,
    inference::{Clusters, clustered_covariance},
    select::{Folds, held_out_refit},
};
use fleetfoot_stats::{Concentration, Key, SquareRoot};
use fleetfoot_task::StructuredTask;
pub use frequencies::write_frequencies;
pub use influence::{EpisodeInfluence, LeaveOneOutReport};
pub use lambda::LambdaChoice;
use limits::Limited;
pub use options::{LambdaRule, Resampled, SparseOptions};
use problem::Problem;
use report::Price;
pub use report::{CandidateReport, LatentReport, SparseReport, TaskReport};
pub use shown_path::PathReport;
pub use solve::{SolveMethod, Solved, solve_statistic};

use crate::{
    concentration,
    error::Error,
    folds::smoothed_rows,
    model_file::refuse_not_finite,
    not_finite, radial,
    statistic::{LabelKey, ScanOptions, scan, scan_tasks},
    subset::Subset,
};

/// Episodes from which on they are the clusters of the standard errors, and the units of stability selection; with fewer, chunks are.
const ENOUGH_EPISODES: usize = 10;

/// What is fitted on what, beside what the recipe says.
#[derive(Debug, Clone, Default)]
pub struct SparseRequest {
    /// Labels of episodes from the files' paths.
    pub keys: Vec<LabelKey>,
    /// A model for every value of this label.
    pub by: Option<String>,
    /// Where the statistic of the pass is written, to be fitted again without a pass.
    pub keep: Option<PathBuf>,
    /// Whether every episode is left out once, to tell what it does to the fit.
    pub influence: bool,
}

/// A sparse model, and how it came about.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SparseFitted {
    /// The value of the label that the rows have, where models are fitted by label.
    pub value: Option<String>,
    /// The model.
    pub model: Model,
    /// Scores, coefficients, certificates.
    pub report: SparseReport,
}

/// What is fitted: a statistic, what the recipe means for it, and the rows where they are needed and at hand.
struct Evidence {
    file: StatisticFile,
    task: StructuredTask,
    /// The recipe with all flags, as the model will carry it.
    recipe: Recipe,
    rows: Option<Dataset>,
    notes: Vec<String>,
}

/// Fits sparse models to logs, or to one `.stats` file without a pass: one, or one for every value of a label.
///
/// # Errors
/// Those of the recipe, of reading, and of the solvers; a question that needs rows asked of a statistic.
pub fn fit_sparse(
    recipe: &Recipe,
    request: &SparseRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Vec<SparseFitted>, Error> {
    let logs = &logs.into();
    // What is wrong with the options is said before the pass.
    SparseOptions::new(&recipe.sparse)?;
    radial::refuse(recipe, "fit sparse")?;
    let evidence = if logs.is_statistic() {
        if request.keep.is_some() {
            return Err(Error::needs_rows(
                "--keep writes the statistic of logs, and this is one already; leave it away".into(),
            ));
        }
        Evidence::of_statistic(recipe, logs)?
    } else {
        Evidence::of_logs(recipe, request, logs, progress)?
    };
    refuse_bounds_without_latents(&evidence.recipe)?;
    let options = SparseOptions::new(&evidence.recipe.sparse)?;
    let all: BTreeSet<EpisodeId> = evidence.file.episodes.iter().map(|episode| episode.id).collect();
    let reasons = |error| if logs.is_statistic() { error } else { evidence.with_reasons(error, logs, progress) };
    let Some(label) = &request.by else {
        let found = evidence.fit(&options, None, &all, request.influence, progress);
        return evidence.kept(request, vec![found.map_err(reasons)?]);
    };
    let mut fitted = Vec::new();
    for (value, episodes) in by_label(&evidence.file, label)? {
        let found = evidence.fit(&options, Some(value.clone()), &episodes, request.influence, progress);
        fitted.push(found.map_err(|error| match error {
            Error::Request(RequestError { cause, message }) => {
                reasons(Error::Request(RequestError { cause, message: format!("{label} = {value}: {message}") }))
            }
            other => other,
        })?);
    }
    evidence.kept(request, fitted)
}

impl Evidence {
    /// Writes the statistic, where it is to be kept: after the fits, so that those that fail or are stopped write nothing.
    fn kept(&self, request: &SparseRequest, fitted: Vec<SparseFitted>) -> Result<Vec<SparseFitted>, Error> {
        if let Some(path) = &request.keep {
            self.file.write(path)?;
        }
        Ok(fitted)
    }

    /// An error of too few rows with the columns that lack values in the logs.
    fn with_reasons(&self, error: Error, logs: &Logs, progress: &dyn Progress) -> Error {
        if !not_finite::is_too_few(&error) {
            return error;
        }
        let explained =
            |error, dataset: &Dataset| not_finite::with_reasons(error, dataset, self.task.expressions().cloned());
        match &self.rows {
            Some(dataset) => explained(error, dataset),
            None => match Dataset::for_structure(&self.recipe, logs, progress) {
                Ok(opened) => explained(error, &opened.dataset),
                Err(_) => error,
            },
        }
    }
}

/// Refuses bounds of coefficients that have no latent: those of an equation's own are kept by `fit sindy`.
fn refuse_bounds_without_latents(recipe: &Recipe) -> Result<(), Error> {
    match recipe.constraints.keys().next().filter(|_| recipe.latents.is_empty()) {
        Some(name) => Err(Error::missing(format!(
            "[constraints] {name}: it is about latents, and there are none; write what the unknown functions are in [latents] and [tasks], or run `fit sindy`, which \
             bounds the coefficients of equations"
        ))),
        None => Ok(()),
    }
}

/// The episodes of every value of a label, in the order of the values.
fn by_label(file: &StatisticFile, label: &str) -> Result<Vec<(String, BTreeSet<EpisodeId>)>, Error> {
    let mut groups: std::collections::BTreeMap<Natural, BTreeSet<EpisodeId>> = std::collections::BTreeMap::new();
    for episode in &file.episodes {
        let value = episode.labels.get(label).ok_or_else(|| {
            let known: BTreeSet<&str> =
                file.episodes.iter().flat_map(|e| e.labels.keys().map(String::as_str)).collect();
            let known = if known.is_empty() {
                "no episode has labels; give them with --key 'NAME={dir1}' or [[episodes]]".to_owned()
            } else {
                format!("there are {}", known.into_iter().collect::<Vec<_>>().join(", "))
            };
            Error::unknown(label, format!("--by {label}: {} has no label `{label}`; {known}", episode.name))
        })?;
        groups.entry(Natural::of(value)).or_default().insert(episode.id);
    }
    Ok(groups.into_iter().map(|(value, episodes)| (value.text, episodes)).collect())
}

/// A label's value, in the order of numbers where it is one.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Natural {
    number: Option<i64>,
    text: String,
}

impl Natural {
    fn of(text: &str) -> Self {
        Self { number: text.parse().ok(), text: text.to_owned() }
    }
}

impl Evidence {
    fn of_statistic(recipe: &Recipe, logs: &Logs) -> Result<Self, Error> {
        let file = logs.statistic()?;
        // Without a recipe that of the scan holds, with the flags above it.
        let says_nothing = recipe.states.is_empty() && recipe.latents.is_empty() && recipe.model.predict.is_none();
        let scanned = Recipe::parse(&file.recipe, "the recipe of the statistic")?;
        refuse_other_rows(recipe, &scanned)?;
        let mut recipe = recipe.clone();
        recipe.time.only = scanned.time.only;
        if says_nothing {
            let (mut own, _) = file.task()?;
            own.say(recipe.sparse);
            recipe = own;
        }
        let task = file.resolve(&recipe)?;
        Ok(Self { file, task, recipe, rows: None, notes: Vec::new() })
    }

    fn of_logs(recipe: &Recipe, request: &SparseRequest, logs: &Logs, progress: &dyn Progress) -> Result<Self, Error> {
        let scan_options = ScanOptions { keys: request.keys.clone(), ..ScanOptions::default() };
        // A statistic that is kept serves `fit sindy` and `fit pwa` too.
        let (file, report) = match &request.keep {
            Some(_) => scan(recipe, &scan_options, None, logs, progress)?,
            None => scan_tasks(recipe, &scan_options, logs, progress)?,
        };
        let task = file.resolve(recipe)?;
        let options = SparseOptions::new(&recipe.sparse)?;
        let bounded = task.limits.iter().any(|limit| !limit.is_constant(&task.regression));
        let rows = if bounded || matches!(options.bolasso, Some((Resampled::Rows, _))) {
            let OpenedStructure { dataset, .. } = Dataset::for_structure(recipe, logs, progress)?;
            Some(dataset)
        } else {
            None
        };
        let mut notes = report.notes;
        notes.extend(report.skipped.into_iter().map(|skipped| format!("left out: {skipped}")));
        Ok(Self { file, task, recipe: recipe.clone(), rows, notes })
    }

    /// Fits the rows of some episodes; `left_out`: and without each of them.
    fn fit(
        &self,
        options: &SparseOptions,
        value: Option<String>,
        episodes: &BTreeSet<EpisodeId>,
        left_out: bool,
        progress: &dyn Progress,
    ) -> Result<SparseFitted, Error> {
        let wanted = |key: &Key| episodes.contains(&key.episode);
        let problem = Problem::new(&self.task, &self.file, options, wanted)?;
        let mut notes = self.notes.clone();
        notes.extend(options::unused(&self.recipe.sparse, options));
        notes.extend(self.concentrated());
        let view = self.rows.as_ref().map(Dataset::view).transpose()?;
        // A log that was given twice is in the statistic once.
        let subset = view.as_ref().map(|view| {
            let mut seen = BTreeSet::new();
            let of = |at: &usize| {
                let id = view.episodes()[*at].id;
                episodes.contains(&id) && seen.insert(id)
            };
            Subset::new(view, (0..view.episodes().len()).filter(of).collect())
        });
        let source = subset.as_ref().map(|subset| subset as &dyn Source);
        progress.stage("lambda");
        let smoothed = smoothed_rows(self.recipe.time.smoothed, self.file.step());
        let folds = lambda::folds(&problem, options, smoothed, &mut notes)?;
        progress.expect(options.work(problem.structure.coefficients(), folds.as_ref().map_or(0, Folds::len)));
        let lambda = lambda::choose(&problem, options, folds.as_ref(), &mut notes, progress)?;
        let mut support = support::select(&problem, &self.file, options, lambda.value, source, progress)?;
        notes.append(&mut support.notes);
        let Problem { structure, banks, assembly, roots, .. } = &problem;
        let free = |roots: &[SquareRoot]| Ok::<_, Error>(refit(structure, roots, assembly, &support.columns)?);
        let limited = limits::within_limits(&problem, &support.columns, source, &mut notes, progress)?;
        if limited.is_some() && left_out {
            notes.push("influence of episodes: the fits with and without them are those without the bounds".into());
        }
        let fit = |roots: &[SquareRoot]| limited.as_ref().map_or_else(|| free(roots), |limited| limited.refit(roots));
        let held_out =
            folds.as_ref().map(|folds| held_out_refit(structure, banks, folds, fit, progress)).transpose()?;
        let price = match &limited {
            None => None,
            Some(_) => {
                let held_out = folds.as_ref().map(|folds| held_out_refit(structure, banks, folds, free, progress));
                Some(Price { free: free(roots)?, held_out: held_out.transpose()? })
            }
        };
        let theta = limited.as_ref().map_or_else(|| free(roots), |limited| Ok(limited.coefficients()))?;
        let errors = standard_errors(&problem, &theta, &mut notes);
        let influence = if left_out {
            influence::leave_one_out(&problem, &self.file, &theta, errors.as_deref(), &mut notes, progress)?
        } else {
            None
        };
        let method = format!("sparse {}", support.method);
        let recipe = self.recipe.to_toml();
        let model = model::model(&problem, &self.file, &theta, &method, &recipe, options.seed, wanted);
        refuse_not_finite(&model)?;
        let counts = episodes.iter().filter_map(|id| self.file.scanned.rows.get(id));
        let (at_border, incomplete) =
            counts.fold((0, 0), |sum, rows| (sum.0 + rows.at_border, sum.1 + rows.incomplete));
        let tasks = report::tasks(&problem, &theta, held_out.as_deref(), price.as_ref());
        let limits = limited.as_ref().map_or_else(Vec::new, Limited::report);
        let left_out = [at_border, incomplete];
        let report = SparseReport::new(&problem, lambda, &support, (&theta, errors.as_deref()), left_out, notes)?;
        Ok(SparseFitted { value, model, report: SparseReport { influence, tasks, limits, ..report } })
    }
}

impl Evidence {
    /// What to say of equations whose targets' variance few rows hold.
    fn concentrated(&self) -> Vec<String> {
        // The first moments are those of the fitted equations' targets.
        let fitted = self.task.equations.iter().filter(|equation| equation.target.is_some());
        let labels: Vec<String> = fitted.map(Equation::label).collect();
        let of = |target| Concentration::of(&self.file.scanned.also, target, self.file.plan.chunk_rows);
        let found: Vec<Option<Concentration>> = (0..labels.len()).map(of).collect();
        let name = |id| self.file.episode(id).map(|episode| episode.name.clone());
        concentration::notes(labels.into_iter().zip(found.iter().map(Option::as_ref)), name)
    }
}

/// Standard error of every coefficient (p; NaN outside the support), clustered by episode where there are enough, else by chunk.
fn standard_errors(problem: &Problem<'_>, theta: &[f64], notes: &mut Vec<String>) -> Option<Vec<f64>> {
    let clusters = if problem.episodes() >= ENOUGH_EPISODES { Clusters::Episodes } else { Clusters::Chunks };
    match clustered_covariance(&problem.banks, &problem.structure, &problem.assembly, theta, clusters) {
        Ok(found) => {
            let mut errors = vec![f64::NAN; theta.len()];
            found.support.iter().zip(&found.errors).for_each(|(&j, &error)| errors[j] = error);
            Some(errors)
        }
        Err(error) => {
            notes.push(format!("no standard errors: {error}"));
            None
        }
    }
}

/// The file of a model that was fitted for one value of a label: `model.json` and `3` make `model_3.json`.
pub fn file_by_value(model: &Path, value: &str) -> PathBuf {
    let stem = model.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
    let name: String = value.chars().map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '-' }).collect();
    let extension = model.extension().map_or_else(|| "json".into(), |extension| extension.to_string_lossy());
    model.with_file_name(format!("{stem}_{name}.{extension}"))
}

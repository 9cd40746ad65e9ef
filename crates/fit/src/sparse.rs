//! Sparse models of latent functions, which equations may share.

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

use std::{collections::BTreeSet, sync::Arc};

use fleetfoot_data::setting::{BY, CONSTRAINTS, EPISODES, FIT_SINDY, KEEP, KEY, LATENTS, TASKS};
use fleetfoot_data::{EpisodeId, Progress, Source};
use fleetfoot_dataset::{
    ContentHash, Dataset, Logs, StatisticFile, condition::refuse_other_rows, open::OpenedStructure,
};
use fleetfoot_library::Expr;
use fleetfoot_model::{Equation, Model};
use fleetfoot_recipe::{Recipe, RequestError};
use fleetfoot_sparse::{
    bolasso::refit,
    inference::{Clusters, clustered_covariance},
    select::{Folds, held_out_refit},
};
use fleetfoot_stats::{Concentration, Key, SquareRoot};
use fleetfoot_sums::structured::Plan;
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
    error::Error,
    folds::smoothed_rows,
    method::{Data, FitRequest, Fitted, Method, RowFacts},
    not_finite,
    objective::Refinement,
    plan::FitPlan,
    radial,
    statistic::{PlannedLatent, ScanOptions, default_chunk, plan_scan, row_expressions, scan, scan_tasks},
    subset::Subset,
    summary::FitSummary,
};

/// Episodes from which on they are the clusters of the standard errors, and the units of stability selection; with fewer, chunks are.
const ENOUGH_EPISODES: usize = 10;

/// `fit sparse`: one model, or one for every value of a label.
#[derive(Debug, Clone)]
pub struct Sparse {
    options: SparseOptions,
    request: FitRequest,
    /// The logs that were scanned; a statistic has none.
    logs: Option<Logs>,
}

/// The statistic, and the rows where they are needed and at hand.
pub struct Sums {
    file: Arc<StatisticFile>,
    dataset: Option<Dataset>,
}

/// A model, and its report.
pub struct Solution {
    value: Option<String>,
    model: Model,
    report: SparseReport,
    facts: RowFacts,
    notes: Vec<String>,
}

impl Method for Sparse {
    const NAME: &'static str = "sparse";
    type Report = SparseReport;
    type Task = StructuredTask;
    type Sums = Sums;
    type Solution = Solution;

    fn new(recipe: &Recipe, request: &FitRequest) -> Result<Self, Error> {
        radial::refuse(recipe, "fit sparse")?;
        Ok(Self { options: SparseOptions::new(&recipe.sparse)?, request: request.clone(), logs: None })
    }

    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error> {
        let plan = plan_scan(recipe, &self.scanned(), logs.clone(), progress)?;
        let coefficients = plan.latents.iter().map(|latent| latent.functions).sum();
        let latents = plan.latents.iter().map(|PlannedLatent { name, functions }| format!("{name} ({functions})"));
        let latents = latents.collect::<Vec<_>>().join(", ");
        let chunks = format!("{} chunks of at most {} rows", plan.chunks, plan.chunk_rows);
        Ok(FitPlan {
            equations: plan.tasks,
            candidates: coefficients,
            regions: 1,
            passes: 1,
            simulations: self.simulations(),
            smoothing: None,
            memory: plan.bytes,
            work: self.options.planned_work(coefficients, plan.reading.episodes),
            details: vec![format!("latents and their functions: {latents}"), chunks],
            reading: plan.reading,
            notes: plan.notes,
        })
    }

    fn open(
        &mut self,
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<(Dataset, StructuredTask), Error> {
        let OpenedStructure { dataset, task, .. } = Dataset::for_structure(recipe, logs, progress)?;
        Ok((dataset, task))
    }

    fn scan(
        &mut self,
        recipe: &Recipe,
        logs: &Logs,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Option<StatisticFile>, Error> {
        // A statistic that is kept serves `fit sindy` and `fit pwa` too.
        let (file, report) = match &self.request.keep {
            Some(_) => scan(recipe, &self.scanned(), None, logs.clone(), progress)?,
            None => scan_tasks(recipe, &self.scanned(), logs, progress)?,
        };
        notes.extend(report.notes);
        notes.extend(report.skipped.into_iter().map(|skipped| format!("left out: {skipped}")));
        self.logs = Some(logs.clone());
        Ok(Some(file))
    }

    /// Without a recipe that of the scan holds, with the flags above it.
    fn above(recipe: &Recipe, scanned: &Recipe, file: &StatisticFile, _: &mut Vec<String>) -> Result<Recipe, Error> {
        let says_nothing = recipe.states.is_empty() && recipe.latents.is_empty() && recipe.model.predict.is_none();
        refuse_other_rows(recipe, scanned)?;
        if says_nothing {
            let (mut task, _) = file.task()?;
            task.override_with(recipe.sparse.clone());
            return Ok(task);
        }
        let mut recipe = recipe.clone();
        recipe.time.only.clone_from(&scanned.time.only);
        Ok(recipe)
    }

    fn of_statistic(
        &self,
        recipe: &Recipe,
        _: &Recipe,
        file: &Arc<StatisticFile>,
        _: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<(StructuredTask, Sums), Error> {
        if self.logs.is_none() && self.request.keep.is_some() {
            return Err(Error::needs_rows(format!(
                "{KEEP} writes the statistic of logs, and the input is a statistic already; remove it"
            )));
        }
        refuse_bounds_without_latents(recipe)?;
        let task = file.resolve(recipe)?;
        let bounded = task.limits.iter().any(|limit| !limit.is_constant(&task.regression));
        let needs_rows = bounded || matches!(self.options.bolasso, Some((Resampled::Rows, _)));
        let dataset = match self.logs.as_ref().filter(|_| needs_rows) {
            Some(logs) => Some(Dataset::for_structure(recipe, logs, progress)?.dataset),
            None => None,
        };
        Ok((task, Sums { file: file.clone(), dataset }))
    }

    fn sum(&self, data: Data<'_, StructuredTask>, _: &mut Vec<String>, progress: &dyn Progress) -> Result<Sums, Error> {
        let (task, rows) = (data.task, data.rows()?);
        let plan = Plan::new(task.regression.clone(), task.also.clone(), default_chunk(task, rows.rows()), rows)?;
        let mut file = StatisticFile::empty(plan, data.recipe, task, rows.columns());
        file.scanned = file.plan.scan(rows, progress)?;
        for (number, episode) in rows.episodes().iter().enumerate() {
            file.add_episode(episode, ContentHash([0; 32]), number as u32, episode.labels.clone());
        }
        file.arrange();
        Ok(Sums { file: Arc::new(file), dataset: None })
    }

    fn find(
        &self,
        data: Data<'_, StructuredTask>,
        sums: &Sums,
        _: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<Solution>, Error> {
        let evidence = Evidence { method: self, data, sums };
        let all: BTreeSet<EpisodeId> = sums.file.episodes.iter().map(|episode| episode.id).collect();
        let mut fitted = Vec::new();
        match &self.request.by {
            None => {
                fitted.push(evidence.fit(None, &all, progress).map_err(|error| evidence.with_reasons(error, progress))?)
            }
            Some(label) => {
                for (value, episodes) in by_label(&sums.file, label)? {
                    let evidence_of_fit = evidence.fit(Some(value.clone()), &episodes, progress);
                    fitted.push(evidence_of_fit.map_err(|error| match error {
                        Error::Request(RequestError { cause, message }) => {
                            let message = format!("{label} = {value}: {message}");
                            evidence.with_reasons(Error::Request(RequestError { cause, message }), progress)
                        }
                        other => other,
                    })?);
                }
            }
        }
        // After the fits, so that those that fail or are stopped write nothing.
        if let Some(path) = &self.request.keep {
            sums.file.write(path)?;
        }
        Ok(fitted)
    }

    fn model(solution: &Solution) -> &Model {
        &solution.model
    }

    /// One step alone is fitted, whose coefficients stay.
    fn refine(&self, _: Data<'_, StructuredTask>, _: &Sums, _: &mut Solution, _: &mut Refinement) -> Result<(), Error> {
        Ok(())
    }

    fn expressions(&self, task: &StructuredTask) -> Vec<Expr> {
        row_expressions(task).cloned().collect()
    }

    fn facts(&self, _: Data<'_, StructuredTask>, _: &Sums, solution: &Solution) -> RowFacts {
        solution.facts.clone()
    }

    fn report(
        &self,
        _: Data<'_, StructuredTask>,
        _: &Sums,
        solution: Solution,
        mut summary: FitSummary,
        _: &dyn Progress,
    ) -> Result<Fitted<SparseReport>, Error> {
        summary.notes.extend(solution.notes);
        let report = SparseReport { summary, ..solution.report };
        Ok(Fitted { value: solution.value, model: solution.model, rivals: Vec::new(), report })
    }
}

impl Sparse {
    fn scanned(&self) -> ScanOptions {
        ScanOptions { keys: self.request.keys.clone(), ..ScanOptions::default() }
    }
}

/// A statistic, and the task of its recipe.
struct Evidence<'a> {
    method: &'a Sparse,
    data: Data<'a, StructuredTask>,
    sums: &'a Sums,
}

impl Evidence<'_> {
    /// An error of too few rows with the columns that lack values in the logs.
    fn with_reasons(&self, error: Error, progress: &dyn Progress) -> Error {
        let Some(logs) = self.method.logs.as_ref().filter(|_| not_finite::is_too_few(&error)) else { return error };
        let explained =
            |error, dataset: &Dataset| not_finite::with_reasons(error, dataset, self.data.task.expressions().cloned());
        match &self.sums.dataset {
            Some(dataset) => explained(error, dataset),
            None => match Dataset::for_structure(self.data.recipe, logs, progress) {
                Ok(opened) => explained(error, &opened.dataset),
                Err(_) => error,
            },
        }
    }

    /// Fits the rows of some episodes.
    fn fit(
        &self,
        value: Option<String>,
        episodes: &BTreeSet<EpisodeId>,
        progress: &dyn Progress,
    ) -> Result<Solution, Error> {
        let (options, file, recipe) = (&self.method.options, &*self.sums.file, self.data.recipe);
        let left_out = self.method.request.influence;
        let wanted = |key: &Key| episodes.contains(&key.episode);
        let problem = Problem::new(self.data.task, file, options, wanted)?;
        let mut notes: Vec<String> = options::unused(&recipe.sparse, options).into_iter().collect();
        let view = self.sums.dataset.as_ref().map(Dataset::view).transpose()?;
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
        let smoothed = smoothed_rows(recipe.time.smoothed, file.step());
        let folds = lambda::folds(&problem, options, smoothed, &mut notes)?;
        progress.expect(options.work(problem.structure.coefficients(), folds.as_ref().map_or(0, Folds::len)));
        let lambda = lambda::choose(&problem, options, folds.as_ref(), &mut notes, progress)?;
        let mut support = support::select(&problem, file, options, lambda.value, source, progress)?;
        notes.append(&mut support.notes);
        let Problem { structure, banks, assembly, roots, .. } = &problem;
        let free = |roots: &[SquareRoot]| Ok::<_, Error>(refit(structure, roots, assembly, &support.columns)?);
        let limited = limits::within_limits(&problem, &support.columns, source, &mut notes, progress)?;
        if limited.is_some() && left_out {
            notes.push("influence of episodes: computed from fits without the bounds".into());
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
            influence::leave_one_out(&problem, file, &theta, errors.as_deref(), &mut notes, progress)?
        } else {
            None
        };
        let method = format!("sparse {}", support.method);
        let model = model::model(&problem, file, &theta, &method, &recipe.to_toml(), options.seed, wanted);
        let counts = episodes.iter().filter_map(|id| file.scanned.rows.get(id));
        let (at_border, incomplete) =
            counts.fold((0, 0), |sum, rows| (sum.0 + rows.at_border, sum.1 + rows.incomplete));
        let tasks = report::tasks(&problem, &theta, held_out.as_deref(), price.as_ref());
        let limits = limited.as_ref().map_or_else(Vec::new, Limited::report);
        let facts = RowFacts {
            episodes: problem.episodes(),
            left_out: vec![at_border, incomplete],
            concentrated: self.concentrated(),
        };
        let report = SparseReport::new(&problem, lambda, &support, (&theta, errors.as_deref()))?;
        Ok(Solution { value, model, report: SparseReport { influence, tasks, limits, ..report }, facts, notes })
    }

    /// Of every fitted equation, the few rows that hold most of its target's variance, where they do.
    fn concentrated(&self) -> Vec<(String, Option<Concentration>)> {
        // The first moments are those of the fitted equations' targets.
        let fitted = self.data.task.equations.iter().filter(|equation| equation.target.is_some());
        let file = &self.sums.file;
        let of = |target| Concentration::of(&file.scanned.also, target, file.plan.chunk_rows);
        fitted.map(Equation::label).enumerate().map(|(target, label)| (label, of(target))).collect()
    }
}

/// Refuses bounds of coefficients that have no latent: those of an equation's own are kept by `fit sindy`.
fn refuse_bounds_without_latents(recipe: &Recipe) -> Result<(), Error> {
    match recipe.constraints.keys().next().filter(|_| recipe.latents.is_empty()) {
        Some(name) => Err(Error::missing(format!(
            "{entry}: it applies to latents, and the recipe has none; write the unknown functions in {LATENTS} and {TASKS}, or run {FIT_SINDY}, which \
             bounds the coefficients of equations",
            entry = CONSTRAINTS.entry(name)
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
                format!("no episode has labels; give them with {} or {EPISODES}", KEY.to("NAME={dir1}"))
            } else {
                format!("there are {}", known.into_iter().collect::<Vec<_>>().join(", "))
            };
            Error::unknown(
                label,
                format!("{given_by}: {} has no label `{label}`; {known}", episode.name, given_by = BY.to(label)),
            )
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

/// Standard error of every coefficient (p; NaN outside the support), clustered by episode where there are enough, else by chunk.
fn standard_errors(problem: &Problem<'_>, theta: &[f64], notes: &mut Vec<String>) -> Option<Vec<f64>> {
    let clusters = if problem.episodes() >= ENOUGH_EPISODES { Clusters::Episodes } else { Clusters::Chunks };
    match clustered_covariance(&problem.banks, &problem.structure, &problem.assembly, theta, clusters) {
        Ok(clustered_covariance) => {
            let mut errors = vec![f64::NAN; theta.len()];
            clustered_covariance
                .support
                .iter()
                .zip(&clustered_covariance.errors)
                .for_each(|(&j, &error)| errors[j] = error);
            Some(errors)
        }
        Err(error) => {
            notes.push(format!("no standard errors: {error}"));
            None
        }
    }
}

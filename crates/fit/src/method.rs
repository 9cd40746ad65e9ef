//! Trait of a fitting method: the steps that the common pipeline ([`crate::fit`]) calls.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::{Dataset, Logs, StatisticFile, json::report};
use fleetfoot_library::Expr;
use fleetfoot_model::Model;
use fleetfoot_output::together;
use fleetfoot_recipe::{Objective, Recipe};
use fleetfoot_stats::Concentration;
use serde::Serialize;
use serde_json::Value;

use crate::{
    beneath::beneath,
    error::Error,
    label_key::LabelKey,
    model_file::write_model,
    objective::{Beginning, Refinement, simulation_cost},
    plan::FitPlan,
    rollout_choice::{RolloutRule, settled},
    spans::Spans,
    summary::FitSummary,
};

/// Options of a fit that the recipe does not have.
#[derive(Debug, Clone, Default)]
pub struct FitRequest {
    /// True to return the models of the other candidates too: of `pwa` those of all partitions, of `sindy` and `narx`
    /// those of the front of error against number of terms.
    pub rivals: bool,
    /// Steps of the rollouts that choose open spans of derivatives (`over = "auto"`) in `fit sindy`; [`crate::USUAL_HORIZON`] when not given.
    pub horizon: Option<usize>,
    /// Files that `fit narx` runs the model on, and that do not train.
    pub free_run: Logs,
    /// Labels of episodes from the files' paths, for `fit sparse`.
    pub keys: Vec<LabelKey>,
    /// `fit sparse` fits a model for every value of this label.
    pub by: Option<String>,
    /// File in which `fit sparse` keeps the statistic of its pass, so that a later fit needs no pass.
    pub keep: Option<PathBuf>,
    /// True to leave every episode out once in `fit sparse` and report its influence on the fit.
    pub influence: bool,
}

/// A model, and how it came about.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Fitted<R> {
    /// The value of the label that the rows have, where models are fitted by label.
    pub value: Option<String>,
    /// The model.
    pub model: Model,
    /// The models of other candidates, on request ([`FitRequest::rivals`]).
    pub rivals: Vec<Rival>,
    /// Scores, candidates, certificates.
    pub report: R,
}

/// A model that competed with the chosen one.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Rival {
    /// Suffix of its file's name, after that of the chosen model: `kmeans10`, `terms3`.
    pub name: String,
    /// The model.
    pub model: Model,
}

impl Rival {
    /// Form of a candidate's name that a file's name allows: `kmeans:10` becomes `kmeans10`.
    pub(crate) fn part(candidate: &str) -> String {
        let kept = candidate.chars().filter(|&c| c != ':');
        kept.map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '-' }).collect()
    }
}

impl<R> Fitted<R> {
    /// The file of this model, where that of a fit is `model`: `model.json`, and for the value 3 of a label `model_3.json`.
    pub fn file(&self, model: &Path) -> PathBuf {
        self.value.as_ref().map_or_else(|| model.to_owned(), |value| beside(model, &Rival::part(value)))
    }

    /// The files of this model and its rivals: beside `model.json` there is `model_kmeans10.json`.
    pub fn files(&self, model: &Path) -> Vec<PathBuf> {
        let file = self.file(model);
        let rivals: Vec<PathBuf> = self.rivals.iter().map(|rival| beside(&file, &rival.name)).collect();
        std::iter::once(file).chain(rivals).collect()
    }

    /// Writes the model and its rivals, all or none, and returns the files.
    ///
    /// # Errors
    /// Those of writing.
    pub fn write(&self, model: &Path) -> Result<Vec<PathBuf>, Error> {
        let files = self.files(model);
        let models = std::iter::once(&self.model).chain(self.rivals.iter().map(|rival| &rival.model));
        together(|| files.iter().zip(models).try_for_each(|(path, model)| write_model(model, path)))?;
        Ok(files)
    }
}

/// The file of a candidate beside that of the chosen model: `model.json` and `kmeans:10` make `model_kmeans10.json`.
pub fn rival_file(model: &Path, candidate: &str) -> PathBuf {
    beside(model, &Rival::part(candidate))
}

fn beside(model: &Path, name: &str) -> PathBuf {
    let stem = model.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
    let extension = model.extension().map_or_else(|| "json".into(), |extension| extension.to_string_lossy());
    model.with_file_name(format!("{stem}_{name}.{extension}"))
}

/// Data of a fit, and its task. Without rows, sums of a statistic stand for them.
pub struct Data<'a, T> {
    /// The recipe that the model carries.
    pub recipe: &'a Recipe,
    /// Targets and regressors.
    pub task: &'a T,
    /// The rows that train.
    pub rows: Option<&'a dyn Source>,
    /// Rows that are kept back to test the model.
    pub kept: Option<&'a dyn Source>,
    /// Sampling period of these rows, seconds; 0 without a clock.
    pub step: f64,
}

impl<T> Clone for Data<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Data<'_, T> {}

impl<'a, T> Data<'a, T> {
    /// The rows that train.
    ///
    /// # Errors
    /// A statistic stands for them.
    pub fn rows(&self) -> Result<&'a dyn Source, Error> {
        self.rows.ok_or_else(|| Error::needs_rows("a statistic has no rows: give the logs".into()))
    }
}

/// Logs that were opened for a fit.
pub struct Opened<T> {
    /// The recipe that the model carries.
    pub recipe: Recipe,
    /// Targets and regressors.
    pub task: T,
    /// The rows.
    pub dataset: Dataset,
}

/// Report of a fit.
pub trait FitReport: Serialize + Send + Sized {
    /// The part of the report that all methods share.
    fn summary(&self) -> &FitSummary;

    /// The report for programs.
    fn to_json(&self) -> Value {
        report(self)
    }
}

/// Facts about the rows of a fit.
#[derive(Debug, Clone, Default)]
pub struct RowFacts {
    /// Episodes that trained.
    pub episodes: usize,
    /// Rows left out: at the border of an episode, with a missing value and, where there are regions, in none of them.
    pub left_out: Vec<u64>,
    /// Of every target, the few rows that hold most of its variance, where they do.
    pub concentrated: Vec<(String, Option<Concentration>)>,
}

/// A method of fitting: its candidates, and the solution of one of them. Everything else is the pipeline's
/// ([`crate::fit`]).
pub trait Method: Sized {
    /// Its name on the command line: `fit NAME`.
    const NAME: &'static str;
    /// Report of the fit.
    type Report: FitReport;
    /// The recipe, resolved for some columns.
    type Task: Clone;
    /// Sums over the rows, made before the first candidate is solved.
    type Sums;
    /// The candidates, solved, and the one that was chosen.
    type Solution;

    /// Reads the method's settings from the recipe.
    ///
    /// # Errors
    /// Words and numbers that are not allowed, with those that are.
    fn new(recipe: &Recipe, request: &FitRequest) -> Result<Self, Error>;

    /// Plan of the fit: data to read, statistics to keep, and work.
    ///
    /// # Errors
    /// Those of the recipe and of opening.
    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error>;

    /// Objective of the coefficients.
    fn objective(&self) -> Objective {
        Objective::OneStep
    }

    /// Extra work of a fit to simulations, in words; `None` for the objective of one step.
    fn simulations(&self) -> Option<String> {
        simulation_cost(self.objective(), 1, false)
    }

    /// Opens logs and resolves the recipe against their columns.
    ///
    /// # Errors
    /// Those of the recipe and of opening.
    fn open(&mut self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Dataset, Self::Task), Error>;

    /// Scans logs to a statistic that stands for them, where sums are all that the method needs.
    ///
    /// # Errors
    /// Those of the recipe, of reading and of scanning.
    fn scan(
        &mut self,
        _recipe: &Recipe,
        _logs: &Logs,
        _notes: &mut Vec<String>,
        _progress: &dyn Progress,
    ) -> Result<Option<StatisticFile>, Error> {
        Ok(None)
    }

    /// The recipe of a fit of a statistic: the fit's settings above the recipe of the scan.
    ///
    /// # Errors
    /// Another condition for rows; a question that needs rows.
    fn above(
        recipe: &Recipe,
        scanned: &Recipe,
        _file: &StatisticFile,
        _notes: &mut Vec<String>,
    ) -> Result<Recipe, Error> {
        beneath(recipe, scanned)
    }

    /// The task and the sums of a statistic.
    ///
    /// # Errors
    /// A fit that needs rows, or sums that the statistic does not have.
    fn of_statistic(
        &self,
        recipe: &Recipe,
        scanned: &Recipe,
        file: &Arc<StatisticFile>,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<(Self::Task, Self::Sums), Error>;

    /// The recipe that the model carries, of the chosen span.
    fn carried(&self, recipe: &Recipe, over: Option<u32>) -> Recipe {
        settled(recipe, over)
    }

    /// Rule by which rollouts compare open spans of derivatives (`over = "auto"`) and, on request, candidates.
    fn rollouts(&self) -> Option<RolloutRule> {
        None
    }

    /// The task with its open spans settled; `None`: central differences.
    fn with_span(&self, _recipe: &Recipe, task: &Self::Task, _over: Option<u32>) -> Self::Task {
        task.clone()
    }

    /// The candidates that rollouts compare, by name, fitted to rows.
    ///
    /// # Errors
    /// Those of fitting.
    fn trials(&self, data: Data<'_, Self::Task>, progress: &dyn Progress) -> Result<Vec<(String, Model)>, Error> {
        let mut notes = Vec::new();
        let sums = self.sum(data, &mut notes, progress)?;
        let solutions = self.find(data, &sums, &mut notes, progress)?;
        Ok(solutions.iter().map(|solution| (Self::NAME.to_owned(), Self::model(solution).clone())).collect())
    }

    /// Takes the candidate of this index among the trials as chosen.
    fn take(&mut self, _trial: usize) {}

    /// The rows that train and those that are kept back to test, where not all of them train.
    ///
    /// # Errors
    /// Too few rows.
    fn split<'a>(&self, _rows: &'a dyn Source, _step: f64) -> Result<Option<[Spans<'a>; 2]>, Error> {
        Ok(None)
    }

    /// Rows of which one is kept.
    fn every(&self) -> usize {
        1
    }

    /// Sums rows.
    ///
    /// # Errors
    /// Those of reading; too few rows.
    fn sum(
        &self,
        data: Data<'_, Self::Task>,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self::Sums, Error>;

    /// Sums the logs of the fit, and settles the parts of the task that depend on their rows.
    ///
    /// # Errors
    /// Those of reading; too few rows.
    fn sum_logs(
        &self,
        opened: &mut Opened<Self::Task>,
        _logs: &Logs,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self::Sums, Error> {
        let view = opened.dataset.view()?;
        let (recipe, task, step) = (&opened.recipe, &opened.task, opened.dataset.step());
        self.sum(Data { recipe, task, rows: Some(&view), kept: None, step }, notes, progress)
    }

    /// Solves the candidates and chooses: one fit, or one a value of a label.
    ///
    /// # Errors
    /// Those of solving; too few rows.
    fn find(
        &self,
        data: Data<'_, Self::Task>,
        sums: &Self::Sums,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<Self::Solution>, Error>;

    /// The chosen model.
    fn model(solution: &Self::Solution) -> &Model;

    /// The model of one step that a fit to simulations begins with, and the set that it keeps.
    ///
    /// # Errors
    /// Those of posing the set.
    fn beginning(&self, _data: Data<'_, Self::Task>, solution: &Self::Solution) -> Result<Beginning, Error> {
        Ok((Self::model(solution).clone(), None))
    }

    /// The chosen candidate fitted to other rows, as a beginning.
    ///
    /// # Errors
    /// Those of fitting.
    fn again(
        &self,
        data: Data<'_, Self::Task>,
        _solution: &Self::Solution,
        progress: &dyn Progress,
    ) -> Result<Beginning, Error> {
        let mut models = self.trials(data, progress)?;
        let (_, model) = models.swap_remove(0);
        Ok((model, None))
    }

    /// The chosen candidate found again on rows, none of which it has seen, to be tested on later ones; `None` where nothing is held out, and of methods that have other tests.
    fn held_out_by_time(
        &self,
        _data: Data<'_, Self::Task>,
        _solution: &Self::Solution,
        _progress: &dyn Progress,
    ) -> Option<Result<Model, Error>> {
        None
    }

    /// The chosen candidate with the terms that all rows chose, its coefficients fitted to other rows.
    ///
    /// # Errors
    /// Those of fitting.
    fn same_terms(
        &self,
        data: Data<'_, Self::Task>,
        solution: &Self::Solution,
        progress: &dyn Progress,
    ) -> Result<Model, Error> {
        Ok(self.again(data, solution, progress)?.0)
    }

    /// Takes the coefficients of a fit to simulations if it is the better one, and reports their bounds.
    ///
    /// # Errors
    /// Those of posing the set that the coefficients keep.
    fn refine(
        &self,
        data: Data<'_, Self::Task>,
        sums: &Self::Sums,
        solution: &mut Self::Solution,
        refinement: &mut Refinement,
    ) -> Result<(), Error>;

    /// All expressions that a row needs a value of.
    fn expressions(&self, task: &Self::Task) -> Vec<Expr>;

    /// Facts about the rows.
    fn facts(&self, data: Data<'_, Self::Task>, sums: &Self::Sums, solution: &Self::Solution) -> RowFacts;

    /// The fit with its report.
    ///
    /// # Errors
    /// Those of scoring.
    fn report(
        &self,
        data: Data<'_, Self::Task>,
        sums: &Self::Sums,
        solution: Self::Solution,
        summary: FitSummary,
        progress: &dyn Progress,
    ) -> Result<Fitted<Self::Report>, Error>;
}

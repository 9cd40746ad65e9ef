//! Parameters of given equations, from logs: `fit parameters`.

mod held_out;
mod report;

use std::sync::Arc;

use faer::Mat;
use fleetfoot_data::setting::{CONSTRAINTS, FOLDS, PARAMETERS, WHERE};
use fleetfoot_data::{Progress, Source, Work};
use fleetfoot_dataset::{Dataset, Logs, ReadPlan, StatisticFile};
use fleetfoot_estimate::{
    Bounded, EquationError, EstimateError, FilterError, FilterErrorOptions, Gains, MatrixLimit, Options, OutputError,
    OutputErrorOptions, equation_error, filter_error, output_error,
};
use fleetfoot_library::Expr;
use fleetfoot_model::{Column, Equation, Estimated as EstimatedNumber, Model, Role};
use fleetfoot_recipe::{EstimateMethod, Recipe};
use fleetfoot_task::ParametersTask;
pub use report::{ConfoundedPair, GainInterval, ParameterInterval, ParametersHeldOut, ParametersReport};
use report::{Estimate, report};

use crate::{
    error::Error,
    folds::smoothed_rows,
    known::given,
    method::{Data, FitRequest, Fitted, Method, RowFacts},
    objective::Refinement,
    plan::FitPlan,
    radial,
    rollout_choice::USUAL_HORIZON,
    summary::FitSummary,
};

/// Chunks of rows that the standard errors of equation error take for independent, about.
const CHUNKS: usize = 64;

/// The settings of `[estimate]`, checked.
#[derive(Debug, Clone)]
pub(crate) struct EstimateOptions {
    pub(crate) method: EstimateMethod,
    pub(crate) segment: Option<usize>,
    pub(crate) compare: Vec<String>,
    pub(crate) folds: usize,
    /// Evaluations of a global search before the descent.
    search: usize,
    /// Seconds over which the logs were smoothed before, where they were.
    smoothed: Option<f64>,
}

impl EstimateOptions {
    fn new(recipe: &Recipe) -> Result<Self, Error> {
        let section = &recipe.estimate;
        let method = section.method.unwrap_or_default();
        let compare: Vec<String> = section.compare.as_deref().map(fleetfoot_recipe::items).unwrap_or_default();
        let compare: Vec<String> = compare.iter().map(|name| name.trim().trim_matches('`').to_owned()).collect();
        if let Some(rows) = section.segment.filter(|&rows| rows < 2) {
            return Err(Error::value(format!("segment = {rows}: a segment has two rows at least")));
        }
        if method == EstimateMethod::EquationError && (section.segment.is_some() || section.compare.is_some()) {
            return Err(Error::conflict(
                "segment and compare apply to simulations, and method = \"equation-error\" runs none: remove them"
                    .into(),
            ));
        }
        if let Some(name) = compare.iter().find(|name| !recipe.states.contains_key(name.as_str())) {
            let near = fleetfoot_data::nearest(name, recipe.states.keys().map(String::as_str));
            let near = fleetfoot_data::did_you_mean(&near);
            return Err(Error::unknown(name, format!("compare: `{name}` is not a state{near}")));
        }
        Ok(Self {
            method,
            segment: section.segment,
            compare,
            folds: section.folds.unwrap_or(5),
            search: section.search.unwrap_or(0),
            smoothed: recipe.time.smoothed,
        })
    }
}

/// `fit parameters`: given equations, with the numbers inside of them estimated.
pub struct Parameters {
    options: EstimateOptions,
}

/// The estimate.
pub struct Estimated {
    /// The model with the names of parameters in its equations.
    open: Model,
    estimate: Estimate,
    /// Without `[constraints]`, where there are any.
    free: Option<Estimate>,
    held_out: Option<ParametersHeldOut>,
    model: Model,
}

impl Method for Parameters {
    const NAME: &'static str = "parameters";
    type Report = ParametersReport;
    type Task = ParametersTask;
    type Sums = ();
    type Solution = Estimated;

    fn new(recipe: &Recipe, _: &FitRequest) -> Result<Self, Error> {
        radial::refuse(recipe, "fit parameters")?;
        Ok(Self { options: EstimateOptions::new(recipe)? })
    }

    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error> {
        let (dataset, task) = Dataset::for_parameters(recipe, logs, progress)?;
        let (rows, parameters) = (dataset.rows(), task.parameters.len());
        let states = task.known.columns.iter().filter(|column| column.role == Role::State).count();
        let names: Vec<&str> = task.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
        let mut details = vec![format!("estimated by {}: {}", report::word(self.options.method), names.join(", "))];
        details.push(match self.options.folds {
            0 => "no rows are held out".to_owned(),
            folds => format!("held out: {folds} spans in turn, for rollouts of {USUAL_HORIZON} steps"),
        });
        Ok(FitPlan {
            equations: task.known.equations.iter().map(Equation::label).collect(),
            candidates: parameters,
            regions: 1,
            passes: PASSES * (1 + self.options.folds),
            simulations: self.simulations(),
            smoothing: None,
            memory: 8 * rows * (states + 1) * (1 + parameters),
            work: Work {
                operations: (PASSES * (1 + self.options.folds)) as f64
                    * (rows * states) as f64
                    * (1 + parameters).pow(2) as f64,
                parts: parameters.max(1),
                mend: format!(
                    "fewer folds ({given_folds}) or a condition for rows ({WHERE}) make it shorter",
                    given_folds = FOLDS.to(2)
                ),
            },
            details,
            notes: dataset.notes().to_vec(),
            reading: ReadPlan::of_tables(logs, &dataset),
        })
    }

    fn open(
        &mut self,
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<(Dataset, ParametersTask), Error> {
        Ok(Dataset::for_parameters(recipe, logs, progress)?)
    }

    fn above(_: &Recipe, _: &Recipe, _: &StatisticFile, _: &mut Vec<String>) -> Result<Recipe, Error> {
        Err(no_rows())
    }

    fn of_statistic(
        &self,
        _: &Recipe,
        _: &Recipe,
        _: &Arc<StatisticFile>,
        _: &mut Vec<String>,
        _: &dyn Progress,
    ) -> Result<(ParametersTask, ()), Error> {
        Err(no_rows())
    }

    fn sum(&self, _: Data<'_, ParametersTask>, _: &mut Vec<String>, _: &dyn Progress) -> Result<(), Error> {
        Ok(())
    }

    fn find(
        &self,
        data: Data<'_, ParametersTask>,
        (): &(),
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<Estimated>, Error> {
        let (task, rows) = (data.task, data.rows()?);
        let mut options = self.options.clone();
        options.compare = written_out(&options.compare, &task.known.columns);
        let method = format!("parameters {}", report::word(options.method));
        // With the names of parameters in its equations.
        let open = given(&method, data.recipe, task.known.clone(), (rows, data.step), progress)?;
        let estimated = estimate(task, &task.limits, &open, rows, &options, progress)?;
        let free = match task.limits.is_empty() {
            true => None,
            false => free(estimate(task, &[], &open, rows, &options, progress), notes)?,
        };
        let smoothed = smoothed_rows(options.smoothed, data.step);
        let held_out = held_out::held_out(task, &open, &estimated, (rows, smoothed), &options, notes, progress)?;
        let model = closed(&open, task, &estimated);
        Ok(vec![Estimated { open, estimate: estimated, free, held_out, model }])
    }

    fn model(estimated: &Estimated) -> &Model {
        &estimated.model
    }

    /// Does nothing: the estimate itself is a fit to simulations.
    fn refine(&self, _: Data<'_, ParametersTask>, (): &(), _: &mut Estimated, _: &mut Refinement) -> Result<(), Error> {
        Ok(())
    }

    fn expressions(&self, task: &ParametersTask) -> Vec<Expr> {
        task.known.equations.iter().filter_map(|equation| equation.target.clone()).collect()
    }

    fn facts(&self, data: Data<'_, ParametersTask>, (): &(), _: &Estimated) -> RowFacts {
        RowFacts { episodes: data.rows.map_or(0, |rows| rows.episodes().len()), ..RowFacts::default() }
    }

    fn report(
        &self,
        data: Data<'_, ParametersTask>,
        (): &(),
        estimated: Estimated,
        summary: FitSummary,
        _: &dyn Progress,
    ) -> Result<Fitted<ParametersReport>, Error> {
        let Estimated { open, estimate: estimated, free, held_out, model } = estimated;
        let report = report(data.task, &open, (&estimated, free.as_ref()), held_out, summary);
        Ok(Fitted { value: None, model, rivals: Vec::new(), report })
    }
}

/// Passes that an estimate takes, about.
const PASSES: usize = 20;

fn no_rows() -> Error {
    Error::needs_rows("fit parameters needs the rows of logs, and a statistic has none: give the logs".into())
}

/// Estimate without constraints; `None`, with a note, if it fails.
fn free(estimate: Result<Estimate, Error>, notes: &mut Vec<String>) -> Result<Option<Estimate>, Error> {
    match estimate {
        Ok(estimate) => Ok(Some(estimate)),
        Err(error @ Error::Cancelled(_)) => Err(error),
        Err(error) => {
            notes.push(format!("without {CONSTRAINTS} there is no estimate: {error}"));
            Ok(None)
        }
    }
}

/// The states that are compared, a rotation by its parts.
fn written_out(compare: &[String], columns: &[Column]) -> Vec<String> {
    let parts = |name: &String| -> Vec<String> {
        let is_part = |column: &&Column| column.rotation.as_ref().is_some_and(|rotation| rotation.group == *name);
        let parts: Vec<String> = columns.iter().filter(is_part).map(|column| column.name.clone()).collect();
        if parts.is_empty() { vec![name.clone()] } else { parts }
    };
    compare.iter().flat_map(parts).collect()
}

/// Estimates on the rows of a source, within these limits.
fn estimate(
    task: &ParametersTask,
    limits: &[MatrixLimit],
    open: &Model,
    source: &dyn Source,
    options: &EstimateOptions,
    progress: &dyn Progress,
) -> Result<Estimate, Error> {
    if options.method == EstimateMethod::EquationError {
        if let Some(silent) = task.without_residual() {
            return Err(Error::conflict(format!(
                "{entry}: it occurs only in the rates of a rotation, which single rows do not determine: estimate it by simulations, method = \"output-error\"",
                entry = PARAMETERS.entry(silent)
            )));
        }
        return Ok(Estimate::Equation(by_equations((task, limits), None, source, options.search, progress)?));
    }
    // Equation errors of single rows give a second starting point; without them there is one.
    let starts = match by_equations((task, limits), None, source, 0, progress) {
        Ok(refitted) => vec![refitted.estimate.values],
        Err(EstimateError::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(_) => Vec::new(),
    };
    Ok(match options.method {
        EstimateMethod::FilterError => {
            by_filter((task, limits), open, source, options, (starts, Gains::Estimated), progress)?.into()
        }
        _ => by_outputs((task, limits), open, source, options, starts, progress)?.into(),
    })
}

/// The same method on other rows of the logs, from an earlier estimate, without a search.
fn again(
    task: &ParametersTask,
    open: &Model,
    source: &dyn Source,
    options: &EstimateOptions,
    before: &Estimate,
    progress: &dyn Progress,
) -> Result<Estimate, EstimateError> {
    let starts = vec![before.values().to_vec()];
    // A search may have left the valley of the initial values.
    let start = (options.search > 0).then(|| before.values());
    let options = &EstimateOptions { search: 0, ..options.clone() };
    Ok(match before {
        Estimate::Equation(_) => {
            Estimate::Equation(by_equations((task, &task.limits), start, source, options.search, progress)?)
        }
        Estimate::Simulated { filter: None, .. } => {
            by_outputs((task, &task.limits), open, source, options, starts, progress)?.into()
        }
        Estimate::Simulated { filter: Some(before), .. } => {
            let gains = Gains::Near(before.gains.iter().map(|gain| gain.value).collect());
            by_filter((task, &task.limits), open, source, options, (starts, gains), progress)?.into()
        }
    })
}

/// `start`: values from which the descent begins, in place of the initial ones.
fn by_equations(
    (task, limits): (&ParametersTask, &[MatrixLimit]),
    start: Option<&[f64]>,
    source: &dyn Source,
    search: usize,
    progress: &dyn Progress,
) -> Result<EquationError, EstimateError> {
    let chunk_rows = (source.rows() / CHUNKS).clamp(256, 65_536);
    let options = Options { chunk_rows, search, ..Options::default() };
    let mut parameters = task.bounded();
    let starts = start.into_iter().flatten();
    parameters.iter_mut().zip(starts).for_each(|(parameter, start)| parameter.initial = *start);
    equation_error(&task.residuals, Bounded::new(&parameters, limits), source, &options, progress)
}

fn by_outputs(
    (task, limits): (&ParametersTask, &[MatrixLimit]),
    open: &Model,
    source: &dyn Source,
    options: &EstimateOptions,
    starts: Vec<Vec<f64>>,
    progress: &dyn Progress,
) -> Result<OutputError, EstimateError> {
    output_error(open, Bounded::new(&task.bounded(), limits), source, &simulated(options, starts), progress)
}

fn by_filter(
    (task, limits): (&ParametersTask, &[MatrixLimit]),
    open: &Model,
    source: &dyn Source,
    options: &EstimateOptions,
    (starts, gains): (Vec<Vec<f64>>, Gains),
    progress: &dyn Progress,
) -> Result<FilterError, EstimateError> {
    let mut filter_error_options = FilterErrorOptions::default();
    (filter_error_options.simulation, filter_error_options.gains) = (simulated(options, starts), gains);
    filter_error(open, Bounded::new(&task.bounded(), limits), source, &filter_error_options, progress)
}

fn simulated(options: &EstimateOptions, starts: Vec<Vec<f64>>) -> OutputErrorOptions {
    let mut output_error_options = OutputErrorOptions::default();
    (output_error_options.rows, output_error_options.outputs, output_error_options.starts) =
        (options.segment, options.compare.clone(), starts);
    output_error_options.descent.search = options.search;
    output_error_options
}

/// The model with values in place of the parameters.
fn closed(open: &Model, task: &ParametersTask, estimate: &Estimate) -> Model {
    let mut model = open.clone();
    let values = estimate.values();
    for equation in &mut model.equations {
        equation.right = task.insert(&equation.right, values);
    }
    let names = task.parameters.iter().map(|parameter| parameter.name.clone());
    let described = names.zip(values).zip(estimate.half_widths());
    model.training.parameters =
        described.map(|((name, &value), half_width)| EstimatedNumber { name, value, half_width }).collect();
    model.training.parameter_covariance = packed(&estimate.covariance());
    model
}

fn packed(covariance: &Mat<f64>) -> Vec<f64> {
    (0..covariance.nrows()).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|(i, j)| covariance[(i, j)]).collect()
}

//! Networks of present and past rows beside a linear map: of several sizes the smallest that predicts as well as the best what did not train; the linear model where no network is better.

mod basis;
mod lags;
mod options;
mod pace;
mod report;
mod rows;
mod search;
#[cfg(test)]
mod tests;
mod train;
mod window;

use std::sync::Arc;

use fleetfoot_data::setting::{CELL, FIT_NETWORK, LAGS};
use fleetfoot_data::{Progress, packed};
use fleetfoot_dataset::{Dataset, Logs, StatisticFile};
use fleetfoot_library::Expr;
use fleetfoot_model::{BasisMap, Model};
use fleetfoot_pwa::{Identification, Problem};
use fleetfoot_recipe::{Lags, PwaSection, Recipe, State};
use fleetfoot_task::Task;
use lags::{with_past, with_variables};
use options::NetworkOptions;
pub use report::{LagChoice, NetworkCandidate, NetworkErrors, NetworkReport};
use rows::Rows;
use search::{Selection, search};
use train::Fitted as Trained;

use crate::{
    error::Error,
    method::{Data, FitRequest, Fitted, Method, Opened, RowFacts},
    narx::PastRows,
    objective::{Beginning, Refinement},
    plan::FitPlan,
    pwa::Pwa,
    radial,
    rollout_choice::RolloutRule,
    summary::FitSummary,
    worth::verdict,
};

/// Rows that a plan takes as read of every column, where lags are found.
const LAGS_PLANNED: usize = 4;

/// `fit network`.
#[derive(Debug, Clone)]
pub struct Network {
    options: NetworkOptions,
    /// The linear model of the same functions.
    linear: Pwa,
    /// True to find lags.
    looks: bool,
    /// Rows that functions read of every column, as far as the recipe tells.
    rows: usize,
}

/// The linear model, what was compared, and the model that is written.
pub struct NetworkSolution {
    linear: Identification,
    selection: Selection,
    rule: String,
    trained_rows: usize,
    model: Model,
    /// The task of the functions that it reads.
    task: Task,
    lags: Option<LagChoice>,
}

impl Method for Network {
    const NAME: &'static str = "network";
    type Report = NetworkReport;
    type Task = Task;
    type Sums = Option<PastRows>;
    type Solution = NetworkSolution;

    fn new(recipe: &Recipe, request: &FitRequest) -> Result<Self, Error> {
        radial::refuse(recipe, "fit network")?;
        let options = NetworkOptions::new(recipe)?;
        let mut linear = predicting(recipe);
        let looks = linear.model.lags.is_none()
            && matches!(linear.model.predict.as_deref(), Some("next" | "delta" | "difference"));
        let rows = 1 + linear.model.lags.into_iter().flat_map(Lags::steps).count();
        if options.cell.is_some() && rows == 1 && !looks {
            return Err(window::missing());
        }
        linear.model.partition = Some("average".into());
        linear.pwa = PwaSection { folds: Some(options.folds), seed: Some(options.seed), ..PwaSection::default() };
        Ok(Self { options, linear: Pwa::new(&linear, request)?, looks, rows })
    }

    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error> {
        let mut plan = self.linear.plan(&predicting(recipe), logs, progress)?;
        if self.looks {
            plan.candidates *= LAGS_PLANNED;
        }
        let (inputs, targets) = (plan.candidates, plan.equations.len());
        let read = (inputs, if self.looks { LAGS_PLANNED } else { self.rows });
        let rows = plan.reading.rows.min(self.options.most_rows(read, targets));
        plan.passes += 1;
        plan.memory += self.options.bytes().min(rows * (inputs + 2 * targets) * 32);
        plan.work.operations += self.options.work(rows, read, targets);
        let name = |hidden: &Vec<usize>| NetworkCandidate::name_of(self.options.cell, hidden);
        let sizes: Vec<String> = self.options.sizes().iter().map(name).collect();
        plan.details = vec![format!("compared with the linear model on {rows} rows: {}", sizes.join(", "))];
        if self.looks {
            plan.details.push("lags: those with which linear models simulate held-out spans, up to ten or so".into());
        }
        Ok(plan)
    }

    fn open(&mut self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Dataset, Task), Error> {
        let (dataset, task) = self.linear.open(&predicting(recipe), logs, progress)?;
        match task.problem.weight {
            None => Ok((dataset, task)),
            Some(weight) => {
                Err(Error::conflict(format!("weight = \"{weight}\": {FIT_NETWORK} has no weights of rows; remove it")))
            }
        }
    }

    fn of_statistic(
        &self,
        _: &Recipe,
        _: &Recipe,
        _: &Arc<StatisticFile>,
        _: &mut Vec<String>,
        _: &dyn Progress,
    ) -> Result<(Task, Self::Sums), Error> {
        Err(Error::needs_rows(format!("{FIT_NETWORK} trains on rows, and a statistic has none; give the logs instead")))
    }

    fn carried(&self, recipe: &Recipe, over: Option<u32>) -> Recipe {
        self.linear.carried(&predicting(recipe), over)
    }

    fn rollouts(&self) -> Option<RolloutRule> {
        self.linear.rollouts()
    }

    fn with_span(&self, recipe: &Recipe, task: &Task, over: Option<u32>) -> Task {
        self.linear.with_span(&predicting(recipe), task, over)
    }

    /// Spans of derivatives are chosen by the linear model.
    fn trials(&self, data: Data<'_, Task>, progress: &dyn Progress) -> Result<Vec<(String, Model)>, Error> {
        self.linear.trials(data, progress)
    }

    fn sum(&self, _: Data<'_, Task>, _: &mut Vec<String>, _: &dyn Progress) -> Result<Self::Sums, Error> {
        Ok(None)
    }

    /// Nothing is summed, but past rows that the functions may read are found.
    fn sum_logs(
        &self,
        opened: &mut Opened<Task>,
        _: &Logs,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self::Sums, Error> {
        if !self.looks {
            return Ok(None);
        }
        let settings = (self.options.effort, self.options.folds.into(), self.options.seed);
        let past = match PastRows::find(&opened.recipe, &opened.dataset, settings, progress) {
            Ok(past) => past,
            Err(error @ Error::Cancelled(_)) => return Err(error),
            Err(error) if self.options.cell.is_some() => {
                return Err(Error::missing(format!(
                    "{CELL}: a recurrent cell reads past rows, and lags could not be found ({error}); give {}",
                    LAGS.to(10)
                )));
            }
            Err(error) => {
                notes.push(format!(
                    "only the present row is read, as lags could not be found ({LAGS} sets them): {error}"
                ));
                return Ok(None);
            }
        };
        Ok(Some(past))
    }

    fn find(
        &self,
        data: Data<'_, Task>,
        past: &Self::Sums,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<NetworkSolution>, Error> {
        if self.options.cell.is_some() {
            return Ok(vec![self.with_cell(data, past.as_ref(), notes, progress)?]);
        }
        let mut of_present = Vec::new();
        let present = self.one(data, &mut of_present, progress)?;
        let task = past.as_ref().map(|past| with_past(data, past)).transpose()?.flatten();
        match (past, task) {
            (Some(past), Some(task)) => {
                Ok(vec![self.with_lags(data, (present, of_present), (&task, past), notes, progress)?])
            }
            _ => {
                notes.append(&mut of_present);
                Ok(vec![present])
            }
        }
    }

    fn model(solution: &NetworkSolution) -> &Model {
        &solution.model
    }

    fn again(
        &self,
        data: Data<'_, Task>,
        solution: &NetworkSolution,
        progress: &dyn Progress,
    ) -> Result<Beginning, Error> {
        Ok((self.trained(data, solution, progress)?, None))
    }

    fn refine(
        &self,
        _: Data<'_, Task>,
        _: &Self::Sums,
        _: &mut NetworkSolution,
        _: &mut Refinement,
    ) -> Result<(), Error> {
        Ok(())
    }

    fn expressions(&self, task: &Task) -> Vec<Expr> {
        self.linear.expressions(task)
    }

    fn facts(&self, data: Data<'_, Task>, _: &Self::Sums, solution: &NetworkSolution) -> RowFacts {
        self.linear.facts(data, &None, &solution.linear)
    }

    fn report(
        &self,
        _: Data<'_, Task>,
        _: &Self::Sums,
        solution: NetworkSolution,
        mut summary: FitSummary,
        _: &dyn Progress,
    ) -> Result<Fitted<NetworkReport>, Error> {
        let NetworkSolution { linear, selection, rule, trained_rows, model, lags, .. } = solution;
        let shares = selection.held_out.iter().map(|errors| (errors.rmse / errors.mean).powi(2));
        let shares = linear.targets.iter().cloned().zip(shares);
        summary.verdict = verdict("predicted", shares, summary.by_time.as_ref());
        let report = NetworkReport {
            hash: model.hash(),
            rows: linear.rows,
            trained_rows: trained_rows as u64,
            targets: linear.targets,
            sigma: linear.sigma,
            fold_rule: rule,
            candidates: selection.candidates,
            chosen: selection.chosen,
            held_out: selection.held_out,
            lags,
            summary,
        };
        Ok(Fitted { value: None, model, rivals: Vec::new(), report })
    }
}

/// The recipe with a prediction: where none is given, that of the change from row to row, whose past rows are regressors. A central difference reads the rows beside it,
/// and their noise would explain its own; a measured or a known derivative stays.
pub(crate) fn predicting(recipe: &Recipe) -> Recipe {
    let mut adapted = recipe.clone();
    let has_derivative = |state: &State| state.derivative.is_some() || state.known.is_some();
    if recipe.model.predict.is_none() && !recipe.states.values().any(has_derivative) {
        adapted.model.predict = Some("delta".into());
    }
    adapted
}

impl Network {
    /// The candidates of the functions of a task, compared.
    fn one(
        &self,
        data: Data<'_, Task>,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<NetworkSolution, Error> {
        let mut of_linear = Vec::new();
        let linear = self.linear.find(data, &None, &mut of_linear, progress)?.swap_remove(0);
        let rows = self.rows(data, progress, true)?;
        let mut selection = search(&rows, &self.options, progress)?;
        if rows.table.rows() < rows.complete {
            selection.notes.push(format!(
                "{} of {} complete rows, evenly taken, train and test the networks; more memory or effort takes more",
                rows.table.rows(),
                rows.complete
            ));
        }
        let mut model = linear.model.clone();
        if selection.chosen == 0 {
            model.method = "network linear".into();
            let reason = match selection.candidates.len() {
                1 => "no network was compared",
                _ => "no network predicts held-out rows better than the linear model by more than one standard error",
            };
            selection.notes.push(format!("{reason}: the linear model is written"));
            notes.append(&mut of_linear);
        } else {
            self.write(&mut model, &selection.fitted, &rows);
        }
        notes.append(&mut selection.notes);
        Ok(NetworkSolution {
            linear,
            selection,
            rule: rows.rule,
            trained_rows: rows.table.rows(),
            model,
            task: data.task.clone(),
            lags: None,
        })
    }

    /// The candidates with a cell over the rows that are given, or that linear models chose: as many of every column as of the one that has most.
    fn with_cell(
        &self,
        data: Data<'_, Task>,
        past: Option<&PastRows>,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<NetworkSolution, Error> {
        let Some(past) = past else { return self.one(data, notes, progress) };
        let task = with_variables(data, window::even(&past.variables))?.ok_or_else(window::missing)?;
        let solution = self.one(Data { task: &task, ..data }, notes, progress)?;
        notes.push(format!("the cell reads the lags that linear models chose ({}); {LAGS} sets them", past.in_words()));
        Ok(solution)
    }

    /// The chosen candidate fitted to some rows.
    fn trained(
        &self,
        data: Data<'_, Task>,
        solution: &NetworkSolution,
        progress: &dyn Progress,
    ) -> Result<Model, Error> {
        let data = Data { task: &solution.task, ..data };
        let (_, mut model) = self.linear.trials(data, progress)?.swap_remove(0);
        model.method.clone_from(&solution.model.method);
        let hidden = &solution.selection.candidates[solution.selection.chosen].hidden;
        if !hidden.is_empty() {
            let rows = self.rows(data, progress, false)?;
            let [all, _] = rows.split(None);
            let shape = rows.shape(hidden, &self.options);
            let training = self.options.training(&shape, all.len(), rows.table.targets());
            let fitted = train::network(&shape, &rows.table, &all, &training, progress)?;
            self.write(&mut model, &fitted, &rows);
        }
        Ok(model)
    }

    /// The rows of a fit, in folds or not.
    fn rows(&self, data: Data<'_, Task>, progress: &dyn Progress, folds: bool) -> Result<Rows, Error> {
        let problem = &data.task.problem;
        let mut options = self.linear.of(data);
        if !folds {
            options.folds = 0;
        }
        let targets = problem.equations.iter().filter(|equation| equation.target.is_some()).count();
        let most = self.options.most_rows((problem.library.len(), self.steps(problem)), targets);
        Rows::read(problem, (&options, &self.options), most, data.rows()?, progress)
    }

    /// Steps of the cell; 1 where there is none.
    fn steps(&self, problem: &Problem) -> usize {
        self.options.cell.map_or(1, |_| window::steps(&problem.library).len().max(1))
    }

    /// Puts a network into the latents of the linear model, and the covariance of its residuals in place of the linear model's.
    fn write(&self, model: &mut Model, fitted: &Trained, rows: &Rows) {
        let Some((shape, parameters)) = &fitted.hidden else { return };
        let (p, q) = (rows.table.inputs(), rows.table.targets());
        let (centre, scale) = (&fitted.units.centre, &fitted.units.scale);
        let basis = basis::basis(shape, parameters, &rows.inputs, &fitted.units);
        let output = &fitted.output.0;
        for (t, latent) in model.latents.iter_mut().enumerate() {
            let Some(affine) = latent.affine() else { continue };
            let mut affine = affine.clone();
            let unit = scale[p + t];
            let mut constant = output[(0, t)];
            affine.coefficients[0].fill(0.0);
            for (j, &input) in rows.inputs.iter().enumerate() {
                constant -= output[(1 + j, t)] * centre[j] / scale[j];
                affine.coefficients[0][input] = unit * output[(1 + j, t)] / scale[j];
            }
            affine.constants[0] = centre[p + t] + unit * constant;
            let weights = vec![(0..shape.features()).map(|k| unit * output[(1 + p + k, t)]).collect()];
            latent.map = BasisMap { affine, basis: basis.clone(), weights }.into();
        }
        if let Some(region) = model.summaries.first_mut().and_then(|summary| summary.regions.first_mut()) {
            for a in 0..q {
                for b in 0..=a {
                    let product = fitted.sums.error_product(&fitted.output, [a, b]);
                    region.residual_covariance[packed(a, b)] = product * scale[p + a] * scale[p + b];
                }
            }
        }
        model.partitions.iter_mut().for_each(|partition| partition.correlation = None);
        model.method = format!("network {}", basis::words(shape));
    }
}

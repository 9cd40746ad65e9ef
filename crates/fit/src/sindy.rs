//! From logs, or from their statistic, to equations: sparse sums of candidate functions, beside the known part of the
//! dynamics.
//!
//! A recipe becomes an [`EquationTask`](fleetfoot_task::EquationTask); one pass over the rows makes its [`Evidence`].
//! Everything else follows from the statistic: models of every size, held-out errors, ensembles, standard errors.

mod estimation;
mod evidence;
mod frozen;
mod limits;
mod options;
mod refined;
mod report;
mod smoothed;
mod solve;
mod spans;
mod state_smoothing;
mod statistic;
mod words;
mod work;

use std::sync::Arc;

pub use estimation::ParameterReport;
pub use evidence::Evidence;
use faer::Mat;
use fleetfoot_data::Progress;
use fleetfoot_data::setting::{PARAMETERS, SMOOTH_STATES};
use fleetfoot_dataset::{Dataset, Logs, ReadPlan, StatisticFile, open};
use fleetfoot_estimate::SmoothingOptions;
use fleetfoot_library::Expr;
use fleetfoot_model::{Gaussian, Model};
use fleetfoot_recipe::{Objective, Recipe};
use fleetfoot_sparse::{
    inference::{Clusters, system_errors},
    threshold::{Terms, refit_supports},
};
use fleetfoot_sums::system::SystemPlan;
use fleetfoot_task::{EquationTask, Provenance, specification};
pub(crate) use frozen::Frozen;
pub use options::{Ensemble, SindyOptions};
pub(crate) use refined::coefficients_of;
pub use report::{EquationReport, FrontPoint, RegionReport, SindyReport, TermReport};
pub(crate) use solve::keys;
use solve::{Solved, Solver};
pub use state_smoothing::{StateNoise, StateSmoothing};

use crate::{
    error::Error,
    method::{Data, FitRequest, Fitted, Method, Opened, Rival, RowFacts},
    objective::Refinement,
    plan::FitPlan,
    radial,
    rollout_choice::{RolloutRule, USUAL_HORIZON, open_spans},
    summary::FitSummary,
    worth::{no_better, verdict, worse_than_persistence},
};

/// Episodes from which on they are the clusters of the standard errors; with fewer, chunks are.
const ENOUGH_EPISODES: usize = 10;
/// Candidates that a plan names.
const SHOWN: usize = 12;

/// `fit sindy`.
#[derive(Debug, Clone)]
pub struct Sindy {
    options: SindyOptions,
    /// True to keep the models of other numbers of terms.
    front: bool,
    /// Rule by which rollouts choose open spans of derivatives; `None` without such spans.
    rollouts: Option<RolloutRule>,
    /// The column of labels that regions come from.
    label: Option<String>,
}

/// The equations of every region.
pub struct Solution {
    regions: Vec<Vec<Solved>>,
    /// The same without bounds of coefficients, where there are any.
    free: Option<Vec<Vec<Solved>>>,
    /// Number of folds, and their rule.
    folds: (usize, Option<String>),
    /// Found in turn with smoothed states.
    smoothed: Option<smoothed::Smoothed>,
    provenance: Provenance,
    model: Model,
}

impl Method for Sindy {
    const NAME: &'static str = "sindy";
    type Report = SindyReport;
    type Task = EquationTask;
    type Sums = Evidence;
    type Solution = Solution;

    fn new(recipe: &Recipe, request: &FitRequest) -> Result<Self, Error> {
        let options = SindyOptions::new(&recipe.sindy)?.within(recipe)?;
        let open = !open_spans(recipe).is_empty();
        if let Some(name) = recipe.parameters.keys().next() {
            if open {
                return Err(Error::conflict(format!(
                    "over = \"auto\" and {entry}: a span can be chosen only if all expressions are known; write a number of rows, or a number for {name}",
                    entry = PARAMETERS.entry(name)
                )));
            }
            if options.objective != Objective::OneStep {
                return Err(Error::conflict(format!(
                    "objective = \"{}\" and {entry}: simulations fit the coefficients of known expressions; write a number for {name}",
                    options.objective,
                    entry = PARAMETERS.entry(name)
                )));
            }
        }
        let rollouts = open.then(|| RolloutRule::new(request.horizon.unwrap_or(USUAL_HORIZON)));
        let label = specification(recipe)?.and_then(|partition| partition.label().map(str::to_owned));
        Ok(Self { options, front: request.rivals, rollouts, label })
    }

    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error> {
        let (task, reading, notes) = match open::estimate_equations(recipe, logs, progress)? {
            Some((task, columns, cost)) => (task, ReadPlan::of_messages(logs, columns, &cost), Vec::new()),
            None => {
                let (dataset, task) = Dataset::for_equations(recipe, logs, progress)?;
                (task, ReadPlan::of_tables(logs, &dataset), dataset.notes().to_vec())
            }
        };
        let options = &self.options;
        let regions = specification(recipe)?.and_then(|partition| partition.clusters()).unwrap_or(1);
        let centres = radial::count(recipe)?.unwrap_or(0);
        let (candidates, equations) = (task.candidates() + centres, task.fitted.len());
        let names = (0..task.candidates()).map(|j| task.candidate(j)).chain((0..centres).map(Gaussian::name));
        let named: Vec<String> = names.take(SHOWN).collect();
        let more = if candidates > SHOWN { ", ..." } else { "" };
        let mut details = vec![format!("candidates: {}{more}", named.join(", "))];
        if !task.parameters.is_empty() {
            let names: Vec<&str> = task.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
            details.push(format!("estimated first, one pass per step: {}", names.join(", ")));
        }
        let smoothing = smoothed::may_apply(options.smooth_states, &task, recipe, regions > 1, reading.rows)
            .then(|| SmoothingOptions::default().memory as usize);
        details.extend(smoothing.map(|bytes| {
            format!(
                "states are smoothed if {SMOOTH_STATES} asks for it, or if noise is more than a fifth of the variance of the differences: some hundred passes over rows in memory, at most {} MiB",
                bytes >> 20
            )
        }));
        Ok(FitPlan {
            equations: task.fitted.iter().map(|equation| equation.label.clone()).collect(),
            candidates,
            regions,
            passes: 1 + usize::from(centres > 0),
            simulations: self.simulations(),
            memory: SystemPlan::memory(&task.system(), regions, reading.rows),
            work: work::work(options, candidates, equations, regions, options.folds.expected(reading.episodes)),
            smoothing,
            details,
            reading,
            notes,
        })
    }

    fn objective(&self) -> Objective {
        self.options.objective
    }

    fn open(
        &mut self,
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<(Dataset, EquationTask), Error> {
        Ok(Dataset::for_equations(recipe, logs, progress)?)
    }

    fn of_statistic(
        &self,
        recipe: &Recipe,
        scanned: &Recipe,
        file: &Arc<StatisticFile>,
        notes: &mut Vec<String>,
        _: &dyn Progress,
    ) -> Result<(EquationTask, Evidence), Error> {
        let evidence = Evidence::of_statistic(recipe, scanned, file, notes)?;
        Ok((evidence.task.clone(), evidence))
    }

    fn rollouts(&self) -> Option<RolloutRule> {
        self.rollouts
    }

    fn with_span(&self, recipe: &Recipe, task: &EquationTask, over: Option<u32>) -> EquationTask {
        spans::spanned(task, recipe, over)
    }

    fn trials(&self, data: Data<'_, EquationTask>, progress: &dyn Progress) -> Result<Vec<(String, Model)>, Error> {
        let partition = data.recipe.model.partition.clone().unwrap_or_else(|| "average".into());
        Ok(vec![(partition, equations(data, &self.options, progress)?)])
    }

    fn sum(
        &self,
        data: Data<'_, EquationTask>,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Evidence, Error> {
        let frozen = Frozen { task: data.task.clone(), parameters: Vec::new() };
        Evidence::of_rows(data.recipe, self.options.seed, frozen, data.step, data.rows()?, notes, progress)
    }

    fn sum_logs(
        &self,
        opened: &mut Opened<EquationTask>,
        logs: &Logs,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Evidence, Error> {
        Evidence::of_logs(opened, self.options.seed, logs, notes, progress)
    }

    fn find(
        &self,
        data: Data<'_, EquationTask>,
        evidence: &Evidence,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<Solution>, Error> {
        let (recipe, options) = (data.recipe, &self.options);
        let solver = Solver::new(evidence, options, self.front, notes)?;
        let (targets, count) = (evidence.task.fitted.len(), evidence.scan.regions());
        progress.expect(work::work(options, evidence.task.candidates(), targets, count, solver.folds()));
        let regions: Vec<Vec<Solved>> =
            (0..count).map(|region| solver.solve(region, notes, progress)).collect::<Result<_, _>>()?;
        let method = match &evidence.partition {
            None => format!("sindy {}", options.optimizer.name()),
            Some(partition) => format!("sindy {}, {}", options.optimizer.name(), partition.specification),
        };
        let mut provenance = evidence.provenance(&method, recipe, options.seed);
        let mut chosen = chosen(&regions);
        let smoothed = smoothed::smoothed(recipe, options, evidence, &chosen[0], data.rows, (notes, progress))?;
        if let Some(smoothed) = smoothed.as_ref().filter(|smoothed| smoothed.report.written) {
            provenance.method.push_str(", smoothed states");
            chosen = vec![smoothed.coefficients.clone()];
        }
        let model = evidence.task.model(&evidence.scan, evidence.partition.as_ref(), &chosen, provenance.clone());
        let folds = (solver.folds(), solver.fold_rule().map(str::to_owned));
        let free = limits::free(evidence, solver, progress)?;
        Ok(vec![Solution { regions, free, folds, smoothed, provenance, model }])
    }

    fn model(solution: &Solution) -> &Model {
        &solution.model
    }

    fn held_out_by_time(
        &self,
        data: Data<'_, EquationTask>,
        solution: &Solution,
        progress: &dyn Progress,
    ) -> Option<Result<Model, Error>> {
        let again = || {
            let mut notes = Vec::new();
            let evidence = self.sum(data, &mut notes, progress)?;
            Ok(self.find(data, &evidence, &mut notes, progress)?.swap_remove(0).model)
        };
        // States that are smoothed in turn with the equations take many fits.
        (solution.folds.0 > 1 && solution.smoothed.is_none()).then(again)
    }

    fn same_terms(
        &self,
        data: Data<'_, EquationTask>,
        solution: &Solution,
        progress: &dyn Progress,
    ) -> Result<Model, Error> {
        let mut notes = Vec::new();
        let evidence = self.sum(data, &mut notes, progress)?;
        // Smoothed states and bounds are no least squares on a support.
        if solution.smoothed.as_ref().is_some_and(|smoothed| smoothed.report.written)
            || !evidence.task.limits.is_empty()
        {
            return Ok(self.find(data, &evidence, &mut notes, progress)?.swap_remove(0).model);
        }
        let refitted = (0..evidence.scan.regions().min(solution.regions.len())).map(|region| {
            let problem = evidence.scan.root(region).compressed(evidence.task.constant);
            let solved = solution.regions[region].iter().enumerate().map(|(target, region)| {
                let steps = refit_supports(&problem, target, &Terms::all(), std::slice::from_ref(&region.step.support));
                let coefficients = steps.map_err(Error::Threshold)?.swap_remove(0).coefficients;
                Ok(coefficients)
            });
            let columns: Vec<Vec<f64>> = solved.collect::<Result<_, Error>>()?;
            Ok(Mat::from_fn(problem.columns(), columns.len(), |j, t| columns[t][j]))
        });
        let refitted: Vec<Mat<f64>> = refitted.collect::<Result<_, Error>>()?;
        let provenance = evidence.provenance("sindy", data.recipe, self.options.seed);
        Ok(evidence.task.model(&evidence.scan, evidence.partition.as_ref(), &refitted, provenance))
    }

    fn refine(
        &self,
        _: Data<'_, EquationTask>,
        evidence: &Evidence,
        solution: &mut Solution,
        refinement: &mut Refinement,
    ) -> Result<(), Error> {
        if refinement.written {
            let chosen = coefficients_of(&refinement.fitted.model, &evidence.task, solution.regions.len());
            let provenance = solution.provenance.clone();
            solution.model = evidence.task.model(&evidence.scan, evidence.partition.as_ref(), &chosen, provenance);
        }
        Ok(())
    }

    fn expressions(&self, task: &EquationTask) -> Vec<Expr> {
        task.row_functions().into_iter().chain(self.label.as_deref().map(Expr::column)).collect()
    }

    fn facts(&self, _: Data<'_, EquationTask>, evidence: &Evidence, _: &Solution) -> RowFacts {
        let counts = evidence.scan.counts();
        let labels = evidence.task.fitted.iter().map(|equation| equation.label.clone());
        RowFacts {
            episodes: evidence.episodes.len(),
            left_out: vec![counts.at_border, counts.incomplete, evidence.scan.unassigned()],
            concentrated: labels.zip(evidence.scan.concentrated().iter().cloned()).collect(),
        }
    }

    fn report(
        &self,
        _: Data<'_, EquationTask>,
        evidence: &Evidence,
        solution: Solution,
        summary: FitSummary,
        _: &dyn Progress,
    ) -> Result<Fitted<SindyReport>, Error> {
        let mut report = report(evidence, &self.options, &solution, summary);
        if let Some(free) = &solution.free {
            limits::tell(evidence, &solution.regions, free, &mut report);
        }
        if let Some(smoothed) = &solution.smoothed {
            if smoothed.report.written {
                smoothed.tell(evidence, &mut report);
            }
            report.smoothing = Some(smoothed.report.clone());
        }
        report.refine(&evidence.task, &solution.model);
        let errors = report.regions.iter().filter(|_| report.regions.len() == 1).flat_map(|region| &region.equations);
        let errors: Vec<(String, f64)> = errors.map(|error| (error.label.clone(), error.held_out)).collect();
        let worse = worse_than_persistence(&solution.model, errors, &report.summary.baselines);
        report.summary.notes.extend(worse);
        let shares = report.regions.iter().flat_map(|region| &region.equations);
        let shares = shares.map(|equation| (equation.label.clone(), 1.0 - equation.held_out_r2));
        let shares: Vec<(String, f64)> = shares.collect();
        let summary = &mut report.summary;
        summary.verdict = verdict("predicted", shares.iter().cloned(), summary.by_time.as_ref());
        summary.notes.extend(no_better("predicted", shares));
        let rivals = match (self.front, solution.regions.as_slice()) {
            (true, [region]) => front_models(evidence, region, &solution.provenance),
            _ => Vec::new(),
        };
        Ok(Fitted { value: None, model: solution.model, rivals, report })
    }
}

/// The equations that some rows give.
pub(super) fn equations(
    data: Data<'_, EquationTask>,
    options: &SindyOptions,
    progress: &dyn Progress,
) -> Result<Model, Error> {
    let method = Sindy { options: options.clone(), front: false, rollouts: None, label: None };
    let mut notes = Vec::new();
    let evidence = method.sum(data, &mut notes, progress)?;
    let solver = Solver::new(&evidence, options, false, &mut notes)?;
    let regions: Vec<_> = (0..evidence.scan.regions())
        .map(|region| solver.solve(region, &mut notes, progress))
        .collect::<Result<_, _>>()?;
    let provenance = evidence.provenance("sindy", data.recipe, options.seed);
    Ok(evidence.task.model(&evidence.scan, evidence.partition.as_ref(), &chosen(&regions), provenance))
}

/// The coefficients (candidates x equations) of every region.
fn chosen(regions: &[Vec<Solved>]) -> Vec<Mat<f64>> {
    regions.iter().map(|region| coefficients(region, |solved| &solved.step)).collect()
}

/// Coefficients (candidates x equations) of a model of every equation.
fn coefficients<'a>(
    region: &'a [Solved],
    of: impl Fn(&'a Solved) -> &'a fleetfoot_sparse::threshold::Step,
) -> Mat<f64> {
    let p = region.first().map_or(0, |region| region.step.coefficients.len());
    Mat::from_fn(p, region.len(), |j, t| of(&region[t]).coefficients[j])
}

/// For every number of terms on any equation's front the model in which each equation has its best with at most so many.
fn front_models(evidence: &Evidence, region: &[Solved], provenance: &Provenance) -> Vec<Rival> {
    let terms = |solved: &Solved, k: usize| solved.sweep.trail.steps[k].terms();
    let sizes: std::collections::BTreeSet<usize> =
        region.iter().flat_map(|region| region.sweep.front.iter().map(|&k| terms(region, k))).collect();
    let model = |size: usize| {
        let b = coefficients(region, |solved| {
            let front = &solved.sweep.front;
            let best = front.iter().rev().find(|&&k| terms(solved, k) <= size).or(front.first());
            best.map_or(&solved.step, |&k| &solved.sweep.trail.steps[k])
        });
        let model = evidence.task.model(&evidence.scan, None, &[b], provenance.clone());
        Rival { name: format!("terms{size}"), model }
    };
    sizes.into_iter().map(model).collect()
}

fn report(evidence: &Evidence, options: &SindyOptions, solution: &Solution, mut summary: FitSummary) -> SindyReport {
    let (task, scan, regions) = (&evidence.task, &evidence.scan, &solution.regions);
    let chosen = chosen(regions);
    let (folds, fold_rule) = (solution.folds.0, solution.folds.1.as_deref());
    let clusters = if evidence.episodes.len() >= ENOUGH_EPISODES { Clusters::Episodes } else { Clusters::Chunks };
    let described = regions.iter().enumerate().map(|(region, solved)| {
        // A coefficient at its bound is no estimate.
        let supports: Vec<Vec<usize>> =
            solved.iter().enumerate().map(|(target, equation)| limits::loose(task, target, equation)).collect();
        let b = chosen[region].as_ref();
        let errors = system_errors(scan, region, task.constant, b, &supports, clusters);
        if let Err(error) = &errors {
            summary.notes.push(format!("no standard errors: {error}"));
        }
        let problem = scan.root(region).compressed(task.constant);
        let equations = solved.iter().enumerate().map(|(target, equation)| {
            let error = |j: usize| errors.as_ref().map_or(f64::NAN, |errors| errors[(j, target)]);
            report::equation(task, target, equation, &problem, error)
        });
        RegionReport { name: evidence.region_name(region), rows: scan.rows(region), equations: equations.collect() }
    });
    let regions = described.collect();
    SindyReport {
        rows: (0..scan.regions()).map(|region| scan.rows(region)).sum(),
        method: options.method_in_words(),
        choice: options.choice_in_words(fold_rule),
        folds,
        fold_rule: fold_rule.map(str::to_owned),
        ensemble: options.ensemble_in_words(),
        windows: evidence.windows_in_words(),
        parameters: evidence.parameters.clone(),
        candidates: (0..task.candidates()).map(|j| task.candidate(j)).collect(),
        regions,
        smoothing: None,
        limits: Vec::new(),
        summary,
    }
}

#[cfg(test)]
mod tests;

//! From logs, or from their statistic, to equations: sparse sums of candidate functions, beside what is known of the dynamics.
//!
//! A recipe becomes an [`EquationTask`](fleetfoot_task::EquationTask); one pass over the rows makes its [`Evidence`]; everything else (models of every size, held-out errors, ensembles,
//! standard errors) follows from the statistic ([`fit_sindy`]).

mod estimation;
mod evidence;
mod frozen;
mod limits;
mod options;
mod plan;
mod refined;
mod report;
mod smoothed;
mod solve;
mod spans;
mod state_smoothing;
mod statistic;
mod words;
mod work;

use std::path::{Path, PathBuf};

pub use estimation::ParameterReport;
pub use evidence::Evidence;
use faer::Mat;
use fleetfoot_data::Progress;
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_model::Model;
use fleetfoot_output::together;
use fleetfoot_recipe::Recipe;
use fleetfoot_sparse::inference::{Clusters, system_errors};
use fleetfoot_task::Provenance;
pub(crate) use frozen::Frozen;
pub use options::{Ensemble, SindyOptions};
pub use plan::{SindyPlan, plan_sindy};
pub(crate) use refined::coefficients_of;
pub use report::{EquationReport, FrontPoint, RegionReport, SindyReport, TermReport};
pub(crate) use solve::keys;
use solve::{Solved, Solver};
pub use state_smoothing::{StateNoise, StateSmoothing};
pub(crate) use statistic::beneath;

use crate::{
    error::Error,
    model_file::{refuse_not_finite, write_model},
    objective,
    rollout_choice::{HORIZON, RolloutRule, open_spans, settled},
};

/// Episodes from which on they are the clusters of the standard errors; with fewer, chunks are.
const ENOUGH_EPISODES: usize = 10;

/// What is wanted beside the model.
#[derive(Debug, Clone, Copy, Default)]
pub struct SindyRequest {
    /// The models of other numbers of terms.
    pub front: bool,
    /// Steps of the rollouts that choose open spans of derivatives (`over = "auto"`); [`HORIZON`] when not given.
    pub horizon: Option<usize>,
}

/// Equations, and how they came about.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SindyFitted {
    /// The model.
    pub model: Model,
    /// Scores, terms, the front.
    pub report: SindyReport,
    /// Models of the front by their number of terms an equation, at most; of one region, where they were asked for.
    pub front: Vec<(usize, Model)>,
}

impl SindyFitted {
    /// Writes the models of the front beside the chosen one's file: `model.json` and 3 terms make `model_terms3.json`; tells the files.
    ///
    /// # Errors
    /// Those of writing.
    pub fn write_front(&self, chosen: &Path) -> Result<Vec<PathBuf>, Error> {
        let files = self.front_files(chosen);
        together(|| files.iter().zip(&self.front).try_for_each(|(path, (_, model))| write_model(model, path)))?;
        Ok(files)
    }

    /// The files that [`SindyFitted::write_front`] writes.
    pub fn front_files(&self, chosen: &Path) -> Vec<PathBuf> {
        let stem = chosen.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
        let extension = chosen.extension().map_or_else(|| "json".into(), |extension| extension.to_string_lossy());
        let name = |terms: &usize| chosen.with_file_name(format!("{stem}_terms{terms}.{extension}"));
        self.front.iter().map(|(terms, _)| name(terms)).collect()
    }
}

/// Finds equations in logs, or in one `.stats` file without a pass.
///
/// # Errors
/// Those of the recipe, of reading, of estimating parameters, and of the solvers.
pub fn fit_sindy(
    recipe: &Recipe,
    request: SindyRequest,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<SindyFitted, Error> {
    let logs = &logs.into();
    // What is wrong with the options is said before the pass.
    let options = SindyOptions::new(&recipe.sindy)?.within(recipe)?;
    if logs.is_statistic() {
        objective::refuse_statistic(options.objective)?;
    }
    // Logs are opened once: what else is asked of their rows is asked of the same ones.
    let (mut evidence, recipe, rollouts, dataset) = if logs.is_statistic() {
        let (evidence, recipe) = Evidence::of_statistic(recipe, logs)?;
        (evidence, recipe, None, None)
    } else {
        let opened = Dataset::for_equations(&settled(recipe, None), logs, progress)?;
        let (recipe, rollouts, opened) = match open_spans(recipe).is_empty() {
            true => (recipe.clone(), None, opened),
            false => {
                let rule = RolloutRule::new(request.horizon.unwrap_or(HORIZON));
                let choice = spans::by_rollouts(recipe, &options, rule, (&opened.0, &opened.1), progress)?;
                let recipe = settled(recipe, choice.candidates[choice.chosen].over);
                let task = Dataset::equations(&recipe, logs)?.1;
                (recipe, Some(choice), (opened.0, task))
            }
        };
        let (evidence, dataset) = Evidence::of_logs(&recipe, options.seed, opened, logs, progress)?;
        (evidence, recipe, rollouts, Some(dataset))
    };
    // Those of a statistic stand above the recipe of its scan.
    let options = SindyOptions::new(&recipe.sindy)?.within(&recipe)?;
    let mut notes = std::mem::take(&mut evidence.notes);
    let solver = Solver::new(&evidence, &options, request.front, &mut notes)?;
    let (targets, count) = (evidence.task.fitted.len(), evidence.scan.regions());
    progress.expect(work::work(&options, evidence.task.candidates(), targets, count, solver.folds()));
    let regions: Vec<Vec<Solved>> =
        (0..count).map(|region| solver.solve(region, &mut notes, progress)).collect::<Result<_, _>>()?;
    let method = match &evidence.partition {
        None => format!("sindy {}", options.optimizer.name()),
        Some(partition) => format!("sindy {}, {}", options.optimizer.name(), partition.specification),
    };
    let mut provenance = evidence.provenance(&method, &recipe, options.seed);
    let mut chosen: Vec<Mat<f64>> = regions.iter().map(|region| coefficients(region, |found| &found.step)).collect();
    let smoothed =
        smoothed::smoothed(&recipe, &options, &evidence, &chosen[0], dataset.as_ref(), (&mut notes, progress))?;
    let plain = chosen.clone();
    if let Some(found) = smoothed.as_ref().filter(|found| found.told.written) {
        provenance.method.push_str(", smoothed states");
        chosen = vec![found.coefficients.clone()];
    }
    let model_of = |chosen: &[Mat<f64>]| {
        evidence.task.model(&evidence.scan, evidence.partition.as_ref(), chosen, provenance.clone())
    };
    let mut model = model_of(&chosen);
    refuse_not_finite(&model)?;
    let front = if request.front && regions.len() == 1 {
        front_models(&evidence, &regions[0], &provenance)
    } else {
        Vec::new()
    };
    let folds = (solver.folds(), solver.fold_rule());
    let mut report = report(&evidence, &options, folds, &regions, &plain, notes);
    if let Some(free) = limits::free(&evidence, solver, progress)? {
        limits::tell(&evidence, &regions, &free, &mut report);
    }
    if let Some(found) = &smoothed {
        if found.told.written {
            found.tell(&evidence, &mut report);
        }
        report.smoothing = Some(found.told.clone());
    }
    report.rollouts = rollouts;
    report.refinement = refined::refined(&recipe, &options, &evidence, &model, dataset.as_ref(), progress)?;
    report.notes.extend(objective::note(options.objective, report.refinement.as_ref()));
    if let Some(found) = report.refinement.clone().filter(|found| found.written) {
        model = model_of(&coefficients_of(&found.fitted.model, &evidence.task, regions.len()));
        report.refine(&evidence.task, &model, &found);
    }
    Ok(SindyFitted { model, report, front })
}

/// Coefficients (candidates x equations) of a model of every equation.
fn coefficients<'a>(
    region: &'a [Solved],
    of: impl Fn(&'a Solved) -> &'a fleetfoot_sparse::threshold::Step,
) -> Mat<f64> {
    let p = region.first().map_or(0, |found| found.step.coefficients.len());
    Mat::from_fn(p, region.len(), |j, t| of(&region[t]).coefficients[j])
}

/// For every number of terms on any equation's front the model in which each equation has its best with at most so many.
fn front_models(evidence: &Evidence, region: &[Solved], provenance: &Provenance) -> Vec<(usize, Model)> {
    let terms = |found: &Solved, k: usize| found.sweep.trail.steps[k].terms();
    let sizes: std::collections::BTreeSet<usize> =
        region.iter().flat_map(|found| found.sweep.front.iter().map(|&k| terms(found, k))).collect();
    let model = |size: usize| {
        let b = coefficients(region, |found| {
            let front = &found.sweep.front;
            let best = front.iter().rev().find(|&&k| terms(found, k) <= size).or(front.first());
            best.map_or(&found.step, |&k| &found.sweep.trail.steps[k])
        });
        (size, evidence.task.model(&evidence.scan, None, &[b], provenance.clone()))
    };
    sizes.into_iter().map(model).collect()
}

fn report(
    evidence: &Evidence,
    options: &SindyOptions,
    (folds, fold_rule): (usize, Option<&str>),
    regions: &[Vec<Solved>],
    chosen: &[Mat<f64>],
    mut notes: Vec<String>,
) -> SindyReport {
    let (task, scan, counts) = (&evidence.task, &evidence.scan, evidence.scan.counts());
    let clusters = if evidence.episodes.len() >= ENOUGH_EPISODES { Clusters::Episodes } else { Clusters::Chunks };
    let found = regions.iter().enumerate().map(|(region, solved)| {
        // What a bound holds is no estimate.
        let supports: Vec<Vec<usize>> =
            solved.iter().enumerate().map(|(target, found)| limits::loose(task, target, found)).collect();
        let b = chosen[region].as_ref();
        let errors = system_errors(scan, region, task.constant, b, &supports, clusters);
        if let Err(error) = &errors {
            notes.push(format!("no standard errors: {error}"));
        }
        let problem = scan.root(region).compressed(task.constant);
        let equations = solved.iter().enumerate().map(|(target, found)| {
            let error = |j: usize| errors.as_ref().map_or(f64::NAN, |errors| errors[(j, target)]);
            report::equation(task, target, found, &problem, error)
        });
        RegionReport { name: evidence.region_name(region), rows: scan.rows(region), equations: equations.collect() }
    });
    let regions = found.collect();
    SindyReport {
        rows: (0..scan.regions()).map(|region| scan.rows(region)).sum(),
        episodes: evidence.episodes.len(),
        left_out: [counts.at_border, counts.incomplete, scan.unassigned()],
        method: options.method_in_words(),
        choice: options.choice_in_words(fold_rule),
        folds,
        fold_rule: fold_rule.map(str::to_owned),
        ensemble: options.ensemble_in_words(),
        windows: evidence.windows_in_words(),
        parameters: evidence.parameters.clone(),
        candidates: (0..task.candidates()).map(|j| task.candidate(j)).collect(),
        regions,
        rollouts: None,
        refinement: None,
        smoothing: None,
        limits: Vec::new(),
        notes,
    }
}

#[cfg(test)]
mod tests;

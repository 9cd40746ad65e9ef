//! Piecewise-affine models: a map for every region of a partition, of several partitions the one with the lowest
//! held-out error.

mod options;
mod report;
mod residuals;
mod statistic;

use std::sync::Arc;

use fleetfoot_data::setting::{DEGREE, FOLDS, LAGS};
use fleetfoot_data::{Progress, Source, Work};
use fleetfoot_dataset::{Dataset, Logs, ReadPlan, StatisticFile, open};
use fleetfoot_estimate::Hold;
use fleetfoot_library::Expr;
use fleetfoot_model::{Model, Prediction, RadialFunctions};
use fleetfoot_pwa::{Identification, Options, Problem, Selection, Shrinkage};
use fleetfoot_recipe::{Derivative, Objective, Recipe};
use fleetfoot_task::Task;
pub use options::PwaOptions;
pub use report::PwaReport;
use residuals::move_residuals;
use statistic::Summed;
pub(crate) use statistic::served;

use crate::{
    error::Error,
    method::{Data, FitRequest, Fitted, Method, Rival, RowFacts},
    objective,
    objective::{Beginning, Refinement, simulation_cost},
    plan::FitPlan,
    radial,
    rollout_choice::{RolloutRule, candidates, open_spans, settled},
    summary::FitSummary,
    worth::{NEXT, verdict, worse_than_persistence},
};

/// Passes of one identification: survey, scan, errors.
const PASSES: usize = 3;

/// `fit pwa`.
///
/// Rollouts on held-out spans choose the partition on request (`[pwa]`). They also choose a state's open span
/// (`derivative = { over = "auto" }`).
#[derive(Debug, Clone)]
pub struct Pwa {
    options: PwaOptions,
    rivals: bool,
    /// The partition that rollouts chose.
    chosen: Option<usize>,
    /// Radial functions among the candidates.
    radial: Option<RadialFunctions>,
    notes: Vec<String>,
}

impl Method for Pwa {
    const NAME: &'static str = "pwa";
    type Report = PwaReport;
    type Task = Task;
    type Sums = Option<Summed>;
    type Solution = Identification;

    fn new(recipe: &Recipe, request: &FitRequest) -> Result<Self, Error> {
        let options = PwaOptions::new(recipe)?;
        Ok(Self { options, rivals: request.rivals, chosen: None, radial: None, notes: Vec::new() })
    }

    fn plan(&self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<FitPlan, Error> {
        let centres = radial::count(recipe)?.unwrap_or(0);
        let (options, spans) = (&self.options, candidates(recipe).len());
        let recipe = &settled(recipe, None);
        let (task, reading, notes) = match open::estimate(recipe, &options.labels(), logs, progress)? {
            Some((task, columns, cost)) => (task, ReadPlan::of_messages(logs, columns, &cost), Vec::new()),
            None => {
                let (dataset, task) = Dataset::for_recipe(recipe, &options.labels(), logs, progress)?;
                (task, ReadPlan::of_tables(logs, &dataset), dataset.notes().to_vec())
            }
        };
        let mut identification = options.identification.clone();
        identification.partitions = options.partitions(reading.rows as u64, task.problem.library.len() + 1 + centres);
        let cost = fleetfoot_pwa::cost(&task.problem, &identification, reading.rows);
        let partitions = &identification.partitions;
        let clustered = match cost.clustered_rows {
            0 => "none".to_owned(),
            sample if sample < reading.rows => format!("a sample of {sample} rows"),
            _ => "all rows".to_owned(),
        };
        let mut details = vec![format!("clustered: {clustered}")];
        // The training rows of a fold are fewer, so that its passes are less than the fit's own.
        let choice_passes = options.rollouts.map_or(0, |rule| PASSES * rule.folds * spans);
        details.extend(options.rollouts.map(|RolloutRule { horizon, folds, starts }| {
            format!(
                "{choice_passes} of the passes are for the choice: {} x {folds} x {starts} rollouts of {horizon} steps at most",
                spans * partitions.len()
            )
        }));
        Ok(FitPlan {
            equations: task
                .problem
                .equations
                .iter()
                .filter(|equation| equation.target.is_some())
                .map(|equation| equation.label())
                .collect(),
            candidates: task.problem.library.len() + centres,
            regions: partitions.iter().map(|partition| partition.clusters().unwrap_or(1)).max().unwrap_or(1),
            passes: cost.passes + choice_passes + usize::from(centres > 0),
            simulations: self.simulations(),
            smoothing: None,
            memory: cost.bytes,
            work: work(&task.problem, &cost),
            details,
            reading,
            notes,
        })
    }

    fn objective(&self) -> Objective {
        self.options.objective
    }

    fn simulations(&self) -> Option<String> {
        let fitted = &self.options.identification;
        simulation_cost(self.options.objective, PASSES, fitted.stability.is_some() || !fitted.ports.is_empty())
    }

    fn open(&mut self, recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Dataset, Task), Error> {
        let (dataset, mut task) = Dataset::for_recipe(recipe, &self.options.labels(), logs, progress)?;
        let view = dataset.view()?;
        let clustering = (self.options.identification.seed, &view as &dyn Source);
        self.radial = radial::functions(recipe, &task.variables, &task.problem, clustering, &mut self.notes, progress)?;
        drop(view);
        task.problem.library.extend(self.radial.iter().flat_map(RadialFunctions::expressions));
        let rows = dataset.episodes().iter().map(|episode| episode.rows as u64).sum();
        self.options.identification.partitions = self.options.partitions(rows, task.problem.library.len() + 1);
        Ok((dataset, task))
    }

    fn of_statistic(
        &self,
        recipe: &Recipe,
        _scanned: &Recipe,
        file: &Arc<StatisticFile>,
        notes: &mut Vec<String>,
        _: &dyn Progress,
    ) -> Result<(Task, Self::Sums), Error> {
        let (task, summed) = Summed::new(recipe, &self.options, file, notes)?;
        Ok((task, Some(summed)))
    }

    /// The recipe unchanged, which gives the model again.
    fn carried(&self, recipe: &Recipe, _over: Option<u32>) -> Recipe {
        recipe.clone()
    }

    fn rollouts(&self) -> Option<RolloutRule> {
        self.options.rollouts
    }

    fn with_span(&self, recipe: &Recipe, task: &Task, over: Option<u32>) -> Task {
        Task { problem: spanned(recipe, &task.problem, over), ..task.clone() }
    }

    fn trials(&self, data: Data<'_, Task>, progress: &dyn Progress) -> Result<Vec<(String, Model)>, Error> {
        let mut trial = self.of(data);
        (trial.folds, trial.keep_all, trial.tsqr) = (0, true, false);
        let identification = fleetfoot_pwa::identify(&data.task.problem, &trial, data.rows()?, progress)?;
        Ok(trial.partitions.iter().map(ToString::to_string).zip(identification.models).collect())
    }

    fn take(&mut self, trial: usize) {
        self.chosen = Some(trial % self.options.identification.partitions.len());
    }

    fn sum(&self, _: Data<'_, Task>, _: &mut Vec<String>, _: &dyn Progress) -> Result<Self::Sums, Error> {
        Ok(None)
    }

    fn find(
        &self,
        data: Data<'_, Task>,
        sums: &Self::Sums,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Vec<Identification>, Error> {
        let (problem, options) = (&data.task.problem, self.of(data));
        let mut identification = match sums {
            Some(summed) => summed.identify(problem, &options)?,
            None => {
                let rows = data.rows()?;
                progress.expect(work(problem, &fleetfoot_pwa::cost(problem, &options, rows.rows())));
                fleetfoot_pwa::identify(problem, &options, rows, progress)?
            }
        };
        let text = data.recipe.to_toml();
        for model in std::iter::once(&mut identification.model).chain(&mut identification.models) {
            model.training.recipe.clone_from(&text);
            if let Some(radial) = &self.radial {
                radial.gather(model);
            }
        }
        notes.extend_from_slice(&self.notes);
        notes.extend(options::unused(data.recipe));
        if self.options.tried {
            // Candidates that the recipe did not name are no news, unless one of them is written.
            let chosen = identification.candidates[identification.chosen].specification.to_string();
            let others =
                identification.partition_notes.iter().filter(|note| note.is_of_few_rows() && note.place != chosen);
            let others: Vec<String> = others.map(ToString::to_string).collect();
            identification.notes.retain(|note| !others.contains(note));
        }
        notes.append(&mut identification.notes);
        Ok(vec![identification])
    }

    fn model(identification: &Identification) -> &Model {
        &identification.model
    }

    fn beginning(&self, data: Data<'_, Task>, identification: &Identification) -> Result<Beginning, Error> {
        let stability = identification.candidates[identification.chosen].stability.as_ref();
        let hold = stability.map(|stability| objective::Bound::new(&data.task.problem, stability)).transpose()?;
        Ok((identification.model.clone(), hold.map(|hold| Box::new(hold) as Box<dyn Hold>)))
    }

    fn again(
        &self,
        data: Data<'_, Task>,
        identification: &Identification,
        progress: &dyn Progress,
    ) -> Result<Beginning, Error> {
        let chosen = &identification.candidates[identification.chosen];
        let mut trial = self.of(data);
        (trial.folds, trial.keep_all, trial.tsqr) = (0, false, false);
        trial.partitions = vec![chosen.specification.clone()];
        (trial.selection, trial.shrinkage) = (Selection::Given(0), Shrinkage::Rows(chosen.shrinkage));
        self.beginning(data, &fleetfoot_pwa::identify(&data.task.problem, &trial, data.rows()?, progress)?)
    }

    fn held_out_by_time(
        &self,
        data: Data<'_, Task>,
        identification: &Identification,
        progress: &dyn Progress,
    ) -> Option<Result<Model, Error>> {
        identification.held_out.then(|| Ok(self.again(data, identification, progress)?.0))
    }

    fn refine(
        &self,
        data: Data<'_, Task>,
        _: &Self::Sums,
        identification: &mut Identification,
        refinement: &mut Refinement,
    ) -> Result<(), Error> {
        if let Some(stability) = &identification.candidates[identification.chosen].stability {
            let bound = objective::Bound::new(&data.task.problem, stability)?;
            refinement.bound = Some(bound.stability_of(stability, &refinement.fitted.model));
        }
        if refinement.written {
            let before = std::mem::replace(&mut identification.model, refinement.fitted.model.clone());
            move_residuals(&before, &mut identification.model, &identification.roots);
            // That of the coefficients before.
            identification.model.partitions.iter_mut().for_each(|partition| partition.correlation = None);
        }
        Ok(())
    }

    fn expressions(&self, task: &Task) -> Vec<Expr> {
        let problem = &task.problem;
        let targets = problem.equations.iter().filter_map(|equation| equation.target.as_ref());
        let phase = task.phase.iter().map(|phase| &phase.column);
        let also = problem.partition_columns.iter().chain(&problem.weight).chain(phase);
        let labels = self.options.labels().into_iter().map(Expr::column);
        problem.library.iter().chain(targets).chain(also).cloned().chain(labels).collect()
    }

    fn facts(&self, data: Data<'_, Task>, sums: &Self::Sums, identification: &Identification) -> RowFacts {
        let concentrated = identification.targets.iter().cloned().zip(identification.concentrated.iter().cloned());
        let episodes = match (data.rows, sums) {
            (Some(rows), _) => rows.episodes().len(),
            (None, summed) => summed.as_ref().map_or(0, Summed::episodes),
        };
        RowFacts {
            episodes,
            left_out: vec![identification.at_border, identification.incomplete],
            concentrated: concentrated.collect(),
        }
    }

    fn report(
        &self,
        _: Data<'_, Task>,
        _: &Self::Sums,
        identification: Identification,
        mut summary: FitSummary,
        _: &dyn Progress,
    ) -> Result<Fitted<PwaReport>, Error> {
        let chosen = &identification.candidates[identification.chosen];
        if identification.held_out {
            let errors =
                chosen.r2.iter().zip(&identification.sigma).map(|(r2, sigma)| (1.0 - r2).max(0.0).sqrt() * sigma);
            let errors = identification.targets.iter().cloned().zip(errors);
            summary.notes.extend(worse_than_persistence(&identification.model, errors, &summary.baselines));
            let shares = identification.targets.iter().cloned().zip(chosen.r2.iter().map(|r2| 1.0 - r2));
            summary.verdict = verdict("predicted", shares, summary.by_time.as_ref());
        }
        // Last, and with what to do about it.
        if let Some(poor) = chosen.no_better() {
            summary.notes.retain(|note| *note != poor);
            summary.notes.push(format!("{poor}; {NEXT}"));
        }
        let names = identification.candidates.iter().map(|candidate| candidate.specification.to_string());
        let of = |(model, name): (&Model, String)| Rival { name: Rival::part(&name), model: model.clone() };
        let rivals = identification.models.iter().zip(names).map(of).collect();
        Ok(Fitted {
            value: None,
            model: identification.model.clone(),
            rivals,
            report: PwaReport { identification, summary },
        })
    }
}

impl Pwa {
    /// Options of the fit, adapted to these rows.
    pub(crate) fn of(&self, data: Data<'_, Task>) -> Options {
        let mut options = self.options.of_step(data.step);
        options.keep_all = self.rivals;
        options.phase = data.rows.and_then(|rows| data.task.phase_in(rows.columns()));
        if let Some(chosen) = self.chosen {
            options.selection = Selection::Given(chosen);
        }
        options
    }
}

/// Work of the models of all regions and folds.
fn work(problem: &Problem, cost: &fleetfoot_pwa::Cost) -> Work {
    Work {
        operations: cost.operations,
        parts: problem.equations.iter().filter(|equation| equation.target.is_some()).count().max(1),
        mend: format!(
            "a smaller library ({DEGREE}, {LAGS}), fewer regions or fewer folds ({given_folds}) make it shorter",
            given_folds = FOLDS.to(2)
        ),
    }
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

//! Equations found in turn with the states: these are smoothed under the equations, and the terms are looked for on the smoothed states.

mod search;

use faer::Mat;
use fleetfoot_data::setting::{PARAMETERS, PARTITION, SINDY, SMOOTH_STATES, TIME_SECTION};
use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::Coefficient;
use fleetfoot_estimate::{SmoothingOptions, StateSmoother};
use fleetfoot_model::Model;
use fleetfoot_recipe::{Recipe, SmoothStates};
use fleetfoot_task::{EquationTask, Provenance, WeakForm, Windows};
use search::{Search, SearchResult};

use super::{Frozen, SindyOptions, SindyReport, StateNoise, coefficients_of, equations, report};
use crate::{
    error::Error,
    folds::smoothed_rows,
    method::Data,
    rollout_choice::{HeldOut, RolloutRule},
    sindy::{Evidence, StateSmoothing},
};

/// Equations that alternated with smoothed states.
pub(super) struct Smoothed {
    pub(super) report: StateSmoothing,
    /// Candidates x fitted equations.
    pub(super) coefficients: Mat<f64>,
    /// Their standard errors; 0 for candidates that are out.
    errors: Mat<f64>,
}

/// Rows that are smoothed by default, at most: the search takes some hundred passes over them.
const UNASKED: usize = 20_000;
/// Folds that are held out in turn.
const FOLDS: usize = 5;

/// Returns true if these equations alternate with smoothed states.
fn applies(choice: SmoothStates, evidence: &Evidence, recipe: &Recipe) -> Result<bool, Error> {
    if choice == SmoothStates::Off {
        return Ok(false);
    }
    let task = &evidence.task;
    let estimated = !evidence.parameters.is_empty();
    match (choice, obstacle(task, recipe, estimated, evidence.partition.is_some())) {
        (SmoothStates::On, Some(reason)) => Err(Error::conflict(format!(
            "{entry}, and {reason}: remove one of them",
            entry = SINDY.entry("smooth_states").is("on")
        ))),
        (SmoothStates::On, None) => Ok(true),
        (_, Some(_)) => Ok(false),
        (_, None) => Ok(task.windows.as_ref().is_some_and(Windows::noisy)),
    }
}

/// Returns true if states of so many rows may be smoothed, before their noise is known. `regions`: true with a
/// partition.
pub(super) fn may_apply(
    choice: SmoothStates,
    task: &EquationTask,
    recipe: &Recipe,
    regions: bool,
    rows: usize,
) -> bool {
    let requested = match choice {
        SmoothStates::Off => false,
        SmoothStates::On => true,
        SmoothStates::Auto => rows <= UNASKED && WeakForm::new(&recipe.sindy).is_ok_and(|form| form != WeakForm::Off),
    };
    requested && obstacle(task, recipe, false, regions).is_none()
}

/// Obstacle to state smoothing, in words.
fn obstacle(task: &EquationTask, recipe: &Recipe, estimated: bool, regions: bool) -> Option<String> {
    Some(if !task.parameters.is_empty() || estimated {
        format!("numbers inside expressions are estimated ({PARAMETERS})")
    } else if regions {
        format!("there are regions ({PARTITION})")
    } else if task.weight.is_some() {
        "rows have weights".to_owned()
    } else if recipe.time.smoothed.is_some() {
        format!("the logs were smoothed before ({})", TIME_SECTION.entry("smoothed"))
    } else if task.fitted.iter().any(|equation| equation.central.is_none()) {
        "not every equation is of a derivative by central differences".to_owned()
    } else {
        return None;
    })
}

/// Alternates between equations and smoothed states, on request; from the coefficients of a fit (candidates x
/// equations).
pub(super) fn smoothed(
    recipe: &Recipe,
    options: &SindyOptions,
    evidence: &Evidence,
    chosen: &Mat<f64>,
    rows: Option<&dyn Source>,
    (notes, progress): (&mut Vec<String>, &dyn Progress),
) -> Result<Option<Smoothed>, Error> {
    let Some(source) = rows else {
        return match options.smooth_states {
            SmoothStates::On => Err(Error::needs_rows(
                "smooth_states = on smooths the rows of logs, and a statistic has none: fit on the logs, or remove it"
                    .into(),
            )),
            SmoothStates::Auto if evidence.weak.is_some() => {
                notes.push(
                    "a statistic has no rows whose states could be smoothed: a fit on the logs may find other terms"
                        .into(),
                );
                Ok(None)
            }
            _ => Ok(None),
        };
    };
    if !applies(options.smooth_states, evidence, recipe)? {
        return Ok(None);
    }
    if options.smooth_states == SmoothStates::Auto
        && let Some(rows) = evidence.rows_read.filter(|rows| *rows > UNASKED)
    {
        notes.push(format!(
            "the states of {rows} rows are not smoothed: the automatic limit is {UNASKED} rows; {given_smooth_states} smooths more", given_smooth_states = SMOOTH_STATES.to("on")
        ));
        return Ok(None);
    }
    progress.stage("smooth states");
    match Alternation::new(recipe, options, evidence).run(chosen, source, progress) {
        Ok(smoothing) => Ok(Some(smoothing)),
        Err(error @ Error::Cancelled(_)) => Err(error),
        Err(error) if options.smooth_states == SmoothStates::On => Err(error),
        Err(error) => {
            notes.push(format!("states are not smoothed: {error}"));
            Ok(None)
        }
    }
}

struct Alternation<'a> {
    recipe: &'a Recipe,
    options: &'a SindyOptions,
    evidence: &'a Evidence,
    /// Of every coefficient that may move, the candidate and the equation.
    places: Vec<(usize, usize)>,
    /// Numbers of those that stay.
    fixed: Vec<usize>,
}

impl<'a> Alternation<'a> {
    fn new(recipe: &'a Recipe, options: &'a SindyOptions, evidence: &'a Evidence) -> Self {
        let fitted = || evidence.task.fitted.iter().enumerate();
        let allowed = |t: usize, j: usize| evidence.task.fitted[t].allowed[j];
        let candidates = evidence.task.candidates();
        let places: Vec<(usize, usize)> =
            fitted().flat_map(|(t, _)| (0..candidates).filter(move |&j| allowed(t, j)).map(move |j| (j, t))).collect();
        let stays = |&at: &usize| evidence.task.fitted[places[at].1].fixed.contains(&places[at].0);
        let fixed = (0..places.len()).filter(stays).collect();
        Self { recipe, options, evidence, places, fixed }
    }

    fn task(&self) -> &EquationTask {
        &self.evidence.task
    }

    fn smoother(&self, open: &Model, rows: &dyn Source, progress: &dyn Progress) -> Result<StateSmoother, Error> {
        let first = usize::from(self.task().constant);
        let coefficient =
            |&(j, latent): &(usize, usize)| Coefficient { region: 0, latent, function: j.checked_sub(first) };
        let candidates = self.places.iter().map(coefficient).collect();
        Ok(StateSmoother::new(open, candidates, rows, SmoothingOptions::default(), progress)?)
    }

    fn search<'b>(&'b self, smoother: &'b StateSmoother, progress: &'b dyn Progress) -> Search<'b> {
        Search { smoother, fixed: &self.fixed, progress }
    }

    /// Coefficients one a candidate that may move, of a matrix.
    fn listed(&self, matrix: &Mat<f64>) -> Vec<f64> {
        self.places.iter().map(|&place| matrix[place]).collect()
    }

    fn matrix(&self, listed: &[f64]) -> Mat<f64> {
        let mut matrix = Mat::zeros(self.task().candidates(), self.task().fitted.len());
        self.places.iter().zip(listed).for_each(|(&place, &value)| matrix[place] = value);
        matrix
    }

    fn run(&self, chosen: &Mat<f64>, view: &dyn Source, progress: &dyn Progress) -> Result<Smoothed, Error> {
        let open = self.task().open(&self.evidence.scan, self.provenance());
        let smoother = self.smoother(&open, view, progress)?;
        let search = self.search(&smoother, progress);
        let solution = search.run(&self.listed(chosen))?;
        let settled = &solution.place.settled;
        let mut errors = vec![0.0; self.places.len()];
        for (column, &at) in solution.place.support.iter().enumerate() {
            errors[at] = settled.covariance[column][column].sqrt();
        }
        let noise = smoother.states().iter().enumerate().map(|(s, state)| StateNoise {
            state: state.clone(),
            measurement: solution.variances.measurement[s].sqrt(),
            process: solution.variances.process[s].sqrt(),
        });
        let held = self.held_out(&open, &solution, view, progress)?;
        Ok(Smoothed {
            report: StateSmoothing {
                rows: smoother.rows(),
                segments: smoother.segments(),
                candidates: self.places.len(),
                noise: noise.collect(),
                value: solution.values,
                price: search.price(),
                tried: solution.supports[1],
                taken: solution.supports[0],
                promise: settled.promise,
                converged: settled.converged,
                folds: FOLDS,
                held_out: held.misfit,
                written: held.misfit[1] < held.misfit[0],
                windows: held.windows,
            },
            coefficients: self.matrix(&settled.coefficients),
            errors: self.matrix(&errors),
        })
    }

    fn provenance(&self) -> Provenance {
        self.evidence.provenance("sindy", self.recipe, self.options.seed)
    }

    /// Both ways on the training rows of every fold, and their errors on the held-out rows.
    fn held_out(
        &self,
        open: &Model,
        solution: &SearchResult,
        view: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<Held, Error> {
        let rule = RolloutRule { folds: FOLDS, ..RolloutRule::new(1) };
        let smoothed = smoothed_rows(self.recipe.time.smoothed, self.evidence.step);
        let held = HeldOut::new((view, smoothed), rule, SMOOTH_STATES.to_string())?;
        let targets = self.task().fitted.len();
        let (mut costs, mut measured) = ([0.0; 2], 0.0);
        let mut sums = vec![[0.0; 2]; targets];
        let mut weight = 0.0;
        held.each(|train, rows| {
            progress.stage("smooth states, without a fold");
            let (recipe, options, step) = (self.recipe, self.options, self.evidence.step);
            let data = |rows| Data { recipe, task: self.task(), rows: Some(rows), kept: None, step };
            let plain = equations(data(train), options, progress)?;
            let plain = coefficients_of(&plain, self.task(), 1).remove(0);
            // The variances of all rows serve, as a fold's would hardly differ; terms and coefficients are those of the training rows.
            let (deviations, share) = (&solution.variances.measurement[..], solution.share);
            let refitted = self.refitted(open, solution, train, progress)?;
            let smoother = self.smoother(open, rows, progress)?;
            let search = self.search(&smoother, progress);
            for (sum, coefficients) in costs.iter_mut().zip([&self.listed(&plain), &refitted]) {
                *sum += match search.followed(coefficients, (deviations, share)) {
                    Ok(settled) => 2.0 * settled.cost,
                    Err(error @ Error::Cancelled(_)) => return Err(error),
                    Err(_) => f64::INFINITY,
                };
            }
            measured += smoother.measured().iter().sum::<usize>() as f64;
            let frozen = Frozen { task: self.task().clone(), parameters: Vec::new() };
            let evidence = Evidence::of_rows(recipe, options.seed, frozen, step, rows, &mut Vec::new(), progress)?;
            let problem = evidence.scan.root(0).compressed(self.task().constant);
            weight += problem.weight;
            let left = problem.error(self.matrix(&refitted).as_ref());
            for (t, sum) in sums.iter_mut().enumerate() {
                *sum = [sum[0] + left[t], sum[1] + problem.total[t]];
            }
            Ok(())
        })?;
        let window = |[left, total]: [f64; 2]| [(left / weight).sqrt(), 1.0 - left / total];
        Ok(Held { misfit: costs.map(|cost| cost / measured), windows: sums.into_iter().map(window).collect() })
    }

    /// The coefficients that the rows of a fold give the terms that were found.
    fn refitted(
        &self,
        open: &Model,
        solution: &SearchResult,
        train: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<Vec<f64>, Error> {
        let smoother = self.smoother(open, train, progress)?;
        let search = self.search(&smoother, progress);
        let (deviations, share) = (&solution.variances.measurement[..], solution.share);
        Ok(search.refitted(&solution.place.settled.coefficients, (deviations, share))?.coefficients)
    }
}

/// Held-out errors.
struct Held {
    /// Without smoothing and with it.
    misfit: [f64; 2],
    /// For every equation of smoothed states: root of the mean squared error on recorded rows or windows, and the
    /// explained share of their variance.
    windows: Vec<[f64; 2]>,
}

impl Smoothed {
    /// Reports these equations in the place of those of the report: standard errors of the errors-in-variables problem,
    /// and errors on the recorded rows or windows.
    pub(super) fn tell(&self, evidence: &Evidence, report: &mut SindyReport) {
        let task = &evidence.task;
        let problem = evidence.scan.root(0).compressed(task.constant);
        let left = problem.error(self.coefficients.as_ref());
        let equations = report.regions.iter_mut().flat_map(|region| &mut region.equations);
        for (t, equation) in equations.enumerate() {
            equation.terms = (0..task.candidates())
                .filter(|&j| self.coefficients[(j, t)] != 0.0)
                .map(|j| report::TermReport {
                    function: task.candidate(j),
                    candidate: j,
                    coefficient: self.coefficients[(j, t)],
                    unit: task.coefficient_unit(t, j),
                    standard_error: self.errors[(j, t)],
                    inclusion: None,
                    fixed: task.fitted[t].fixed.contains(&j),
                })
                .collect();
            equation.right = report::right(task, t, &equation.terms);
            equation.rms = (left[t] / problem.weight).sqrt();
            equation.r2 = 1.0 - left[t] / problem.total[t];
            [equation.held_out, equation.held_out_r2] = self.report.windows[t];
            equation.parameter = equation.terms.len() as f64;
            equation.correlation = f64::NAN;
            equation.confounded.clear();
            let size = |j: usize| {
                let column = &problem.r.col_as_slice(j)[..=j];
                (column.iter().map(|value| value * value).sum::<f64>() / problem.weight).sqrt()
            };
            let contributions: Vec<(String, f64)> = (0..task.candidates())
                .filter(|&j| self.coefficients[(j, t)] != 0.0)
                .map(|j| (task.candidate(j), size(j) * self.coefficients[(j, t)]))
                .collect();
            equation.choose_beside(&contributions);
        }
    }
}

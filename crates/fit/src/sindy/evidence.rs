//! Evidence for equations: a task whose parameters are known, and the statistic of its rows.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

use fleetfoot_data::setting::{DEGREE, INFO_VALUES, LIBRARY, WEAK};
use fleetfoot_data::{EpisodeId, Progress, Source};
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_model::{Partition, TrainedEpisode};
use fleetfoot_recipe::{Recipe, Tunable};
use fleetfoot_report::words::count;
use fleetfoot_sums::system::{System, SystemPlan, SystemScan, Weak};
use fleetfoot_task::{EquationTask, FittedEquation, Provenance, WeakForm};

use super::frozen::Frozen;
use crate::{
    constant::refuse_constant_targets,
    error::Error,
    folds::{reached, smoothed_rows},
    method::Opened,
    sindy::ParameterReport,
};

/// A task and the statistic of its rows.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Evidence {
    /// The task, numbers in place of its parameters.
    pub task: EquationTask,
    /// The regions, where there are several.
    pub partition: Option<Partition>,
    /// The statistic of all rows.
    pub scan: SystemScan,
    /// The windows in the place of rows, where there are any.
    pub weak: Option<Weak>,
    /// Mean squared error of the differences that derivatives are measured by, for every fitted equation; 0 where they are measured otherwise.
    pub resolution: Vec<f64>,
    /// The part of it due to rounded stamps, for every equation that is measured by differences.
    rounding: Vec<f64>,
    /// The parameters' estimates.
    pub parameters: Vec<ParameterReport>,
    /// Sampling period, seconds.
    pub step: f64,
    /// Neighbours on either side that are made of the same samples as a row: lags, differences and smoothing reach over them.
    pub shared_rows: usize,
    /// Rows of the logs, whether they count or not; `None` from a statistic.
    pub rows_read: Option<usize>,
    /// The episodes that have rows, in the order of the identities.
    pub episodes: Vec<TrainedEpisode>,
}

/// Too few rows, or windows of them, for the candidates of an equation.
struct Few {
    /// Region; `None` if there is one only.
    region: Option<String>,
    rows: u64,
    windows: bool,
    candidates: u64,
}

impl fmt::Display for Few {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = match &self.region {
            Some(name) => format!("region {name} of the partition has"),
            None => "the data have".to_owned(),
        };
        let what = count(self.rows as usize, if self.windows { "complete window" } else { "complete row" });
        write!(f, "{place} {what} for {}", count(self.candidates as usize, "candidate"))
    }
}

impl Evidence {
    /// Reads opened logs: one pass for the statistic, one before it for a partition, and one a step for parameters. The task comes back settled.
    ///
    /// # Errors
    /// Those of the recipe, of reading, of estimating parameters and of partitions; no rows, or fewer than candidates.
    pub(super) fn of_logs(
        opened: &mut Opened<EquationTask>,
        seed: u64,
        logs: &Logs,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let Opened { recipe, task, dataset } = opened;
        refuse_large(task, dataset.rows())?;
        let before = notes.len();
        notes.extend(task.unit_notes());
        notes.extend(task.narrowed_note());
        let form = WeakForm::new(&recipe.sindy)?;
        let frozen = Frozen::differentiated(task.clone(), &dataset.view()?, notes)?;
        let mut frozen = frozen.windowed(form, &dataset.view()?, notes)?;
        frozen.estimate(dataset, notes, progress)?;
        frozen.add_radial(recipe, (seed, dataset.step(), &dataset.view()?), notes, progress)?;
        let mut evidence = Self::of_rows(recipe, seed, frozen, dataset.step(), &dataset.view()?, notes, progress)?;
        if form == WeakForm::ByNoise
            && let (Some(weak), Some(few)) = (&evidence.weak, evidence.few())
        {
            // Nobody asked for windows: where they are too few, rows are there still.
            let note = format!(
                "the noise calls for windows of {} rows ({WEAK}), but {few}: single rows are used, and noise pulls coefficients towards zero",
                weak.rows()
            );
            drop(evidence);
            notes.truncate(before);
            let mut plain = recipe.clone();
            plain.sindy.weak = Some(Tunable::Word("off".into()));
            // If numbers inside expressions were estimated, the columns are those with these numbers.
            if !task.parameters.is_empty() {
                (*dataset, *task) = Dataset::for_equations(&plain, logs, progress)?;
            }
            let carried = std::mem::replace(recipe, plain);
            let evidence = Self::of_logs(opened, seed, logs, notes, progress);
            opened.recipe = carried;
            notes.push(note);
            return evidence;
        }
        evidence.rows_read = Some(dataset.rows());
        evidence.check()?;
        task.clone_from(&evidence.task);
        Ok(evidence)
    }

    /// The evidence of rows, for choices made before their pass; the caller checks that the rows suffice
    /// ([`Evidence::check`]).
    pub(super) fn of_rows(
        recipe: &Recipe,
        seed: u64,
        frozen: Frozen,
        step: f64,
        view: &dyn Source,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let partition = frozen.partition(recipe, seed, step, view, notes, progress)?;
        progress.stage(&format!("scan of {} candidates", frozen.task.functions.len()));
        let plan = SystemPlan::new(frozen.task.summed(partition), None, view)?;
        let scan = plan.scan(view, progress)?;
        let known = view.episodes().iter().map(|episode| (episode.id, TrainedEpisode::from(episode))).collect();
        Ok(Self::new(frozen, plan.system, scan, step, &known).smoothed_over(recipe.time.smoothed))
    }

    /// The same evidence of logs that were smoothed over so many seconds before.
    pub(super) fn smoothed_over(mut self, seconds: Option<f64>) -> Self {
        self.shared_rows += smoothed_rows(seconds, self.step);
        self
    }

    /// Makes the evidence of a frozen task and the statistic of its rows. `known`: episodes by identity.
    pub(super) fn new(
        frozen: Frozen,
        system: System,
        scan: SystemScan,
        step: f64,
        known: &BTreeMap<EpisodeId, TrainedEpisode>,
    ) -> Self {
        let shared_rows = reached(system.expressions());
        let System { partition, weak, .. } = system;
        let used: BTreeSet<_> = scan.units().iter().map(|unit| unit.episode).collect();
        let Frozen { task, parameters } = frozen;
        let mut evidence = Self {
            episodes: used.iter().filter_map(|id| known.get(id).cloned()).collect(),
            resolution: Vec::new(),
            rounding: Vec::new(),
            task,
            partition,
            scan,
            weak,
            parameters,
            step,
            shared_rows,
            rows_read: None,
        };
        evidence.rounding = evidence.rounding_of();
        evidence.resolution = evidence.resolution_of(|_| 1.0);
        evidence
    }

    /// Mean squared error of the differences, with a margin, on the units of positive weight; that on all rows where none of theirs was sampled.
    pub(super) fn resolution_of(&self, weight: impl Fn(usize) -> f64) -> Vec<f64> {
        if let Some(weak) = &self.weak {
            return self.integrals_of(weak);
        }
        let mut squares = self.scan.sampled_mean_squares(weight).into_iter().zip(&self.rounding);
        let mut of = |equation: &FittedEquation| match equation.difference.as_ref().and_then(|_| squares.next()) {
            Some((square, rounding)) => square.max(*rounding),
            None => 0.0,
        };
        self.task.fitted.iter().map(|equation| MARGIN * of(equation)).collect()
    }

    /// Mean squared error of differences, of the equations that are measured by them, that comes of rounded stamps alone.
    ///
    /// Error of rounded stamps. A stamp is known to half a unit in its last place: at the end of an episode of n rows
    /// epsilon n of a sampling period. No difference is known better.
    fn rounding_of(&self) -> Vec<f64> {
        let mut rows = BTreeMap::<EpisodeId, u64>::new();
        self.scan.units().iter().for_each(|unit| *rows.entry(unit.episode).or_default() += unit.rows);
        let relative = f64::EPSILON * rows.values().copied().max().unwrap_or(0) as f64;
        let differences = (0..self.task.fitted.len()).filter(|&t| self.task.fitted[t].difference.is_some());
        self.mean_squares(differences).into_iter().map(|square| relative.powi(2) * square).collect()
    }

    /// Mean squares of targets over all rows.
    fn mean_squares(&self, targets: impl Iterator<Item = usize>) -> Vec<f64> {
        let roots: Vec<_> = (0..self.scan.regions()).map(|region| self.scan.root(region)).collect();
        let weight = roots.iter().map(|root| root.weight).sum::<f64>().max(f64::MIN_POSITIVE);
        targets.map(|t| roots.iter().map(|root| root.total[t]).sum::<f64>() / weight).collect()
    }

    /// Mean squared error of integrals over windows, with the same margin.
    fn integrals_of(&self, weak: &Weak) -> Vec<f64> {
        let squares = self.mean_squares(0..self.task.fitted.len());
        squares.into_iter().map(|square| MARGIN * weak.accuracy.powi(2) * square).collect()
    }

    /// Provenance that a model of this evidence carries.
    pub fn provenance(&self, method: &str, recipe: &Recipe, seed: u64) -> Provenance {
        Provenance {
            method: method.to_owned(),
            recipe: recipe.to_toml(),
            seed,
            step: self.step,
            episodes: self.episodes.clone(),
        }
    }

    /// Name of a region.
    pub fn region_name(&self, region: usize) -> String {
        self.partition.as_ref().map_or_else(|| "all".to_owned(), |partition| partition.region_name(region))
    }

    /// Refuses windows that are too long for the rows.
    fn check_windows(&self, weak: &Weak, windows: u64) -> Result<(), Error> {
        let (counts, most, rows) = (self.scan.counts(), self.task.most_allowed() as u64, weak.rows());
        if windows > most {
            return Ok(());
        }
        Err(Error::too_few_rows(
            windows,
            most + 1,
            format!(
                "windows of {rows} rows ({given_weak}): {windows} are complete for {most} candidates, {} reach over the border of their episode and {} lack a value; \
                 give a smaller number of rows ({WEAK}), name fewer candidates ({LIBRARY}, {DEGREE}), or give longer episodes",
                counts.at_border,
                counts.incomplete,
                given_weak = WEAK.to(rows)
            ),
        ))
    }

    /// Refuses evidence that gives no equation.
    pub(super) fn check(&self) -> Result<(), Error> {
        let rows: u64 = (0..self.scan.regions()).map(|region| self.scan.rows(region)).sum();
        let counts = self.scan.counts();
        if let Some(weak) = &self.weak {
            self.check_windows(weak, rows)?;
        }
        if rows == 0 {
            return Err(Error::too_few_rows(
                0,
                1,
                format!(
                    "no rows: {} lack neighbours at the border of their episode, {} lack a value, and the others have the weight 0; \
                 {INFO_VALUES} tells which columns have missing values",
                    counts.at_border, counts.incomplete
                ),
            ));
        }
        match self.few() {
            None => refuse_constant_targets(&self.task, self.scan.also()),
            Some(few) => {
                let regions = if self.scan.regions() > 1 { ", or fewer regions" } else { "" };
                let windows = if self.weak.is_some() {
                    format!(", or use single rows ({given_weak})", given_weak = WEAK.to("off"))
                } else {
                    String::new()
                };
                let mend =
                    format!("{few}; name fewer candidates ({LIBRARY}, {DEGREE}){regions}{windows}, or give more data");
                Err(Error::too_few_rows(few.rows, few.candidates + 1, mend))
            }
        }
    }

    /// The region of the fewest rows, where these are no more than candidates.
    fn few(&self) -> Option<Few> {
        let candidates = self.task.most_allowed() as u64;
        let rows = (0..self.scan.regions()).map(|region| (region, self.scan.rows(region)));
        let (region, rows) = rows.min_by_key(|(_, rows)| *rows).unwrap_or((0, 0));
        let region = (self.scan.regions() > 1).then(|| self.region_name(region));
        (rows <= candidates).then_some(Few { region, rows, windows: self.weak.is_some(), candidates })
    }

    /// The windows that take the place of rows, for people.
    pub(super) fn windows_in_words(&self) -> Option<String> {
        let weak = self.weak.as_ref()?;
        let why = match self.task.windows.as_ref().and_then(|windows| windows.noise.as_ref()) {
            Some((label, share)) => {
                format!("; noise is {:.0} % of the variance of the differences for {label}", 100.0 * share)
            }
            None => String::new(),
        };
        Some(format!(
            "weak form: rows and errors below are those of windows of {} rows, one every {}{why}",
            weak.rows(),
            match weak.stride() {
                1 => "row".to_owned(),
                stride => format!("{stride} rows"),
            }
        ))
    }
}

/// Factor on the estimated mean squared error of differences below which models are not compared: twice the error. (The
/// error of noise is estimated at 0.14 of its true value, so that models of noisy rows stand well above it.)
const MARGIN: f64 = 4.0;

/// Refuses a library that the rows cannot carry, before they are read.
fn refuse_large(task: &EquationTask, rows: usize) -> Result<(), Error> {
    let most = task.most_allowed();
    if rows <= most {
        return Err(Error::too_few_rows(
            rows as u64,
            most as u64 + 1,
            format!(
                "the data have {rows} rows for {most} candidates of one equation; name fewer candidates ({LIBRARY}, {DEGREE}), or give more data"
            ),
        ));
    }
    Ok(())
}

//! What equations are fitted on: a task whose parameters are known, and the statistic of its rows.

use std::collections::{BTreeMap, BTreeSet};

use faer::ColRef;
use fleetfoot_data::{Episode, Progress, Source};
use fleetfoot_model::Partition;
use fleetfoot_pwa::{Problem, Specification};
use fleetfoot_sparse::system::{
    SampledChunks, System, SystemPlan, SystemScan, Unit, sampled_by_chunk, sampled_mean_squares,
};

use super::{EquationTask, FittedEquation, ParameterReport, Provenance, estimation};
use crate::{Dataset, Error, Logs, Recipe, left_out::left_out, not_finite};

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
    /// Mean squared error of the differences that derivatives are measured by, for every fitted equation; 0 where they are measured otherwise.
    pub resolution: Vec<f64>,
    /// The same on the rows of every unit of the scan: how many were sampled, and the mean over them (equations); `None` where none were.
    pub(super) resolution_by_unit: Vec<Option<(usize, Vec<f64>)>>,
    /// The parameters' estimates.
    pub parameters: Vec<ParameterReport>,
    /// Sampling period, seconds.
    pub step: f64,
    /// Identities and names of the episodes that have rows.
    pub episodes: Vec<(String, String)>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Evidence {
    /// Reads logs: one pass for the statistic, one before it for a partition, and one a step for parameters.
    ///
    /// # Errors
    /// Those of the recipe, of reading, of estimating parameters and of partitions; no rows, or fewer than candidates.
    pub fn of_logs(recipe: &Recipe, seed: u64, logs: &Logs, progress: &dyn Progress) -> Result<Self, Error> {
        let (mut dataset, mut task) = Dataset::for_equations(recipe, logs, progress)?;
        refuse_large(&task, dataset.rows())?;
        let mut notes = dataset.notes().to_vec();
        notes.extend(task.unit_notes());
        task = task.differentiated(&dataset.view()?, &mut notes)?;
        let mut parameters = Vec::new();
        if !task.parameters.is_empty() {
            progress.stage("parameters");
            let found = estimation::estimate(&task, &dataset.view()?, &mut notes, progress)?;
            let values: BTreeMap<String, f64> =
                found.iter().map(|parameter| (parameter.name.clone(), parameter.value)).collect();
            task = task.settled(&values);
            dataset.see(&task.aliases);
            parameters = found;
        }
        let mut found = Self::of_rows(recipe, seed, task, dataset.step(), &dataset.view()?, progress)?;
        found.parameters = parameters;
        notes.append(&mut found.notes);
        found.notes = notes;
        found.check().map_err(|error| not_finite::with_reasons(error, &dataset, found.task.row_functions()))?;
        found.notes.extend(left_out(found.scan.counts().incomplete, &dataset, found.task.row_functions())?);
        Ok(found)
    }

    /// The evidence of rows, for a task without parameters; whether they are enough is for the caller to look at ([`Evidence::check`]).
    pub(super) fn of_rows(
        recipe: &Recipe,
        seed: u64,
        task: EquationTask,
        step: f64,
        view: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let mut notes = Vec::new();
        let partition = partition(recipe, &task, seed, step, view, &mut notes, progress)?;
        progress.stage("scan");
        let system = System { partition: partition.clone(), ..task.system() };
        let plan = SystemPlan::new(system, None, view)?;
        let scan = plan.scan(view, progress)?;
        let used: BTreeSet<_> = scan.units().iter().map(|unit| unit.episode).collect();
        let mut seen = BTreeSet::new();
        let name = |episode: &Episode| (episode.id.to_string(), episode.name.clone());
        let episodes = view.episodes().iter().filter(|episode| used.contains(&episode.id) && seen.insert(episode.id));
        let episodes = episodes.map(name).collect();
        let resolution = task.resolution(view)?;
        let mut by_chunk = task.resolution_by_chunk(view, plan.chunk_rows)?;
        let of = |unit: &Unit| by_chunk.remove(&(unit.episode, unit.chunk));
        let resolution_by_unit = scan.units().iter().map(of).collect();
        Ok(Self {
            task,
            partition,
            scan,
            resolution,
            resolution_by_unit,
            parameters: Vec::new(),
            step,
            episodes,
            notes,
        })
    }

    /// Mean squared error of the differences on the units of positive weight; that on all rows where none of theirs was sampled.
    pub(super) fn resolution_of(&self, weights: ColRef<'_, f64>) -> Vec<f64> {
        let mut sums = vec![0.0; self.resolution.len()];
        let mut rows = 0;
        for (unit, found) in self.resolution_by_unit.iter().enumerate() {
            if let Some((count, squares)) = found.as_ref().filter(|_| weights[unit] > 0.0) {
                rows += count;
                sums.iter_mut().zip(squares).for_each(|(sum, square)| *sum += *count as f64 * square);
            }
        }
        if rows == 0 {
            return self.resolution.clone();
        }
        sums.iter().map(|sum| sum / rows as f64).collect()
    }

    /// What a model of this evidence carries.
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

    /// Refuses what no equation can come of.
    pub(super) fn check(&self) -> Result<(), Error> {
        let rows: u64 = (0..self.scan.regions()).map(|region| self.scan.rows(region)).sum();
        let counts = self.scan.counts();
        if rows == 0 {
            return Err(Error::too_few_rows(
                0,
                1,
                format!(
                    "no rows: {} lack neighbours at the border of their episode, {} lack a value, and the others have the weight 0; \
                 `fleetfoot info --values` tells which columns have missing values",
                    counts.at_border, counts.incomplete
                ),
            ));
        }
        let most = self.task.most_allowed() as u64;
        let (region, least) = (0..self.scan.regions())
            .map(|region| (region, self.scan.rows(region)))
            .min_by_key(|(_, rows)| *rows)
            .unwrap_or((0, rows));
        if least <= most {
            let place = if self.scan.regions() > 1 {
                format!("region {} of the partition", self.region_name(region))
            } else {
                "the data".to_owned()
            };
            return Err(Error::too_few_rows(
                least,
                most + 1,
                format!(
                    "{place} have {least} complete rows for {most} candidates; name fewer candidates (--library, --degree){}, or give more data",
                    if self.scan.regions() > 1 { ", or fewer regions" } else { "" }
                ),
            ));
        }
        Ok(())
    }
}

/// Of a mean squared error of differences, as it is estimated, what models are not compared below: twice the error. (That of noise is estimated at 0.14 of what it
/// is, so that models of noisy rows stand well above it.)
const MARGIN: f64 = 4.0;

impl EquationTask {
    /// The mean squared error, with a margin, of the differences that derivatives are measured by; from a sample of the rows.
    fn resolution(&self, source: &dyn Source) -> Result<Vec<f64>, Error> {
        let errors: Vec<_> = self.fitted.iter().filter_map(|equation| equation.difference.clone()).collect();
        let mut found = sampled_mean_squares(&errors, source)?.into_iter();
        let of = |equation: &FittedEquation| equation.difference.as_ref().and_then(|_| found.next()).unwrap_or(0.0);
        Ok(self.fitted.iter().map(of).map(|square| MARGIN * square).collect())
    }

    /// The same chunk by chunk, with the rows that were sampled.
    fn resolution_by_chunk(&self, source: &dyn Source, chunk_rows: usize) -> Result<SampledChunks, Error> {
        let errors: Vec<_> = self.fitted.iter().filter_map(|equation| equation.difference.clone()).collect();
        if errors.is_empty() {
            return Ok(SampledChunks::new());
        }
        let mut by_chunk = sampled_by_chunk(&errors, source, chunk_rows)?;
        for (_, squares) in by_chunk.values_mut() {
            let mut found = std::mem::take(squares).into_iter();
            let of = |equation: &FittedEquation| equation.difference.as_ref().and_then(|_| found.next()).unwrap_or(0.0);
            *squares = self.fitted.iter().map(of).map(|square| MARGIN * square).collect();
        }
        Ok(by_chunk)
    }

    /// What is summed, in one region.
    pub fn system(&self) -> System {
        System {
            also: self.also(),
            weight: self.weight.clone(),
            ..System::new(self.functions.clone(), self.fitted.iter().map(|equation| equation.target.clone()).collect())
        }
    }
}

/// Refuses a library that the rows cannot carry, before they are read.
fn refuse_large(task: &EquationTask, rows: usize) -> Result<(), Error> {
    let most = task.most_allowed();
    if rows <= most {
        return Err(Error::too_few_rows(
            rows as u64,
            most as u64 + 1,
            format!(
                "the data have {rows} rows for {most} candidates of one equation; name fewer candidates (--library, --degree), or give more data"
            ),
        ));
    }
    Ok(())
}

/// The regions that the recipe asks for; `None` for one.
fn partition(
    recipe: &Recipe,
    task: &EquationTask,
    seed: u64,
    step: f64,
    source: &dyn Source,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Option<Partition>, Error> {
    let Some(specification) = specification(recipe)? else { return Ok(None) };
    let problem = Problem {
        columns: task.columns.clone(),
        library: task.functions.clone(),
        equations: task.equations.clone(),
        partition_columns: task.partition_columns.clone(),
        weight: task.weight.clone(),
        step,
    };
    let mut options = fleetfoot_pwa::Options::default();
    options.partitions = vec![specification];
    options.seed = seed;
    let mut found = fleetfoot_pwa::partition(&problem, &options, source, progress)?;
    notes.append(&mut found.notes);
    Ok(found.partitions.pop().map(|(_, partition)| partition))
}

/// The one partition that a recipe asks for; `None` for one region.
pub(super) fn specification(recipe: &Recipe) -> Result<Option<Specification>, Error> {
    let Some(text) = &recipe.model.partition else { return Ok(None) };
    let mut list = Specification::parse_list(text)?;
    match (list.pop(), list.is_empty()) {
        (Some(Specification::Average), true) => Ok(None),
        (Some(Specification::Null), true) => Err(Error::value(
            "--partition null: a null model has no equations; write average, zscore:1.5, kmeans:5 or labels:COLUMN"
                .into(),
        )),
        (Some(one), true) => Ok(Some(one)),
        _ => Err(Error::value(format!(
            "--partition {text}: equations are fitted in the regions of one partition; name one, and compare models with `fleetfoot score`"
        ))),
    }
}

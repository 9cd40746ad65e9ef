//! A piecewise-affine model from a `.stats` file: no pass.

use faer::{Mat, MatRef};
use fleetfoot_data::setting::{
    CONTINUOUS, FIT_PWA, PARTITION, PHASE, PWA, SCAN, SCORE, SELECT, SINDY, TSQR, UNSEEN_LABELS,
};
use fleetfoot_dataset::{EpisodeRecord, StatisticFile};
use fleetfoot_model::{Partition, UnseenLabel};
use fleetfoot_pwa::{
    Identification, Options, Problem, Specification, Summed as Sums, SummedPartition, SummedRows, identify_summed,
};
use fleetfoot_recipe::Recipe;
use fleetfoot_sparse::{inference::system_effective_rows, select::Folds};
use fleetfoot_stats::{FoldRule, Purge, SquareRoot};
use fleetfoot_sums::system::SystemScan;
use fleetfoot_task::{Task, piecewise};

use super::{PwaOptions, options::TRIED};
use crate::{error::Error, folds::reached, incomplete::in_no_region, radial, sindy::keys};

/// The sums of a statistic, in the regions that were frozen with its plan.
pub struct Summed {
    /// Of one region.
    whole: Part,
    /// Of every partition.
    parts: Vec<(Specification, Part)>,
    rows: SummedRows,
}

impl Summed {
    /// The sums that answer for a fit, and its task.
    ///
    /// # Errors
    /// Those of the recipe; a question that needs rows; targets, functions or regions that were not summed; folds that the chunks are too long for.
    pub(super) fn new(
        recipe: &Recipe,
        requested: &PwaOptions,
        file: &StatisticFile,
        notes: &mut Vec<String>,
    ) -> Result<(Task, Self), Error> {
        radial::refuse_statistic(recipe)?;
        refuse_rows(requested)?;
        let options = requested.of_step(file.step());
        let without_partition = recipe.model.partition.is_none();
        let partitions = if without_partition { vec![Specification::Average] } else { options.partitions.clone() };
        let expanded = recipe.expand(&file.fields)?;
        let part = |one: &Specification| Part::new(file, &expanded, one, &options);
        let parts =
            partitions.into_iter().map(|one| Ok((one.clone(), part(&one)?))).collect::<Result<Vec<_>, Error>>()?;
        let whole = part(&Specification::Average)?;
        notes.push(
            format!("absolute errors and Mahalanobis scores need rows, which a statistic lacks: only R2 and the loss are reported; {SCORE} computes the others on logs"),
        );
        for (one, part) in &parts {
            notes.extend(in_no_region(&one.to_string(), &part.scan, whole.scan.counts().complete));
        }
        if without_partition {
            notes.push(format!(
                "the statistic has one region: {scan_command} sums those that are tried on logs",
                scan_command = SCAN.with(PARTITION.to(TRIED))
            ));
        }
        let clustered = parts.iter().any(|(one, _)| one.clusters().is_some());
        let section = &recipe.pwa;
        if clustered && (section.seed.is_some() || section.restarts.is_some() || section.iterations.is_some()) {
            notes.push(format!("{PWA} seed, restarts and iterations are not used: the regions are those of the scan, with the seed of {SINDY}"));
        }
        if clustered && whole.folds.is_some() {
            notes.push(
                "every fold has the regions of the scan, clustered on all rows; a fit on logs clusters the training rows of each fold, so its held-out losses differ"
                    .into(),
            );
        }
        let task = Task::resolve(&expanded, &file.fields, &requested.labels(), file.step())?;
        let rows = whole.rows(file);
        Ok((task, Self { whole, parts, rows }))
    }

    /// Episodes that were summed.
    pub(super) fn episodes(&self) -> usize {
        self.rows.episodes.len()
    }

    /// Fits them.
    ///
    /// # Errors
    /// Those of solving; too few rows.
    pub(super) fn identify(&self, problem: &Problem, options: &Options) -> Result<Identification, Error> {
        let partitions = self.parts.iter().map(|(one, part)| SummedPartition {
            specification: one.clone(),
            partition: part.partition.clone(),
            sums: part,
        });
        let partitions: Vec<SummedPartition<'_>> = partitions.collect();
        let mut options = options.clone();
        options.partitions = self.parts.iter().map(|(one, _)| one.clone()).collect();
        let mut identification = identify_summed(problem, &options, &self.whole, &partitions, &self.rows)?;
        identification.concentrated = self.whole.scan.concentrated().to_vec();
        Ok(identification)
    }
}

/// Refuses settings that a statistic cannot serve.
fn refuse_rows(options: &PwaOptions) -> Result<(), Error> {
    let problem = if options.rollouts.is_some() {
        format!(
            "rollouts need rows: remove {given_select} and name the span of a derivative",
            given_select = SELECT.to("rollout")
        )
    } else if options.phase {
        format!("{PHASE} needs rows: remove it")
    } else if options.identification.tsqr {
        format!("{TSQR} factors rows: remove it")
    } else if options.identification.continuous {
        format!("{CONTINUOUS} needs rows to see which regions are neighbours: remove it")
    } else if options.identification.unseen == UnseenLabel::Pool {
        format!(
            "{given_unseen_labels} asks for one more region, which was not summed: remove it",
            given_unseen_labels = UNSEEN_LABELS.to("pool")
        )
    } else {
        return Ok(());
    };
    Err(Error::needs_rows(format!("{problem}, or give the logs instead of their statistic")))
}

/// The sums of one partition, with the square-root forms of all folds.
struct Part {
    scan: SystemScan,
    partition: Partition,
    /// Positions of the library's functions among those of the scan.
    places: Vec<usize>,
    folds: Option<Folds>,
    /// Region by region: all rows, then the training rows of every fold.
    training: Vec<Vec<SquareRoot>>,
    testing: Vec<Vec<SquareRoot>>,
}

impl Part {
    fn new(
        file: &StatisticFile,
        recipe: &Recipe,
        specification: &Specification,
        options: &Options,
    ) -> Result<Self, Error> {
        let one = match specification {
            Specification::Null | Specification::Average => None,
            one => Some(one.to_string()),
        };
        let mut recipe = recipe.clone();
        recipe.model.partition.clone_from(&one);
        let (_, system) = piecewise(&recipe, &file.fields, file.step())?;
        let group = file.equations.as_ref().and_then(|equations| equations.covering(&system));
        let (group, places) = group.ok_or_else(|| unserved(file, one.as_deref()))?;
        let scan = SystemScan::new(&group.plan, &group.sums)?;
        let halo = reached(system.expressions());
        let folds = if options.folds > 1 { Some(folds(&scan, options.folds, options.gap(halo))?) } else { None };
        // All functions in their order are the factor as it is: so has it a fit of logs.
        let whole = places.iter().copied().eq(0..scan.functions());
        let narrowed = |root: SquareRoot| if whole { root } else { root.select(&places) };
        let root = |region: usize| narrowed(scan.root(region));
        let by_fold = |region: usize, weights: MatRef<'_, f64>| {
            scan.roots(region, weights).into_iter().map(narrowed).collect::<Vec<_>>()
        };
        let (mut training, mut testing) = (Vec::new(), Vec::new());
        for region in 0..scan.regions() {
            let mut all = vec![root(region)];
            if let Some(folds) = &folds {
                all.extend(by_fold(region, folds.train()));
                testing.push(by_fold(region, folds.test()));
            }
            training.push(all);
        }
        let partition = group.plan.system.partition.clone().unwrap_or_else(Partition::whole);
        Ok(Self { partition, scan, places, folds, training, testing })
    }

    /// Facts about the rows beside the sums.
    fn rows(&self, file: &StatisticFile) -> SummedRows {
        let counts = self.scan.counts();
        SummedRows {
            scales: self.scan.also().clone(),
            complete: counts.complete,
            at_border: counts.at_border,
            incomplete: counts.incomplete,
            episodes: file.episodes.iter().map(EpisodeRecord::trained).collect(),
            folds: self.folds.as_ref().map_or(0, |folds| folds.len() as u16),
            fold_rule: self.folds.as_ref().map(|folds| folds.rule().to_owned()),
        }
    }

    /// Coefficients of the library as those of all functions of the scan.
    fn wide(&self, coefficients: MatRef<'_, f64>) -> Mat<f64> {
        let mut wide = Mat::zeros(self.scan.functions(), coefficients.ncols());
        for (row, &place) in self.places.iter().enumerate() {
            (0..coefficients.ncols()).for_each(|t| wide[(place, t)] = coefficients[(row, t)]);
        }
        wide
    }
}

/// Folds by the one rule, of the chunks of the scan.
fn folds(scan: &SystemScan, count: u16, purge: Purge) -> Result<Folds, Error> {
    let (keys, rows) = keys(scan);
    Ok(Folds::of(&keys, &rows, FoldRule::Count(count.into()), purge)?)
}

fn unserved(file: &StatisticFile, partition: Option<&str>) -> Error {
    let in_regions = partition.map_or_else(String::new, |partition| format!(" in the regions of {partition}"));
    Error::other_statistic(format!(
        "the statistic has no sums for {FIT_PWA}{in_regions} with the targets, functions and weights of the recipe; without the logs it serves {}; scan again with \
         that recipe{}, or give the logs",
        served(file).join(", "),
        partition.map_or_else(String::new, |partition| format!(
            " and {given_partition}",
            given_partition = PARTITION.to(partition)
        ))
    ))
}

impl Sums for Part {
    fn training(&self, region: usize, held: Option<u16>) -> SquareRoot {
        self.training[region][held.map_or(0, |fold| 1 + usize::from(fold))].clone()
    }

    fn testing(&self, region: usize, fold: u16) -> SquareRoot {
        self.testing[region][usize::from(fold)].clone()
    }

    fn ranges(&self, region: usize) -> Vec<[f64; 2]> {
        let ranges = self.scan.ranges(region);
        self.places.iter().map(|&place| ranges[place]).collect()
    }

    fn residual_covariance(&self, region: usize, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> Vec<f64> {
        self.scan.residual_covariance(region, self.wide(coefficients).as_ref(), intercept)
    }

    fn effective_rows(&self, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> f64 {
        let wide = self.wide(coefficients);
        let with_constant =
            Mat::from_fn(1 + wide.nrows(), wide.ncols(), |j, t| if j == 0 { intercept[t] } else { wide[(j - 1, t)] });
        system_effective_rows(&self.scan, 0, true, with_constant.as_ref())
    }
}

/// The partitions that `fit pwa` has sums for, with the recipe of the scan.
pub(crate) fn served(file: &StatisticFile) -> Vec<String> {
    let Some(equations) = &file.equations else { return Vec::new() };
    let Ok(recipe) = Recipe::parse(&file.recipe, "the recipe of the statistic") else { return Vec::new() };
    let is_served = |partition: &Option<String>| {
        let mut recipe = recipe.clone();
        recipe.model.partition.clone_from(partition);
        piecewise(&recipe, &file.fields, 0.0).is_ok_and(|(_, system)| equations.covering(&system).is_some())
    };
    let mut partitions: Vec<Option<String>> = Vec::new();
    for group in &equations.groups {
        let partition = group.plan.system.partition.as_ref().map(|partition| partition.specification.clone());
        if !partitions.contains(&partition) {
            partitions.push(partition);
        }
    }
    let served = partitions.into_iter().filter(is_served);
    served.map(|partition| partition.unwrap_or_else(|| "average".to_owned())).collect()
}

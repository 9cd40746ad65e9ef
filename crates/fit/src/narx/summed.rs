//! An autoregression whose candidates were summed with a statistic, for `fit narx` without the logs.

use std::{borrow::Cow, collections::BTreeMap};

use faer::MatRef;
use fleetfoot_data::setting::{FIT_NARX, NARX, SELECT};
use fleetfoot_data::{EpisodeId, Source};
use fleetfoot_dataset::{EquationStatistic, StatisticFile};
use fleetfoot_library::Expr;
use fleetfoot_model::{Partition, TrainedEpisode};
use fleetfoot_pwa::Problem;
use fleetfoot_recipe::{Criterion, GivenAs, NarxSection, NarxSelection, Recipe};
use fleetfoot_sparse::{
    narx::{NarxFold, NarxOrder},
    select::Folds,
};
use fleetfoot_stats::{FoldRule, Purge};
use fleetfoot_sums::system::{System, SystemScan};
use fleetfoot_task::{EquationTask, placeholder};

use super::{
    NarxOptions, OrderRule,
    choice::Choice,
    options::USUAL,
    task::{NarxBase, NarxTask, one_row_ahead},
};
use crate::{error::Error, sindy::keys};

/// The candidates that a scan sums for `fit narx`: those of all lags up to the recipe's, in one of its partitions.
pub(crate) struct Summed {
    /// Options of the autoregression, from the recipe.
    pub(crate) options: NarxOptions,
    /// The largest lags and degree.
    pub(crate) order: NarxOrder,
    task: NarxTask,
}

impl Summed {
    /// Takes a recipe whose wildcards are written out. `None` without `[narx]`: lags of outputs and inputs are summed
    /// on request only.
    ///
    /// # Errors
    /// A column that is not there; a setting that needs rows.
    pub(crate) fn of(recipe: &Recipe, fields: &[fleetfoot_data::Column]) -> Result<Option<Self>, Error> {
        if recipe.narx == NarxSection::default() {
            return Ok(None);
        }
        let options = NarxOptions::new(recipe)?;
        refuse_rows(&options)?;
        let task = EquationTask::resolve(&one_row_ahead(recipe, &options)?, fields)?;
        let base = NarxBase::new(task, recipe)?;
        let order = match options.order {
            OrderRule::Fixed(order) | OrderRule::UpTo(order) => order,
            OrderRule::Look(given) => given.or(USUAL),
        };
        let task = base.with(&[order])?;
        Ok(Some(Self { options, order, task }))
    }

    /// System whose products are summed, in one region.
    pub(crate) fn system(&self) -> System {
        self.task.task.system()
    }

    /// Problem in which regions are made.
    pub(crate) fn problem(&self, step: f64) -> Problem {
        self.task.task.problem(step)
    }

    /// Columns of the partition.
    pub(crate) fn partition_columns(&self) -> &[Expr] {
        &self.task.task.partition_columns
    }
}

/// Refuses settings that sums over all rows cannot serve.
fn refuse_rows(options: &NarxOptions) -> Result<(), Error> {
    let wish = if options.decimate > 1 {
        format!("{}: every n-th row is picked from rows", NARX.entry("decimate").is(options.decimate))
    } else if options.test_share > 0.0 {
        format!("{}: the last rows are picked from rows", NARX.entry("test_share").is(options.test_share))
    } else {
        return Ok(());
    };
    Err(Error::needs_rows(format!("{wish}, which a statistic lacks; remove it, or give the logs")))
}

/// Source of the sums of a fit.
#[derive(Clone, Copy)]
pub(crate) enum Evidence<'a> {
    /// Rows that train.
    Rows(&'a dyn Source),
    /// The sums of a statistic.
    Sums(&'a Sums<'a>),
}

/// The sums of an autoregression in a statistic.
pub(crate) struct Sums<'a> {
    file: &'a StatisticFile,
    equations: &'a EquationStatistic,
    /// The order that was summed, which contains the fitted one.
    pub(super) order: NarxOrder,
}

impl<'a> Sums<'a> {
    /// The sums of a file that answer for a fit, in the regions that it asks for.
    ///
    /// # Errors
    /// No candidates that fit the sums; the message says which were summed.
    pub(super) fn new(file: &'a StatisticFile, scanned: &Recipe, fit: &NarxOptions) -> Result<Self, Error> {
        let whole = EquationStatistic::whole(&scanned.expand(&file.fields)?);
        let (Some(equations), Some(summed)) = (&file.equations, Summed::of(&whole, &file.fields)?) else {
            return Err(unserved(file));
        };
        let order = summed.order;
        if let OrderRule::Fixed(requested) | OrderRule::UpTo(requested) = fit.order
            && !requested.is_within(order)
        {
            return Err(Error::other_statistic(format!(
                "the statistic has the sums of {order}, the fit asks for {requested}: ask for less, scan again with these lags in {NARX}, or give the logs"
            )));
        }
        Ok(Self { file, equations, order })
    }

    /// The sums of a task, which has all candidates of the scan, in the regions of a partition.
    pub(super) fn scan(&self, task: &EquationTask, partition: Option<&Partition>) -> Result<SystemScan, Error> {
        let system = System { partition: partition.cloned(), ..task.system() };
        let covering = self.equations.covering(&system).filter(|(_, places)| {
            places.len() == system.functions.len() && places.iter().enumerate().all(|(at, &place)| at == place)
        });
        let (group, _) = covering.ok_or_else(|| unserved(self.file))?;
        Ok(SystemScan::new(&group.plan, &group.sums)?)
    }

    /// The one partition of a fit, its regions as they were frozen with the scan.
    pub(super) fn partitions(&self, task: &NarxTask, options: &NarxOptions) -> Result<Vec<Choice>, Error> {
        let [one] = options.partitions.as_slice() else { return Err(unserved(self.file)) };
        let wanted = placeholder(Some(one), &task.task.partition_columns);
        let system = System { partition: wanted, ..task.task.system() };
        let partitions = self.equations.covering(&system).map(|(group, _)| group.plan.system.partition.clone());
        let partition = partitions.ok_or_else(|| unserved(self.file))?;
        Ok(vec![Choice { specification: one.clone(), partition, seed: options.seed }])
    }
}

impl Evidence<'_> {
    /// The rows.
    ///
    /// # Errors
    /// A statistic has none.
    pub(super) fn rows(&self) -> Result<&dyn Source, Error> {
        match self {
            Self::Rows(source) => Ok(*source),
            Self::Sums(_) => Err(Error::needs_rows(format!(
                "free runs need rows, which a statistic lacks: remove {given_select}, or give the logs",
                given_select = SELECT.to("free-run")
            ))),
        }
    }

    /// Every episode that trains, by identity: a merged statistic knows no order of logs.
    pub(super) fn episodes(&self) -> Vec<TrainedEpisode> {
        let known: BTreeMap<EpisodeId, TrainedEpisode> = match self {
            Self::Rows(source) => source.episodes().iter().map(|episode| (episode.id, episode.into())).collect(),
            Self::Sums(sums) => sums.file.episodes.iter().map(|episode| (episode.id, episode.trained())).collect(),
        };
        known.into_values().collect()
    }

    /// The candidates of some orders: all that were summed, where there is a statistic.
    pub(super) fn candidates(&self, base: &NarxBase, orders: &[NarxOrder]) -> Result<NarxTask, Error> {
        match self {
            Self::Rows(_) => base.with(orders),
            Self::Sums(sums) => base.with(&[sums.order]),
        }
    }
}

/// Folds of the chunks of a scan, by the common rule. No lag of a training row, and no smoothing over so many rows,
/// reaches the held-out ones.
pub(super) fn folds_of_chunks(
    scan: &SystemScan,
    count: usize,
    order: NarxOrder,
    smoothed: usize,
) -> Result<Vec<NarxFold>, Error> {
    let (keys, rows) = keys(scan);
    let purge = Purge::Exactly(order.reach() + smoothed);
    let folds = Folds::of(&keys, &rows, FoldRule::Count(count), purge)?;
    let problems = |weights: MatRef<'_, f64>| scan.roots(0, weights).into_iter().map(|root| root.compressed(true));
    Ok(problems(folds.train()).zip(problems(folds.test())).map(|(train, test)| NarxFold { train, test }).collect())
}

/// The recipe of a fit from sums. A choice that free runs would make by default is made by one-step errors of held-out
/// chunks.
///
/// # Errors
/// A recipe that demands a choice by free runs.
pub(super) fn by_single_steps<'a>(recipe: &'a Recipe, notes: &mut Vec<String>) -> Result<Cow<'a, Recipe>, Error> {
    let options = NarxOptions::new(recipe)?;
    refuse_rows(&options)?;
    let given = matches!(options.order, OrderRule::Fixed(_)) && !options.terms.is_free();
    if options.selection != NarxSelection::FreeRun || given && options.partitions.len() == 1 {
        return Ok(Cow::Borrowed(recipe));
    }
    if recipe.narx.select.is_some() {
        return Err(Error::needs_rows(format!(
            "{given_select} simulates rows, which a statistic lacks: remove it, name a criterion of one-step errors (one-se, cv, bic), or give the logs",
            given_select = SELECT.to("free-run")
        )));
    }
    let mut recipe = recipe.clone();
    recipe.narx.select = Some(NarxSelection::OneStep(Criterion::OneStandardError));
    recipe.narx.order.get_or_insert(GivenAs::Auto);
    notes.push("lags and terms are chosen by one-step errors: a choice by free runs, as on logs, needs rows".into());
    Ok(Cow::Owned(recipe))
}

fn unserved(file: &StatisticFile) -> Error {
    Error::other_statistic(format!(
        "the statistic has no sums for {FIT_NARX} with the outputs, inputs, candidates and regions of the recipe; without the logs it serves {}; scan again with a \
         recipe that has {NARX} lags_out, lags_in and the partition, or give the logs",
        served(file).join(", ")
    ))
}

/// The partitions that `fit narx` has sums for, with the recipe of the scan.
pub(crate) fn served(file: &StatisticFile) -> Vec<String> {
    let Some(equations) = &file.equations else { return Vec::new() };
    let Ok(recipe) = Recipe::parse(&file.recipe, "the recipe of the statistic") else { return Vec::new() };
    let Ok(Some(summed)) = Summed::of(&EquationStatistic::whole(&recipe), &file.fields) else { return Vec::new() };
    let system = summed.system();
    let groups = equations.groups.iter().filter(|group| {
        let held = &group.plan.system;
        (&held.functions, &held.targets) == (&system.functions, &system.targets)
    });
    groups.map(|group| group.name().to_owned()).collect()
}

//! Choice of partition, order and number of terms by simulations of rows that did not train.
//!
//! One-step errors flatter an autoregression: the outputs hardly move within a row. What a model is for is seen when it feeds on its own answers.

use std::collections::BTreeMap;

use faer::Mat;
use fleetfoot_data::{EpisodeId, Progress, Silent, Source, parallel_map};
use fleetfoot_dynamics::{FreeRunOptions, free_run};
use fleetfoot_model::Partition;
use fleetfoot_sparse::{FrolsChoice, NarxOrder, System, SystemPlan, SystemScan};

use super::{
    NarxOptions, TermRule,
    spans::Spans,
    task::NarxTask,
    terms::{Problems, Trails},
};
use crate::{Error, Provenance};

/// A model that was tried.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct NarxCandidate {
    /// Index among the partitions asked for.
    pub partition: usize,
    /// The partition, as the user wrote it.
    pub specification: String,
    /// Seed of its clustering.
    pub seed: u64,
    /// Its regions.
    pub regions: usize,
    /// Lags and degree.
    pub order: NarxOrder,
    /// Most terms of an equation in a region.
    pub terms: usize,
    /// Root relative squared error of free runs of the spans that did not train, the mean of the folds. Infinite when one diverged.
    pub rrse: f64,
    /// That of every fold, the root mean square over the outputs: every fold counts as much, whatever its rows and how far its outputs move.
    pub folds: Vec<f64>,
}

/// A partition to choose from; `None`: one region.
pub(crate) struct Choice {
    pub(crate) partition: Option<Partition>,
    pub(crate) seed: u64,
}

/// Errors that differ by less are the same.
const SAME: f64 = 1e-3;
const ROUNDING: f64 = 1e-9;

/// The least error; of errors that are the same the model with the fewest terms, then the lowest order. `None` when all diverge.
pub(crate) fn best(tried: &[NarxCandidate]) -> Option<&NarxCandidate> {
    let finite = || tried.iter().filter(|candidate| candidate.rrse.is_finite());
    let least = finite().map(|candidate| candidate.rrse).min_by(f64::total_cmp)?;
    let limit = least * (1.0 + SAME) + ROUNDING;
    let lags = |order: NarxOrder| order.outputs + order.inputs;
    let size = |c: &&NarxCandidate| (c.regions * c.terms, c.order.degree, lags(c.order));
    finite().filter(|candidate| candidate.rrse <= limit).min_by_key(size)
}

/// Everything that the candidates share.
pub(crate) struct Selection<'a> {
    pub(crate) narx: &'a NarxTask,
    pub(crate) options: &'a NarxOptions,
    pub(crate) source: &'a dyn Source,
    pub(crate) step: f64,
}

/// Squared relative errors of every output over free runs.
struct Squares(Vec<f64>);

impl Selection<'_> {
    /// Tries every partition, order and number of terms. The spans of `folds` are simulated by models of the others; partitions and scans are made once for all folds,
    /// lags do not reach over the borders of spans.
    pub(crate) fn run(
        &self,
        partitions: &[Choice],
        orders: &[NarxOrder],
        progress: &dyn Progress,
    ) -> Result<Vec<NarxCandidate>, Error> {
        let (cut, folds) = Spans::folds(self.source, self.options.folds)?;
        let held: Vec<Spans<'_>> = (0..self.options.folds)
            .map(|fold| {
                let own = (0..folds.len()).filter(|&e| folds[e] == fold);
                Spans::new(&cut, own.map(|e| (e, 0..cut.episodes()[e].rows)).collect(), 1)
            })
            .collect::<Result<_, _>>()?;
        let fold_of: BTreeMap<EpisodeId, usize> =
            cut.episodes().iter().zip(&folds).map(|(episode, &fold)| (episode.id, fold)).collect();
        let whole = self.scan(None, &cut, progress)?;
        let mut found = Vec::new();
        for (index, choice) in partitions.iter().enumerate() {
            let partition = &choice.partition;
            let regions = partition.as_ref().map(|partition| self.scan(Some(partition), &cut, progress)).transpose()?;
            let sets = self.training_sets(&whole, regions.as_ref(), &fold_of);
            let scan = regions.as_ref().unwrap_or(&whole);
            progress.stage("free runs");
            let count = held.len();
            let tried = parallel_map(orders.len() * count, progress, |job| {
                let (order, fold) = (orders[job / count], job % count);
                self.fold(scan, partition.as_ref(), order, &sets[fold], &held[fold])
            })?;
            for (order, tried) in orders.iter().zip(tried.chunks(count)) {
                found.extend(candidates(index, choice, *order, tried));
            }
        }
        Ok(found)
    }

    fn scan(
        &self,
        partition: Option<&Partition>,
        source: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<SystemScan, Error> {
        progress.stage("scan");
        let system = System { partition: partition.cloned(), ..self.narx.task.system() };
        Ok(SystemPlan::new(system, None, source)?.scan(source, progress)?)
    }

    fn training_sets(
        &self,
        whole: &SystemScan,
        regions: Option<&SystemScan>,
        fold_of: &BTreeMap<EpisodeId, usize>,
    ) -> Vec<Problems> {
        let weights = |scan: &SystemScan| {
            let fold = |unit: usize| fold_of.get(&scan.units()[unit].episode).copied();
            Mat::from_fn(scan.units().len(), self.options.folds, |unit, f| f64::from(fold(unit) != Some(f)))
        };
        Problems::sets(whole, regions, &weights)
    }

    /// Free runs of the models of one order, by number of terms, on the spans of one fold.
    fn fold(
        &self,
        scan: &SystemScan,
        partition: Option<&Partition>,
        order: NarxOrder,
        problems: &Problems,
        held: &dyn Source,
    ) -> Result<Vec<(usize, Squares)>, Error> {
        let columns = self.narx.library.columns(order);
        let trails = Trails::new(problems, columns, self.options.terms, FrolsChoice::Last)?;
        let counts = match self.options.terms {
            TermRule::All => vec![usize::MAX],
            TermRule::Count(count) => vec![count],
            TermRule::Auto(most) => (1..=most.min(self.narx.library.columns(order).len())).collect(),
        };
        counts
            .into_iter()
            .map(|count| {
                let coefficients = trails.coefficients(&trails.terms(Some(count)));
                let provenance = Provenance { step: self.step, ..Provenance::default() };
                let model = self.narx.task.model(scan, partition, &coefficients, provenance);
                let run = free_run(&model, held, &FreeRunOptions::default(), &Silent)?;
                let squares = run.outputs.iter().map(|output| output.errors.rrse.powi(2)).collect();
                Ok((count.min(trails.longest()), Squares(squares)))
            })
            .collect()
    }
}

/// The candidates of one partition and order from what they did in every fold.
fn candidates(index: usize, choice: &Choice, order: NarxOrder, folds: &[Vec<(usize, Squares)>]) -> Vec<NarxCandidate> {
    let relative = |Squares(outputs): &Squares| (outputs.iter().sum::<f64>() / outputs.len() as f64).sqrt();
    let counts = folds.iter().map(Vec::len).min().unwrap_or(0);
    let candidate = |k: usize| {
        let folds_of = folds.iter().map(|fold| &fold[k]);
        let errors: Vec<f64> = folds_of.clone().map(|(_, squares)| relative(squares)).collect();
        NarxCandidate {
            partition: index,
            specification: choice.partition.as_ref().map_or_else(|| "average".into(), |p| p.specification.clone()),
            seed: choice.seed,
            regions: choice.partition.as_ref().map_or(1, |partition| partition.rule.count()),
            order,
            terms: folds_of.map(|(terms, _)| *terms).max().unwrap_or(0),
            rrse: errors.iter().sum::<f64>() / errors.len() as f64,
            folds: errors,
        }
    };
    (0..counts).map(candidate).collect()
}

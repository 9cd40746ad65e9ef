//! Identification from sums that were made before, in partitions that were frozen before them. No row is read.
//!
//! Quadratic results are there: every model, held-out squared errors, the choice of a partition. Absolute errors and
//! Mahalanobis scores need rows, and are NaN. The model of a partition is the one that [`crate::identify`] makes of the
//! rows, which sums them in the same way (`scan.rs`). There, regions are clustered anew on the training rows of every
//! fold. Here those of every fold are the regions that were made on all rows.

use std::{borrow::Cow, collections::BTreeMap};

use faer::MatRef;
use fleetfoot_model::{Partition, TrainedEpisode, Training};
use fleetfoot_stats::{Basis, Estimate, Gram, SquareRoot};

use crate::{
    Error, Identification, Options, Problem, Score, Specification,
    assemble::{assembled, described, go_on_outside},
    fit::Roots,
    identification::{coefficients, mark},
    notes::confounded,
    segmentation::Candidate,
    select::{Order, choose, evaluate},
    stable::Loop,
};

/// The sums of the rows of a partition's regions: library and targets of the problem, raw units.
pub trait Summed {
    /// The rows of a region that train the model which is tested on `held`; all of them without it.
    fn training(&self, region: usize, held: Option<u16>) -> SquareRoot;

    /// The rows of a region that a fold holds out.
    fn testing(&self, region: usize, fold: u16) -> SquareRoot;

    /// Least and greatest value of every function of the library over the rows of a region.
    fn ranges(&self, region: usize) -> Vec<[f64; 2]>;

    /// Covariance (divisor: weight) of the errors of coefficients (p x q) with intercepts (q) on the rows of a region, packed lower triangle by rows.
    fn residual_covariance(&self, region: usize, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> Vec<f64>;

    /// Rows of all regions that count as independent, by the residuals of coefficients (p x q) with intercepts (q).
    fn effective_rows(&self, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> f64;
}

/// A partition to choose from, and the sums in its regions.
pub struct SummedPartition<'a> {
    /// As users write it.
    pub specification: Specification,
    /// The regions.
    pub partition: Partition,
    /// Their rows.
    pub sums: &'a dyn Summed,
}

/// Facts about the rows beside the sums of a partition.
#[derive(Debug, Clone)]
pub struct SummedRows {
    /// Moments of the targets, then of the states, over all rows.
    pub scales: Gram,
    /// Rows with all values.
    pub complete: u64,
    /// Rows that lack neighbours at the border of their episode.
    pub at_border: u64,
    /// Rows with a missing value.
    pub incomplete: u64,
    /// The episodes.
    pub episodes: Vec<TrainedEpisode>,
    /// Folds; 0 without cross-validation.
    pub folds: u16,
    /// Rule by which the folds hold out rows, for people.
    pub fold_rule: Option<String>,
}

/// Identifies a piecewise-affine model of the sums of `whole` (all rows in one region) and of those of every partition.
///
/// # Errors
/// Too few rows for a model; a target that never changes; a fold without rows to train on.
pub fn identify_summed(
    problem: &Problem,
    options: &Options,
    whole: &dyn Summed,
    partitions: &[SummedPartition<'_>],
    rows: &SummedRows,
) -> Result<Identification, Error> {
    check(problem, rows)?;
    let sums = Sums { whole, partitions };
    let too_few = || too_few(problem, rows);
    let base = sums.base(None).filter(|base| base.root.weight > 0.0).ok_or_else(too_few)?;
    let independent = whole.effective_rows(base.average.coefficients.as_ref(), &base.average.intercept);
    let candidates: Vec<Candidate> =
        partitions.iter().enumerate().map(|(at, specification)| candidate(at, specification, rows)).collect();
    let regions = |partition: usize| sums.count(partition);
    let shapes = (candidates.as_slice(), &regions as &dyn Fn(usize) -> usize);
    let bound = Loop::requested(problem, options)?;
    let orders = evaluate(&sums, shapes, (rows.folds, options.shrinkage), bound.as_ref(), &base, independent)?;
    let specifications: Vec<&Specification> = partitions.iter().map(|one| &one.specification).collect();
    let (chosen, rule) = choose(options.selection, &specifications, &orders);
    let q = base.root.targets();
    let sigma: Vec<f64> = (0..q).map(|t| (rows.scales.get(t, t) / rows.scales.weight).sqrt()).collect();
    let model = |at: usize| {
        let mut model = sums.model((problem, options), &partitions[at], &orders[at], &candidates[at], rows);
        go_on_outside(&mut model, &base.average, options);
        model
    };
    let models = if options.keep_all { (0..orders.len()).map(model).collect() } else { Vec::new() };
    let (model, roots) = (model(chosen), sums.training(candidates[chosen].full, None));
    let mut notes = Vec::new();
    confounded(problem, &base, &mut notes);
    let scored = partitions.iter().zip(&orders).map(|(one, order)| score(one, order, &sigma, problem.library.len()));
    let candidates = mark(scored.collect());
    notes.extend(candidates[chosen].no_better());
    Ok(Identification {
        model,
        models,
        roots,
        candidates,
        chosen,
        rule,
        targets: problem.equations.iter().filter(|e| e.target.is_some()).map(|e| e.label()).collect(),
        sigma,
        rows: rows.complete,
        at_border: rows.at_border,
        incomplete: rows.incomplete,
        effective_rows: independent,
        held_out: rows.folds > 1,
        fold_rule: rows.fold_rule.clone(),
        basis: Basis::Folds(usize::from(rows.folds)),
        condition: base.average.condition,
        preconditioned: base.root.condition,
        concentrated: Vec::new(),
        notes,
        partition_notes: Vec::new(),
    })
}

fn too_few(problem: &Problem, rows: &SummedRows) -> Error {
    let SummedRows { complete, at_border, incomplete, .. } = *rows;
    Error::TooFewRows { complete, regressors: problem.library.len() + 1, at_border, incomplete }
}

fn check(problem: &Problem, rows: &SummedRows) -> Result<(), Error> {
    if rows.complete < problem.library.len() as u64 + 2 {
        return Err(too_few(problem, rows));
    }
    for (target, equation) in problem.equations.iter().filter(|equation| equation.target.is_some()).enumerate() {
        if rows.scales.get(target, target) <= 0.0 {
            return Err(Error::ConstantTarget { target: equation.label(), value: rows.scales.mean[target] });
        }
    }
    Ok(())
}

/// Partition 0 is the one region of all rows, and the others follow in their order.
fn candidate(at: usize, summed_partition: &SummedPartition<'_>, rows: &SummedRows) -> Candidate {
    let whole = matches!(summed_partition.specification, Specification::Null | Specification::Average);
    let full = if whole { 0 } else { at + 1 };
    Candidate {
        specification: summed_partition.specification.clone(),
        full,
        by_fold: vec![full; usize::from(rows.folds)],
        ties: Vec::new(),
        objective: Vec::new(),
    }
}

/// Score of a partition; scores that need absolute errors are NaN.
fn score(summed_partition: &SummedPartition<'_>, order: &Order, sigma: &[f64], regressors: usize) -> Score {
    let unknown = || vec![f64::NAN; sigma.len()];
    let no_interval = Estimate { value: f64::NAN, low: f64::NAN, high: f64::NAN };
    Score {
        specification: summed_partition.specification.clone(),
        regions: order.full.len(),
        coefficients: coefficients(&summed_partition.specification, order.full.len(), (regressors, sigma.len()), None),
        front: false,
        shrinkage: order.shrinkage,
        over_null: unknown(),
        over_null_interval: vec![no_interval; sigma.len()],
        absolute: Vec::new(),
        over_sigma: unknown(),
        r2: order.squared.iter().zip(sigma).map(|(error, s)| 1.0 - error / (order.weight * s * s)).collect(),
        mahalanobis: f64::NAN,
        loss: order.loss,
        standard_error: order.standard_error,
        losses: order.losses.clone(),
        bic: order.bic,
        continuity: None,
        stability: order.stability.as_ref().map(|(stability, _)| stability.clone()),
        free_loss: order.stability.as_ref().map_or(order.loss, |(_, free)| *free),
        objective: Vec::new(),
    }
}

/// All sums; partition 0 is the whole.
struct Sums<'a> {
    whole: &'a dyn Summed,
    partitions: &'a [SummedPartition<'a>],
}

impl<'a> Sums<'a> {
    fn of(&self, partition: usize) -> &'a dyn Summed {
        partition.checked_sub(1).map_or(self.whole, |at| self.partitions[at].sums)
    }

    fn count(&self, partition: usize) -> usize {
        partition.checked_sub(1).map_or(1, |at| self.partitions[at].partition.rule.count())
    }

    fn roots(&self, partition: usize, of: impl Fn(&dyn Summed, usize) -> SquareRoot) -> BTreeMap<u32, SquareRoot> {
        let sums = self.of(partition);
        let roots = (0..self.count(partition)).map(|region| (region as u32, of(sums, region)));
        roots.filter(|(_, root)| root.weight > 0.0).collect()
    }

    fn model(
        &self,
        (problem, options): (&Problem, &Options),
        summed_partition: &SummedPartition<'_>,
        order: &Order,
        candidate: &Candidate,
        rows: &SummedRows,
    ) -> fleetfoot_model::Model {
        let null = summed_partition.specification == Specification::Null;
        let library = if null { Vec::new() } else { problem.library.clone() };
        let sums = self.of(candidate.full);
        let again = || Cow::Owned(self.training(candidate.full, None));
        let roots = order.training.as_ref().map_or_else(again, Cow::Borrowed);
        let mut partition = if candidate.full == 0 { Partition::whole() } else { summed_partition.partition.clone() };
        partition.specification = summed_partition.specification.to_string();
        let regions = order
            .full
            .iter()
            .enumerate()
            .map(|(region, fitted)| {
                let residuals = sums.residual_covariance(region, fitted.coefficients.as_ref(), &fitted.intercept);
                let (name, root) = (partition.region_name(region), roots.get(&(region as u32)));
                described(name, fitted, root, &sums.ranges(region), residuals, library.len())
            })
            .collect();
        let (q, d) = (order.squared.len(), rows.scales.dimension());
        let training = Training {
            version: env!("CARGO_PKG_VERSION").into(),
            recipe: String::new(),
            seed: options.seed,
            rows: rows.complete,
            episodes: rows.episodes.clone(),
            target_mean: rows.scales.mean[..q].to_vec(),
            target_covariance: rows.scales.covariance(0..q),
            // An absolute error, which sums do not know.
            target_deviation: vec![f64::NAN; q],
            state_covariance: rows.scales.covariance(q..d),
            state_mean: rows.scales.mean[q..d].to_vec(),
            ..Training::default()
        };
        assembled(problem, (partition, regions), library, &order.full, training)
    }
}

impl Roots for Sums<'_> {
    fn whole(&self, held: Option<u16>) -> Option<SquareRoot> {
        Some(self.whole.training(0, held)).filter(|root| root.weight > 0.0)
    }

    fn training(&self, partition: usize, held: Option<u16>) -> BTreeMap<u32, SquareRoot> {
        self.roots(partition, |sums, region| sums.training(region, held))
    }

    fn testing(&self, partition: usize, fold: u16) -> BTreeMap<u32, SquareRoot> {
        self.roots(partition, |sums, region| sums.testing(region, fold))
    }
}

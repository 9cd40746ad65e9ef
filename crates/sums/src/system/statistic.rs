//! Statistic of a pass, and its queries.

use std::collections::HashMap;

use faer::{Mat, MatRef};
use fleetfoot_data::{packed_row, parallel_all};
use fleetfoot_model::RegionSummary as ModelRegion;
use fleetfoot_stats::{
    Bank, Concentration, Gram, Key, PolynomialBank, PolynomialMoments, PolynomialPlan, Preconditioner, SquareRoot,
    Stats, scan::RowCounts,
};

use crate::structured::Spread;

use super::{SystemError, SystemPlan, SystemSums, Unit, plan::Coordinates};

/// Columns of weights that are in memory at once as statistics.
const BATCH: usize = 32;

/// The statistic of a system, chunk by chunk and region by region.
#[derive(Debug, Clone)]
pub struct SystemScan {
    functions: usize,
    units: Vec<Unit>,
    regions: Vec<Region>,
    preconditioner: Preconditioner,
    also: Gram,
    /// Of every target: few rows that hold most of its variance.
    concentrated: Vec<Option<Concentration>>,
    /// Of every unit: the sampled rows, and the sums of the squares of every sampled expression over them.
    sampled: Vec<(f64, Vec<f64>)>,
    counts: RowCounts,
    unassigned: u64,
}

/// The statistics of a region's rows.
#[derive(Debug, Clone)]
struct Region {
    /// The units that have rows in it.
    members: Vec<usize>,
    sums: Sums,
    ranges: Vec<[f64; 2]>,
}

/// Statistics side by side, in whatever form they were summed.
#[derive(Debug, Clone)]
enum Sums {
    /// Gram matrices of preconditioned rows.
    Grams(Bank),
    /// Chebyshev moments.
    Moments(Box<PolynomialPlan>, PolynomialBank),
}

impl Sums {
    fn rows(&self) -> u64 {
        match self {
            Self::Grams(bank) => bank.rows().iter().sum(),
            Self::Moments(_, bank) => bank.rows().iter().sum(),
        }
    }

    /// Gram matrices, in the coordinates of the scan, for every column of weights (members x b); of no rows where there are no members.
    fn combine(&self, weights: MatRef<'_, f64>, dimension: usize) -> Vec<Gram> {
        match self {
            Self::Grams(bank) if bank.is_empty() => vec![Gram::new(dimension); weights.ncols()],
            Self::Grams(bank) => bank.combine(weights),
            Self::Moments(plan, bank) => bank.combine(plan, weights),
        }
    }
}

impl SystemScan {
    /// Gathers the sums of a plan for questions.
    ///
    /// # Errors
    /// Sums that are not finite: values whose squares overflow.
    ///
    /// # Panics
    /// When the sums are not of this plan ([`SystemSums::are_of`]).
    pub fn new(plan: &SystemPlan, sums: &SystemSums) -> Result<Self, SystemError> {
        let (system, mut units) = (&plan.system, Units::default());
        let mut regions: Vec<(Vec<usize>, Vec<&Gram>)> = vec![Default::default(); system.regions()];
        for (key, gram) in sums.grams.iter() {
            let (members, grams) = &mut regions[key.region as usize];
            members.push(units.add(key, gram.rows));
            grams.push(gram);
        }
        let moments: Vec<&PolynomialMoments> = sums.moments.iter().map(|(_, moments)| moments).collect();
        sums.moments.iter().for_each(|(key, moments)| _ = units.add(key, moments.rows()));
        let totals = sums.episodes.values().fold(plan.no_rows(), |mut all, episode| {
            all.add(episode);
            all
        });
        let regions: Vec<Region> = match &plan.coordinates {
            Coordinates::General(_) => regions
                .into_iter()
                .zip(totals.ranges.0)
                .map(|((members, grams), ranges)| Region { members, sums: Sums::Grams(Bank::new(grams)), ranges })
                .collect(),
            Coordinates::Polynomial(polynomial) => vec![Region {
                members: (0..moments.len()).collect(),
                sums: Sums::Moments(Box::new(polynomial.plan.clone()), PolynomialBank::new(moments)),
                ranges: polynomial.ranges.in_order(&totals.ranges.0[0]),
            }],
        };
        let scan = Self {
            functions: system.functions.len(),
            sampled: units.sampled(&sums.sampled),
            units: units.0,
            regions,
            preconditioner: plan.coordinates.preconditioner().clone(),
            concentrated: (0..system.targets.len())
                .map(|target| Concentration::of(&sums.also, target, plan.chunk_rows))
                .collect(),
            also: sums.also.total(|_| true).unwrap_or_else(|| Gram::new(system.also.len())),
            counts: totals.counts,
            unassigned: totals.unassigned,
        };
        match scan.widest_overflow() {
            Some((function, [least, most])) => {
                let function = system.functions.get(function).unwrap_or(&system.targets[0]).to_string();
                Err(SystemError::Overflow { function, least, most })
            }
            None => Ok(scan),
        }
    }

    /// The units that have rows, in key order; weights are given to these.
    pub fn units(&self) -> &[Unit] {
        &self.units
    }

    /// Number of regions.
    pub fn regions(&self) -> usize {
        self.regions.len()
    }

    /// Number of functions, p.
    pub fn functions(&self) -> usize {
        self.functions
    }

    /// Number of targets, q.
    pub fn targets(&self) -> usize {
        self.preconditioner.targets()
    }

    /// Rows of positive weight in a region.
    ///
    /// # Panics
    /// For an unknown region, here and below.
    pub fn rows(&self, region: usize) -> u64 {
        self.regions[region].sums.rows()
    }

    /// Counts of the rows: complete, at borders, incomplete.
    pub fn counts(&self) -> RowCounts {
        self.counts
    }

    /// Complete rows that no region took.
    pub fn unassigned(&self) -> u64 {
        self.unassigned
    }

    /// Least and greatest value of every function (p) over the rows of a region, whatever their weight; without rows `[inf, -inf]`.
    pub fn ranges(&self, region: usize) -> Vec<[f64; 2]> {
        self.regions[region].ranges.clone()
    }

    /// Raw moments of the further columns over all complete rows.
    pub fn also(&self) -> &Gram {
        &self.also
    }

    /// Of every target: few rows that hold most of its variance, where it is so.
    pub fn concentrated(&self) -> &[Option<Concentration>] {
        &self.concentrated
    }

    /// The mean square of every sampled expression over the sampled rows of the units of positive weight. If none of
    /// them has any, over those of all units; 0 without such rows.
    pub fn sampled_mean_squares(&self, weight: impl Fn(usize) -> f64) -> Vec<f64> {
        let count = self.sampled.first().map_or(0, |(_, squares)| squares.len());
        let mean = |wanted: &dyn Fn(usize) -> bool| {
            let (mut rows, mut sums) = (0.0, vec![0.0; count]);
            for (_, (count, squares)) in self.sampled.iter().enumerate().filter(|(unit, _)| wanted(*unit)) {
                rows += count;
                sums.iter_mut().zip(squares).for_each(|(sum, square)| *sum += square);
            }
            (rows > 0.0).then(|| sums.into_iter().map(|sum| sum / rows).collect())
        };
        mean(&|unit| weight(unit) > 0.0).or_else(|| mean(&|_| true)).unwrap_or_else(|| vec![0.0; count])
    }

    /// The square-root form of a region's rows: p functions, q targets, raw units.
    pub fn root(&self, region: usize) -> SquareRoot {
        self.square_root(&self.gram(region))
    }

    /// For every column of `weights` (units x b; finite, not negative) the square-root form of a region's rows, those
    /// of every unit multiplied by its weight. These are folds, leave-one-out totals, replicates.
    ///
    /// The bits of an answer do not depend on the other columns.
    ///
    /// # Panics
    /// When there is not one weight a unit.
    pub fn roots(&self, region: usize, weights: MatRef<'_, f64>) -> Vec<SquareRoot> {
        assert_eq!(weights.nrows(), self.units.len(), "one weight a unit");
        let Region { members, sums, .. } = &self.regions[region];
        let mut roots = Vec::with_capacity(weights.ncols());
        for first in (0..weights.ncols()).step_by(BATCH) {
            let count = BATCH.min(weights.ncols() - first);
            let some = Mat::from_fn(members.len(), count, |k, b| weights[(members[k], first + b)]);
            let grams = sums.combine(some.as_ref(), self.preconditioner.dimension());
            roots.extend(parallel_all(count, |b| self.square_root(&grams[b])));
        }
        roots
    }

    /// Spread of the functions in a region: mean, covariance, rank, condition, and confounded functions.
    pub fn spread(&self, region: usize) -> Spread {
        Spread::of(&self.root(region), 0..self.functions(), 1.0)
    }

    /// Covariance (divisor: weight) of the errors about zero of a model on a region's rows, packed lower triangle by rows (q (q + 1) / 2); NaN without rows.
    ///
    /// `coefficients` is p x q in raw units, `constant` has q entries. The errors are formed in the coordinates of the scan before they are squared, so that
    /// small ones do not cancel.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn residual_covariance(&self, region: usize, coefficients: MatRef<'_, f64>, constant: &[f64]) -> Vec<f64> {
        let q = self.targets();
        let gram = self.gram(region);
        let (errors, mut means) = self.error_map(coefficients, constant);
        for (t, mean) in means.iter_mut().enumerate() {
            *mean += gram.mean.iter().zip(errors.col_as_slice(t)).map(|(mean, e)| mean * e).sum::<f64>();
        }
        let product = |a: &[f64], b: &[f64]| {
            let mut sum = 0.0;
            for (i, &x) in a.iter().enumerate().filter(|&(_, &x)| x != 0.0) {
                let row = b.iter().enumerate().filter(|&(_, &y)| y != 0.0);
                sum += x * row.map(|(j, &y)| gram.get(i, j) * y).sum::<f64>();
            }
            sum
        };
        let mut covariance = Vec::with_capacity(packed_row(q));
        for t in 0..q {
            for u in 0..=t {
                let scatter = product(errors.col_as_slice(t), errors.col_as_slice(u));
                let scatter = if t == u { scatter.max(0.0) } else { scatter };
                covariance.push(scatter / gram.weight + means[t] * means[u]);
            }
        }
        covariance
    }

    /// For every unit that has rows in a region: its place, the sum of its weights, and the weighted mean of the errors of a model (q).
    ///
    /// `coefficients` is p x q in raw units, `constant` has q entries.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn mean_errors(
        &self,
        region: usize,
        coefficients: MatRef<'_, f64>,
        constant: &[f64],
    ) -> Vec<(usize, f64, Vec<f64>)> {
        let (errors, means) = self.error_map(coefficients, constant);
        let Region { members, sums, .. } = &self.regions[region];
        let mut mean_errors = Vec::with_capacity(members.len());
        for first in (0..members.len()).step_by(BATCH) {
            let count = BATCH.min(members.len() - first);
            let one = Mat::from_fn(members.len(), count, |k, b| f64::from(u8::from(k == first + b)));
            let grams = sums.combine(one.as_ref(), self.preconditioner.dimension());
            for (gram, &unit) in grams.iter().zip(&members[first..]).filter(|(gram, _)| gram.weight > 0.0) {
                let of = |t: usize| {
                    means[t] + gram.mean.iter().zip(errors.col_as_slice(t)).map(|(mean, e)| mean * e).sum::<f64>()
                };
                mean_errors.push((unit, gram.weight, (0..means.len()).map(of).collect()));
            }
        }
        mean_errors
    }

    /// The errors of a model as `means + z e` of preconditioned rows z: e (d x q) and the means (q).
    fn error_map(&self, coefficients: MatRef<'_, f64>, constant: &[f64]) -> (Mat<f64>, Vec<f64>) {
        let (p, q) = (self.functions, self.targets());
        assert_eq!((coefficients.nrows(), coefficients.ncols(), constant.len()), (p, q, q), "p x q");
        let (centre, map) = self.preconditioner.raw_map();
        let mut errors = Mat::from_fn(p + q, q, |i, t| map[(i, p + t)]);
        let mut means: Vec<f64> = (0..q).map(|t| centre[p + t] - constant[t]).collect();
        for t in 0..q {
            for function in 0..p {
                let b = coefficients[(function, t)];
                means[t] -= b * centre[function];
                let (error, column) = (errors.col_as_slice_mut(t), map.col_as_slice(function));
                error.iter_mut().zip(column).for_each(|(error, a)| *error -= b * a);
            }
        }
        (errors, means)
    }

    /// A region of a model with these coefficients (p x q) and constants (q), as its rows were.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn describe(
        &self,
        region: usize,
        name: impl Into<String>,
        coefficients: MatRef<'_, f64>,
        constant: &[f64],
    ) -> ModelRegion {
        let spread = self.spread(region);
        ModelRegion {
            name: name.into(),
            rows: self.rows(region),
            mean: spread.mean,
            covariance: spread.covariance,
            range: self.ranges(region),
            residual_covariance: self.residual_covariance(region, coefficients, constant),
            rank: spread.rank,
            condition: spread.condition,
            confounded: spread.confounded,
        }
    }

    /// The Gram matrix of a region in the coordinates of the plan.
    pub fn gram(&self, region: usize) -> Gram {
        let Region { members, sums, .. } = &self.regions[region];
        let ones = Mat::from_fn(members.len(), 1, |_, _| 1.0);
        sums.combine(ones.as_ref(), self.preconditioner.dimension()).remove(0)
    }

    fn square_root(&self, gram: &Gram) -> SquareRoot {
        self.preconditioner.square_root(gram)
    }

    /// The function with the widest range, if sums are not finite.
    fn widest_overflow(&self) -> Option<(usize, [f64; 2])> {
        let finite = |region: usize| {
            let gram = self.gram(region);
            gram.weight.is_finite() && gram.mean.iter().chain(&gram.scatter).all(|value| value.is_finite())
        };
        let region = (0..self.regions()).find(|&region| !finite(region))?;
        let size = |range: &[f64; 2]| range[0].abs().max(range[1].abs());
        let ranges = self.regions[region].ranges.iter().copied().enumerate();
        Some(ranges.fold(
            (usize::MAX, [f64::NAN; 2]),
            |best, next| {
                if size(&best.1) >= size(&next.1) { best } else { next }
            },
        ))
    }
}

/// Chunks that have rows, in key order.
#[derive(Default)]
struct Units(Vec<Unit>);

impl Units {
    /// The place of a chunk, to which it gives more rows. Keys come in ascending order, so that it is the last one or a new one.
    fn add(&mut self, key: &Key, rows: u64) -> usize {
        match self.0.last_mut().filter(|last| (last.episode, last.chunk) == (key.episode, key.chunk)) {
            Some(last) => last.rows += rows,
            None => self.0.push(Unit { episode: key.episode, chunk: key.chunk, rows }),
        }
        self.0.len() - 1
    }

    /// The sampled rows of every unit, and the sums of their squares.
    fn sampled(&self, sampled: &Stats) -> Vec<(f64, Vec<f64>)> {
        let of_chunk: HashMap<_, &Gram> = sampled.iter().map(|(key, gram)| ((key.episode, key.chunk), gram)).collect();
        let count = sampled.dimension().unwrap_or(0);
        let square = |gram: &Gram, j: usize| gram.get(j, j) + gram.weight * gram.mean[j] * gram.mean[j];
        let of = |unit: &Unit| match of_chunk.get(&(unit.episode, unit.chunk)) {
            Some(gram) => (gram.weight, (0..count).map(|j| square(gram, j)).collect()),
            None => (0.0, vec![0.0; count]),
        };
        self.0.iter().map(of).collect()
    }
}

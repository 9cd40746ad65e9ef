//! What a pass has found, and what is asked of it.

use faer::{Mat, MatRef};
use fleetfoot_data::{Cancelled, Silent, packed_row, parallel_map};
use fleetfoot_model::Region as ModelRegion;
use fleetfoot_stats::{Bank, Gram, PolynomialBank, PolynomialPlan, Preconditioner, SquareRoot};

use crate::structured::{RowCounts, Spread};

use super::Unit;

/// Columns of weights that are in memory at once as statistics.
const BATCH: usize = 32;

/// The statistic of a system, chunk by chunk and region by region.
#[derive(Debug, Clone)]
pub struct SystemScan {
    /// Functions in the statistic, a constant one included.
    pub(super) functions: usize,
    pub(super) constant: Option<usize>,
    pub(super) units: Vec<Unit>,
    pub(super) regions: Vec<Region>,
    pub(super) preconditioner: Preconditioner,
    pub(super) also: Gram,
    pub(super) counts: RowCounts,
    pub(super) unassigned: u64,
}

/// The statistics of a region's rows.
#[derive(Debug, Clone)]
pub(super) struct Region {
    /// The units that have rows in it.
    pub(super) members: Vec<usize>,
    pub(super) sums: Sums,
    pub(super) ranges: Vec<[f64; 2]>,
}

/// Statistics side by side, in whatever form they were summed.
#[derive(Debug, Clone)]
pub(super) enum Sums {
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
    /// The units that have rows, in key order: what weights are given to.
    pub fn units(&self) -> &[Unit] {
        &self.units
    }

    /// Number of regions.
    pub fn regions(&self) -> usize {
        self.regions.len()
    }

    /// Number of functions, p, a constant one not counted.
    pub fn functions(&self) -> usize {
        self.functions - usize::from(self.constant.is_some())
    }

    /// Where the function 1 stood among the functions of the statistic, if it did; it is left out of everything here.
    pub fn constant(&self) -> Option<usize> {
        self.constant
    }

    /// Number of targets, q.
    pub fn targets(&self) -> usize {
        self.preconditioner.targets()
    }

    /// Rows of positive weight in a region.
    ///
    /// # Panics
    /// When there is no such region, here and below.
    pub fn rows(&self, region: usize) -> u64 {
        self.regions[region].sums.rows()
    }

    /// What became of the rows.
    pub fn counts(&self) -> RowCounts {
        self.counts
    }

    /// Complete rows that no region took.
    pub fn unassigned(&self) -> u64 {
        self.unassigned
    }

    /// Least and greatest value of every function (p) over the rows of a region, whatever their weight; without rows `[inf, -inf]`.
    pub fn ranges(&self, region: usize) -> Vec<[f64; 2]> {
        let ranges = &self.regions[region].ranges;
        self.kept().into_iter().map(|function| ranges[function]).collect()
    }

    /// Raw moments of the further columns over all complete rows.
    pub fn also(&self) -> &Gram {
        &self.also
    }

    /// The square-root form of a region's rows: p functions, q targets, raw units.
    pub fn root(&self, region: usize) -> SquareRoot {
        self.square_root(&self.total(region))
    }

    /// For every column of `weights` (units x b; finite, not negative) the square-root form of a region's rows, those of every unit multiplied by its
    /// weight: folds, leave-one-out totals, replicates.
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
            // Nobody cancels a silent progress.
            let batch = parallel_map(count, &Silent, |b| Ok::<_, Cancelled>(self.square_root(&grams[b])));
            roots.extend(batch.unwrap_or_default());
        }
        roots
    }

    /// What the functions looked like in a region: mean, covariance, rank, condition, and what its rows cannot tell apart.
    pub fn spread(&self, region: usize) -> Spread {
        Spread::of(&self.root(region), 0..self.functions(), 1.0)
    }

    /// Covariance (divisor: weight) of the errors about zero of a model on a region's rows, packed lower triangle by rows (q (q + 1) / 2); NaN without rows,
    /// and between targets whose products were not summed.
    ///
    /// `coefficients` is p x q in raw units, `constant` has q entries. The errors are formed in the coordinates of the scan before they are squared, so that
    /// small ones do not cancel.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn residual_covariance(&self, region: usize, coefficients: MatRef<'_, f64>, constant: &[f64]) -> Vec<f64> {
        let q = self.targets();
        let gram = self.total(region);
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
        let mut found = Vec::with_capacity(members.len());
        for first in (0..members.len()).step_by(BATCH) {
            let count = BATCH.min(members.len() - first);
            let one = Mat::from_fn(members.len(), count, |k, b| f64::from(u8::from(k == first + b)));
            let grams = sums.combine(one.as_ref(), self.preconditioner.dimension());
            for (gram, &unit) in grams.iter().zip(&members[first..]).filter(|(gram, _)| gram.weight > 0.0) {
                let of = |t: usize| {
                    means[t] + gram.mean.iter().zip(errors.col_as_slice(t)).map(|(mean, e)| mean * e).sum::<f64>()
                };
                found.push((unit, gram.weight, (0..means.len()).map(of).collect()));
            }
        }
        found
    }

    /// The errors of a model as `means + z e` of preconditioned rows z: e (d x q) and the means (q).
    fn error_map(&self, coefficients: MatRef<'_, f64>, constant: &[f64]) -> (Mat<f64>, Vec<f64>) {
        let (p, q) = (self.functions, self.targets());
        let kept = self.kept();
        assert_eq!((coefficients.nrows(), coefficients.ncols(), constant.len()), (kept.len(), q, q), "p x q");
        let (centre, map) = self.preconditioner.raw_map();
        let mut errors = Mat::from_fn(p + q, q, |i, t| map[(i, p + t)]);
        let mut means: Vec<f64> = (0..q).map(|t| centre[p + t] - constant[t]).collect();
        for t in 0..q {
            for (j, &function) in kept.iter().enumerate() {
                let b = coefficients[(j, t)];
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

    /// The Gram matrix of a region in the coordinates of the scan.
    fn total(&self, region: usize) -> Gram {
        let Region { members, sums, .. } = &self.regions[region];
        let ones = Mat::from_fn(members.len(), 1, |_, _| 1.0);
        sums.combine(ones.as_ref(), self.preconditioner.dimension()).remove(0)
    }

    fn square_root(&self, gram: &Gram) -> SquareRoot {
        let root = self.preconditioner.square_root(gram);
        if self.constant.is_some() { root.select(&self.kept()) } else { root }
    }

    /// The functions of the statistic without the constant.
    fn kept(&self) -> Vec<usize> {
        (0..self.functions).filter(|&function| Some(function) != self.constant).collect()
    }

    /// The function with the widest range, if sums are not finite.
    pub(super) fn widest_overflow(&self) -> Option<(usize, [f64; 2])> {
        let finite = |region: usize| {
            let gram = self.total(region);
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

//! Selection of columns by the replicates.

use faer::Mat;

use super::{BolassoError, resample::Fitted};
use crate::SparseError;

/// Options of a bolasso.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BootstrapOptions {
    /// Number of bootstrap replicates, b.
    pub replicates: usize,
    /// The strength of every replicate's lasso, in the objective of this crate (see [`bach_lambda`]).
    pub lambda: f64,
    /// Seed of the resampling.
    pub seed: u64,
    /// Share of the replicates that must select a column: 1 is the intersection of their supports (Algorithm 1), less is the soft version that
    /// Bach (2008, section 3.3) recommends, 0.9.
    pub threshold: f64,
}

impl BootstrapOptions {
    /// 128 replicates at this lambda, and the intersection of their supports.
    pub fn new(lambda: f64) -> Self {
        Self { replicates: 128, lambda, seed: 0, threshold: 1.0 }
    }

    pub(crate) fn check(&self) -> Result<(), BolassoError> {
        crate::penalty::check_strength("lambda", self.lambda)?;
        if self.replicates == 0 {
            return Err(BolassoError::NoReplicates);
        }
        check_threshold(self.threshold, 0.0)
    }
}

pub(crate) fn check_threshold(value: f64, least: f64) -> Result<(), BolassoError> {
    if value > least && value <= 1.0 { Ok(()) } else { Err(BolassoError::Threshold { value, least }) }
}

/// `lambda_0 / sqrt(n)`, the rate at which the bolasso is consistent (Theorem 7.1; Bach 2008).
///
/// Bach's objective is `1/(2n) |y - X w|^2 + mu |w|_1` with mu = mu_0 / sqrt(n): the normalisation of this crate, so his mu_0 is this lambda_0 for
/// columns of unit scale, in the units of the target. Equations (17) and (20) of the block-sparse bolasso paper are printed with the plain sum of squares:
/// their lambda is `2 n lambda`.
pub fn bach_lambda(lambda_0: f64, n: f64) -> f64 {
    lambda_0 / n.sqrt()
}

/// Columns that b bootstrap replicates of a lasso selected, out of p.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Selection {
    /// Share of the replicates that select each column (p).
    pub frequency: Vec<f64>,
    /// Mean sign of each coefficient over the replicates that select it (p): 1 or -1 where they agree, 0 where none does.
    pub sign: Vec<f64>,
    /// Columns that at least [`BootstrapOptions::threshold`] of the replicates select, ascending.
    pub support: Vec<usize>,
    /// Coefficients theta of every replicate in raw units (b x p).
    pub coefficients: Mat<f64>,
    /// Number of columns that each replicate selects (b).
    pub sizes: Vec<usize>,
    /// n of each replicate (b).
    pub weights: Vec<f64>,
    /// The largest violation of the optimality conditions of any replicate, as a correlation.
    pub worst_kkt: f64,
    /// Replicates whose path ended before lambda and that coordinate descent finished. They count as all others do.
    pub stalled: usize,
    /// Replicates whose solver did not meet its tolerance. They count; [`Selection::worst_kkt`] is their largest
    /// violation.
    pub unconverged: usize,
    /// Replicates that drew no rows at all: they are left out of frequencies and signs.
    pub empty: usize,
}

impl Selection {
    /// From the replicates in order; `None` for those without rows.
    pub(crate) fn of(replicates: &[Option<Fitted>], p: usize, threshold: f64) -> Result<Self, BolassoError> {
        let b = replicates.len();
        let some = || replicates.iter().flatten();
        let drawn = some().count();
        if drawn == 0 {
            return Err(SparseError::NoRows.into());
        }
        let mut coefficients = Mat::zeros(b, p);
        for (k, fitted) in replicates.iter().enumerate() {
            let values = fitted.iter().flat_map(|fitted| &fitted.coefficients);
            values.enumerate().for_each(|(j, &value)| coefficients[(k, j)] = value);
        }
        let (mut frequency, mut sign) = (vec![0.0; p], vec![0.0; p]);
        for j in 0..p {
            let selected = coefficients.col_as_slice(j).iter().filter(|value| **value != 0.0);
            let (count, sum) = selected.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value.signum()));
            frequency[j] = count / drawn as f64;
            sign[j] = if count > 0.0 { sum / count } else { 0.0 };
        }
        let size = |k: usize| (0..p).filter(|&j| coefficients[(k, j)] != 0.0).count();
        Ok(Self {
            support: at_least(&frequency, threshold),
            frequency,
            sign,
            sizes: (0..b).map(size).collect(),
            weights: replicates.iter().map(|fitted| fitted.as_ref().map_or(0.0, |fitted| fitted.weight)).collect(),
            worst_kkt: some().map(|fitted| fitted.kkt).fold(0.0, f64::max),
            stalled: some().filter(|fitted| fitted.stalled).count(),
            unconverged: some().filter(|fitted| !fitted.converged).count(),
            empty: b - drawn,
            coefficients,
        })
    }

    /// Columns that at least this share of the replicates select, ascending: 1 is the intersection.
    pub fn support(&self, threshold: f64) -> Vec<usize> {
        at_least(&self.frequency, threshold)
    }
}

/// Columns at or above a threshold; a share of replicates is a quotient of integers, and 0.9 must not miss 9 of 10 for rounding.
pub(crate) fn at_least(frequency: &[f64], threshold: f64) -> Vec<usize> {
    let reached = |&j: &usize| frequency[j] > 0.0 && frequency[j] >= threshold * (1.0 - 4.0 * f64::EPSILON);
    (0..frequency.len()).filter(reached).collect()
}

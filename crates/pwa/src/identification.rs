//! Result of an identification: the model, and the score of every partition.

use std::collections::BTreeMap;

use fleetfoot_model::Model;
use fleetfoot_stats::{Basis, Concentration, Estimate, SquareRoot, front};

use crate::{PartitionNote, Specification, Stability, continuous::Continuity};

/// A model and how it was found.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Identification {
    /// The chosen model.
    pub model: Model,
    /// With [`Options::keep_all`](crate::Options::keep_all) the models of all candidates, in their order; else empty.
    pub models: Vec<Model>,
    /// The square-root forms of the rows in the regions of the chosen model; regions without rows are missing.
    pub roots: BTreeMap<u32, SquareRoot>,
    /// Every tried partition, in the order of the request.
    pub candidates: Vec<Score>,
    /// Index of the chosen one.
    pub chosen: usize,
    /// The rule that chose it, for people; `None` where there was nothing to choose from, or the caller chose.
    pub rule: Option<&'static str>,
    /// Left sides of the fitted equations.
    pub targets: Vec<String>,
    /// Standard deviation of each target (population).
    pub sigma: Vec<f64>,
    /// Rows used.
    pub rows: u64,
    /// Rows that lack neighbours at the border of their episode.
    pub at_border: u64,
    /// Rows with a missing value.
    pub incomplete: u64,
    /// Rows that count as independent.
    pub effective_rows: f64,
    /// True if the scores are of held-out rows (cross-validation).
    pub held_out: bool,
    /// Rule by which rows were held out, for people; `None` without folds.
    pub fold_rule: Option<String>,
    /// Parts that the intervals of the scores compare.
    pub basis: Basis,
    /// Condition number of the standardised regressors of the one-region regression.
    pub condition: f64,
    /// Condition number of its preconditioned Gram matrix: near 1 while the pilot sample is representative.
    pub preconditioned: f64,
    /// For each target the few rows that hold most of its variance, where they do; empty where that is not known.
    pub concentrated: Vec<Option<Concentration>>,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Those notes that are about the partitions.
    pub partition_notes: Vec<PartitionNote>,
}

/// Scores of one partition.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Score {
    /// The partition.
    pub specification: Specification,
    /// Its regions.
    pub regions: usize,
    /// Numbers that its maps have, of all regions and targets, constants among them; of maps that meet at borders those that are free.
    pub coefficients: usize,
    /// True on the front: no other partition of as few coefficients has a lower held-out error, and none has the same
    /// error with fewer. False without held-out rows.
    pub front: bool,
    /// Shrinkage used, rows.
    pub shrinkage: f64,
    /// Mean absolute error of each target over that of the null model on the same rows (Table I's printed numbers).
    pub over_null: Vec<f64>,
    /// The same with 95 % intervals over [`Identification::basis`].
    pub over_null_interval: Vec<Estimate>,
    /// Sums of absolute errors of each target over the parts that the intervals compare: parts x targets.
    pub absolute: Vec<Vec<f64>>,
    /// Mean absolute error of each target over the target's standard deviation.
    pub over_sigma: Vec<f64>,
    /// Coefficient of determination of each target.
    pub r2: Vec<f64>,
    /// Mean Mahalanobis score of the error vector under the covariance of the targets (equation (10)).
    pub mahalanobis: f64,
    /// Cross-validated squared error over variance, mean over targets and folds; NaN without folds.
    pub loss: f64,
    /// Its standard error across folds.
    pub standard_error: f64,
    /// The same loss, fold by fold.
    pub losses: Vec<f64>,
    /// Bayesian information criterion.
    pub bic: f64,
    /// Cost of continuity; `None` unless maps meet at their borders.
    pub continuity: Option<Continuity>,
    /// Contraction of its maps; `None` without [`Options::stability`](crate::Options::stability).
    pub stability: Option<Stability>,
    /// The loss of the free models in place of the bounded ones; the same without bounds. It is that of the training
    /// rows if none are held out.
    pub free_loss: f64,
    /// For a refined partition the objective after every pass over the rows that it was refined on: it falls. Empty for the others.
    pub objective: Vec<f64>,
}

/// Marks the front: partitions that no other one of as few coefficients beats on held-out rows.
pub(crate) fn mark(mut scores: Vec<Score>) -> Vec<Score> {
    let models: Vec<(usize, f64)> = scores.iter().map(|score| (score.coefficients, score.loss)).collect();
    scores.iter_mut().zip(front(&models)).for_each(|(score, on)| score.front = on);
    scores
}

/// Numbers of the maps of a partition with so many regions, of p regressors and q targets.
pub(crate) fn coefficients(
    specification: &Specification,
    regions: usize,
    (p, q): (usize, usize),
    continuity: Option<Continuity>,
) -> usize {
    match (specification, continuity) {
        (Specification::Null, _) => q,
        (_, Some(continuity)) => continuity.numbers * q,
        _ => regions * (p + 1) * q,
    }
}

impl Identification {
    /// Absolute error of candidate `a` over that of candidate `b`, for each target, on the same rows. Its interval is
    /// that of the paired parts, so that a part which is hard for both does not widen it.
    pub fn error_ratio(&self, a: usize, b: usize) -> Vec<Estimate> {
        let (a, b) = (&self.candidates[a].absolute, &self.candidates[b].absolute);
        (0..self.targets.len()).map(|t| Estimate::of_errors(a.iter().zip(b).map(|(a, b)| (a[t], b[t])))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn count_includes_all_regions_and_targets() {
        let count = |text: &str, regions: usize, continuity: Option<Continuity>| {
            coefficients(&Specification::parse_list(text).unwrap()[0], regions, (4, 3), continuity)
        };
        assert_eq!([count("null", 1, None), count("average", 1, None), count("kmeans:5", 5, None)], [3, 15, 75]);
    }
}

//! Sweeps over all targets and folds at once, and the choice among the models.

use fleetfoot_data::{Progress, parallel_map};
use fleetfoot_stats::Compressed;

use super::{
    FoldProblem, FoldScores, Matching, Optimizer, Step, Terms, ThresholdError, Thresholds, Trail,
    choose_by_cross_validation,
    criteria::{Criteria, Criterion, CriterionOptions, scores},
    sweep_thresholds,
};

/// How one of the models is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Choice {
    /// [`Choice::OneStandardError`] where there are folds, else BIC.
    #[default]
    Auto,
    /// The fewest terms that the folds cannot tell from the best.
    OneStandardError,
    /// The least held-out error.
    LeastError,
    /// The least value of a criterion.
    Criterion(Criterion),
    /// What the optimiser itself chooses.
    Optimizer,
}

/// How models are made and compared.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SweepOptions {
    /// Which thresholds.
    pub thresholds: Thresholds,
    /// How one model is chosen.
    pub choice: Choice,
    /// How criteria are computed.
    pub criteria: CriterionOptions,
    /// Whether held-out rows repeat between folds ([`Folds::overlap`](crate::Folds::overlap)).
    pub overlap: bool,
}

/// The models of one target, compared.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Sweep {
    /// The models, made on all rows.
    pub trail: Trail,
    /// Indices of those on the Pareto front of error against terms, the fewest terms first.
    pub front: Vec<usize>,
    /// Information criteria of every model.
    pub criteria: Criteria,
    /// Held-out errors, where folds were given.
    pub folds: Option<FoldScores>,
    /// Index of the chosen model.
    pub chosen: usize,
}

impl Sweep {
    /// The chosen model.
    pub fn choice(&self) -> &Step {
        &self.trail.steps[self.chosen]
    }
}

/// Makes and compares models of every target: on all rows, and again on every fold's training rows with the same thresholds (numbers of terms, lambdas).
///
/// `terms` has one entry a target. Targets and folds are independent work; the bits do not depend on the number of threads.
///
/// # Errors
/// As [`optimize`](crate::optimize), and when shapes disagree, a choice by folds has no folds, or the user stops it.
pub fn sweep(
    problem: &Compressed,
    folds: &[FoldProblem],
    terms: &[Terms],
    optimizer: &Optimizer,
    options: &SweepOptions,
    progress: &dyn Progress,
) -> Result<Vec<Sweep>, ThresholdError> {
    let targets = problem.targets();
    check_terms(terms, targets)?;
    for (index, fold) in folds.iter().enumerate() {
        same_shape("the training problem of fold", index, &fold.train, problem)?;
        same_shape("the held-out problem of fold", index, &fold.test, problem)?;
    }
    progress.stage("models on all rows");
    let trails = parallel_map(targets, progress, |target| {
        sweep_thresholds(problem, target, optimizer, &terms[target], &options.thresholds)
    })?;
    let (thresholded, count) = (matches!(optimizer, Optimizer::Stlsq(_) | Optimizer::Sr3(_)), folds.len());
    progress.stage("models of the folds");
    let own = parallel_map(targets * count, progress, |at| {
        let (target, fold) = (at / count, at % count);
        let same = Thresholds::List(trails[target].steps.iter().map(|step| step.parameter).collect());
        sweep_thresholds(&folds[fold].train, target, optimizer, &terms[target], &same)
    })?;
    let by_threshold = thresholded || matches!(optimizer, Optimizer::Lasso(_));
    let matching = if by_threshold { Matching::Threshold } else { Matching::Terms };
    let compared = trails.into_iter().enumerate().map(|(target, trail)| {
        let pairs: Vec<(&Trail, &FoldProblem)> = own[target * count..(target + 1) * count].iter().zip(folds).collect();
        compare(problem, trail, &pairs, (target, &terms[target]), matching, options)
    });
    compared.collect()
}

fn compare(
    problem: &Compressed,
    trail: Trail,
    folds: &[(&Trail, &FoldProblem)],
    (target, terms): (usize, &Terms),
    matching: Matching,
    options: &SweepOptions,
) -> Result<Sweep, ThresholdError> {
    let candidates = terms.checked(problem)?.open.len();
    let criteria = scores(&trail.steps, problem, target, candidates, &options.criteria)?;
    let wanted = matches!(options.choice, Choice::OneStandardError | Choice::LeastError);
    let folds = match folds.is_empty() && !wanted {
        true => None,
        false => Some(choose_by_cross_validation(&trail, folds, target, matching, options.overlap)?),
    };
    let chosen = match (options.choice, &folds) {
        (Choice::Auto | Choice::OneStandardError, Some(folds)) => folds.one_standard_error,
        (Choice::LeastError, Some(folds)) => folds.best,
        (Choice::Criterion(criterion), _) => criteria.best(criterion),
        (Choice::Optimizer, _) => trail.chosen,
        (Choice::Auto | Choice::OneStandardError | Choice::LeastError, None) => criteria.best(Criterion::Bic),
    };
    Ok(Sweep { front: trail.front(), trail, criteria, folds, chosen })
}

pub(super) fn check_terms(terms: &[Terms], targets: usize) -> Result<(), ThresholdError> {
    let found = terms.len();
    if found == targets {
        return Ok(());
    }
    Err(crate::SparseError::Length { what: "the list of the targets' terms", found, expected: targets }.into())
}

pub(super) fn same_shape(
    what: &'static str,
    index: usize,
    found: &Compressed,
    expected: &Compressed,
) -> Result<(), ThresholdError> {
    let shape = |problem: &Compressed| (problem.columns(), problem.targets());
    let ((columns, targets), (expected_columns, expected_targets)) = (shape(found), shape(expected));
    if (columns, targets) == (expected_columns, expected_targets) {
        return Ok(());
    }
    Err(ThresholdError::OtherProblem { what, index, columns, targets, expected_columns, expected_targets })
}

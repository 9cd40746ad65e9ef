//! Sweeps over all targets and folds at once, and the choice among the models.

use fleetfoot_data::{Progress, parallel_map};
use fleetfoot_stats::Compressed;

use super::{
    FoldProblem, FoldScores, Optimizer, Rivals, Step, Terms, ThresholdError, Thresholds, Trail,
    criteria::{Criteria, Criterion, CriterionOptions, scores},
    score_supports,
};

/// Rule by which one of the models is chosen.
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
    /// The optimiser's own choice.
    Optimizer,
}

/// Options for making and comparing models.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SweepOptions {
    /// Thresholds to compare.
    pub thresholds: Thresholds,
    /// Models that compete with those of the optimiser.
    pub rivals: Rivals,
    /// Rule by which one model is chosen.
    pub choice: Choice,
    /// Options of the criteria.
    pub criteria: CriterionOptions,
    /// True if held-out rows repeat between folds ([`Folds::overlap`](crate::select::Folds::overlap)).
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

/// Makes and compares models of every target: they are made on all rows, and what is compared are their supports, refitted on every fold's training rows. So
/// the held-out error of the chosen model is that of this model, and of no other that the same threshold makes of fewer rows.
///
/// `terms` has one entry a target. Targets and folds are independent work; the bits do not depend on the number of threads.
///
/// # Errors
/// As [`optimize`](crate::threshold::optimize), and when shapes disagree, a choice by folds has no folds, or the user stops it.
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
    progress.stage(&format!("models of {} candidates on all rows", problem.columns()));
    let trails = parallel_map(targets, progress, |target| {
        options.rivals.trail(problem, target, optimizer, &terms[target], &options.thresholds)
    })?;
    progress.stage(&format!("models of {} candidates on {} folds", problem.columns(), folds.len()));
    let compared = trails.into_iter().enumerate();
    compared
        .map(|(target, trail)| compare(problem, trail, folds, (target, &terms[target]), optimizer, (options, progress)))
        .collect()
}

fn compare(
    problem: &Compressed,
    trail: Trail,
    folds: &[FoldProblem],
    (target, terms): (usize, &Terms),
    optimizer: &Optimizer,
    (options, progress): (&SweepOptions, &dyn Progress),
) -> Result<Sweep, ThresholdError> {
    let candidates = terms.checked(problem)?.open.len();
    let criteria = scores(&trail.steps, problem, target, candidates, &options.criteria)?;
    let wanted = matches!(options.choice, Choice::OneStandardError | Choice::LeastError);
    let folds = match folds.is_empty() && !wanted {
        true => None,
        false => Some(score_supports(&trail.steps, folds, (target, terms), optimizer, options.overlap, progress)?),
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
    let count = terms.len();
    if count == targets {
        return Ok(());
    }
    Err(crate::SparseError::Length { what: "the list of the targets' terms", actual: count, expected: targets }.into())
}

pub(super) fn same_shape(
    what: &'static str,
    index: usize,
    compressed: &Compressed,
    expected: &Compressed,
) -> Result<(), ThresholdError> {
    let shape = |problem: &Compressed| (problem.columns(), problem.targets());
    let ((columns, targets), (expected_columns, expected_targets)) = (shape(compressed), shape(expected));
    if (columns, targets) == (expected_columns, expected_targets) {
        return Ok(());
    }
    Err(ThresholdError::OtherProblem { what, index, columns, targets, expected_columns, expected_targets })
}

//! Errors of a choice of lambda.

use fleetfoot_data::Cancelled;
use fleetfoot_data::setting::{CHUNK_ROWS, FOLDS};

use crate::SparseError;

/// Folds that cannot be made, or a criterion that has no value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SelectError {
    /// Fewer than two folds.
    #[error("{count} folds are asked for: cross-validation needs at least 2")]
    FoldCount {
        /// Number of folds.
        count: usize,
    },
    /// Too little to make folds of.
    #[error("{count} {what} cannot make {needed} folds: ask for fewer folds ({FOLDS}), or give more data")]
    TooFew {
        /// Chunks, episodes or groups.
        what: &'static str,
        /// Number of units.
        count: usize,
        /// Number of folds asked for.
        needed: usize,
    },
    /// The share of held-out rows is out of range.
    #[error("the held-out share of the rows is {value}: it must lie between 0 and 1, both excluded")]
    Share {
        /// The value.
        value: f64,
    },
    /// A fold that has no rows on one side.
    #[error(
        "fold {} has no rows to {side}: ask for fewer folds ({FOLDS}), give more data, or, of a statistic, scan with shorter chunks ({CHUNK_ROWS})",
        fold + 1
    )]
    EmptyFold {
        /// The fold, from 0; messages count from 1.
        fold: usize,
        /// "train" or "test".
        side: &'static str,
    },
    /// Lists that must have one entry a member.
    #[error("{what} has {actual} members, {expected} are needed")]
    Members {
        /// The list.
        what: &'static str,
        /// Its length.
        actual: usize,
        /// The length it must have.
        expected: usize,
    },
    /// No lambda to choose from.
    #[error("there is no lambda to choose from: the list is empty, or the paths of the folds have no lambda in common")]
    NoLambdas,
    /// A task that does not exist.
    #[error("there is no task {task}: there are {tasks}, counted from 0")]
    NoSuchTask {
        /// Number of the requested task.
        task: usize,
        /// Number of tasks.
        tasks: usize,
    },
    /// The noise variance of least squares is not known.
    #[error(
        "the noise variance cannot be taken from least squares: {observations} observations, {features} features, and the path ends at lambda = {end}; \
         continue it to 0, give the variance, or let it be profiled out"
    )]
    NoVariance {
        /// Number of observations.
        observations: f64,
        /// Degrees of freedom at the end of the path.
        features: f64,
        /// Lambda at the end of the path.
        end: f64,
    },
    /// EBIC's gamma is out of range.
    #[error("gamma is {value}: it lies between 0 (BIC) and 1")]
    Gamma {
        /// The value.
        value: f64,
    },
    /// An option out of its range.
    #[error("{name} is {value}: it is positive and finite")]
    NotPositive {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// Folds that cannot be made of the rows.
    #[error(transparent)]
    Folds(#[from] fleetfoot_stats::FoldError),
    /// A problem that cannot be posed.
    #[error(transparent)]
    Sparse(#[from] SparseError),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

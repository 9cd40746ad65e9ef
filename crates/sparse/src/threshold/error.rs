//! Errors of a thresholding.

use fleetfoot_data::Cancelled;

use crate::{SparseError, select::SelectError};

/// A problem that cannot be posed, or an option out of its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ThresholdError {
    /// An option that has to be finite and not negative.
    #[error("{name} is {value}: it is finite and not negative")]
    Negative {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// An option that has to be positive.
    #[error("{name} is {value}: it is positive and finite")]
    NotPositive {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A share outside 0 to 1.
    #[error("{name} is {value}: it lies between 0 and 1")]
    Share {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A candidate function that does not exist.
    #[error("column {column} is named as {what}, the problem has {columns} columns")]
    NoSuchColumn {
        /// Role in which the column is named.
        what: &'static str,
        /// The column.
        column: usize,
        /// Number of columns.
        columns: usize,
    },
    /// A term that is fixed and not allowed.
    #[error("column {column} is fixed in the model and not allowed in it: take it from one of the two lists")]
    FixedNotAllowed {
        /// The column.
        column: usize,
    },
    /// Bounds between which no coefficient lies.
    #[error(
        "the coefficient of column {column} cannot lie between {low} and {high}: the first is the lower bound, and infinities are open ends"
    )]
    Bounds {
        /// The column.
        column: usize,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// A method whose regressions know no bounds.
    #[error("{method} cannot bound coefficients: use stlsq, ssr or least squares")]
    BoundsNotKept {
        /// The method.
        method: &'static str,
    },
    /// Problems that must have the same columns and targets have not.
    #[error(
        "{what} {index} has {columns} columns and {targets} targets, the problem on all rows has {expected_columns} and {expected_targets}"
    )]
    OtherProblem {
        /// Kind of the problem, such as "the training problem of fold".
        what: &'static str,
        /// Number of the problem.
        index: usize,
        /// Its columns.
        columns: usize,
        /// Its targets.
        targets: usize,
        /// The columns it must have.
        expected_columns: usize,
        /// The targets it must have.
        expected_targets: usize,
    },
    /// Nothing to choose from.
    #[error("{what}: {mend}")]
    Nothing {
        /// Description of the missing part.
        what: &'static str,
        /// Remedy.
        mend: &'static str,
    },
    /// A library draw that leaves no candidate.
    #[error("every model would leave out {dropped} of {candidates} candidate functions: keep at least one")]
    Dropped {
        /// Number of candidates that are left out.
        dropped: usize,
        /// Number of candidates, the fixed ones not counted.
        candidates: usize,
    },
    /// The columns have no finite condition number.
    #[error(
        "the columns depend on each other, or hold huge values: their condition number, which kappa multiplies, is infinite; leave kappa out"
    )]
    NoCondition,
    /// The least squares underneath cannot be posed.
    #[error(transparent)]
    Sparse(#[from] SparseError),
    /// Folds that cannot be scored.
    #[error(transparent)]
    Select(#[from] SelectError),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

pub(super) fn not_negative(name: &'static str, value: f64) -> Result<f64, ThresholdError> {
    if value >= 0.0 && value.is_finite() { Ok(value) } else { Err(ThresholdError::Negative { name, value }) }
}

pub(super) fn positive(name: &'static str, value: f64) -> Result<f64, ThresholdError> {
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err(ThresholdError::NotPositive { name, value }) }
}

pub(super) fn share(name: &'static str, value: f64) -> Result<f64, ThresholdError> {
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(ThresholdError::Share { name, value }) }
}

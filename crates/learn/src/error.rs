//! Errors of training.

use fleetfoot_data::Cancelled;

/// Cause for which a network cannot be trained.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value is NaN or infinite.
    #[error("row {row}, column {column} is not finite")]
    NotFinite {
        /// Its row, from 0.
        row: usize,
        /// Its column among inputs and targets, from 0.
        column: usize,
    },
    /// A column has one value only.
    #[error("column {column} has the same value in all rows")]
    Constant {
        /// The column among inputs and targets, from 0.
        column: usize,
    },
    /// Too few rows to fit the numbers of the output layer.
    #[error("{rows} rows are too few: {least} are needed at least")]
    TooFewRows {
        /// Rows that there are.
        rows: usize,
        /// Rows that are needed.
        least: usize,
    },
    /// The parts do not belong together.
    #[error("{0}")]
    Shape(String),
    /// Training left the range of numbers.
    #[error("training diverged: the loss is not finite; a smaller learning rate helps")]
    Diverged,
    /// The work was stopped.
    #[error("stopped")]
    Cancelled,
}

impl From<Cancelled> for Error {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

//! Errors of a bootstrap.

use fleetfoot_data::Cancelled;

use crate::{SparseError, dense::DenseError};
use fleetfoot_sums::structured::ScanError;

/// Why a bootstrap or a stability selection failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BolassoError {
    /// The rows could not be read, or the regression does not fit the source.
    #[error(transparent)]
    Scan(#[from] ScanError),
    /// The problem or an option is out of range.
    #[error(transparent)]
    Sparse(#[from] SparseError),
    /// Rows in memory are at fault.
    #[error(transparent)]
    Dense(#[from] DenseError),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// No replicates were asked for.
    #[error("no replicates are asked for: Algorithm 1 needs at least one, 128 are usual")]
    NoReplicates,
    /// The share of replicates that must select a column is out of range.
    #[error("the selection threshold is {value}: it lies above {least} and is at most 1")]
    Threshold {
        /// The value.
        value: f64,
        /// Exclusive lower limit of the value.
        least: f64,
    },
    /// Too few episodes or chunks to resample.
    #[error(
        "there are {units} {unit}s to resample, at least {needed} are needed: scan more logs, or resample smaller units"
    )]
    TooFewUnits {
        /// Number of units.
        units: usize,
        /// Name of a unit.
        unit: &'static str,
        /// Number of units needed.
        needed: usize,
    },
    /// No lambdas were given.
    #[error("the grid of lambda is empty: stability selection needs at least one")]
    NoLambdas,
}

impl From<fleetfoot_data::Error> for BolassoError {
    fn from(error: fleetfoot_data::Error) -> Self {
        Self::Scan(ScanError::Data(error))
    }
}

impl From<fleetfoot_stats::scan::RowError> for BolassoError {
    fn from(error: fleetfoot_stats::scan::RowError) -> Self {
        Self::Scan(ScanError::Row(error))
    }
}

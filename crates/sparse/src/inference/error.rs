//! Errors of inference for a fit.

use fleetfoot_data::Cancelled;

use crate::SparseError;

/// A question about a fit that cannot be answered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InferenceError {
    /// The problem cannot be posed.
    #[error(transparent)]
    Problem(#[from] SparseError),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A support names a coefficient beyond the last.
    #[error("there is no coefficient {column}: there are {columns}, counted from 0")]
    NoSuchCoefficient {
        /// The coefficient.
        column: usize,
        /// Number of columns.
        columns: usize,
    },
    /// Coefficients that depend on the others of their support.
    #[error(
        "the rows and priors do not separate coefficients {columns:?} from the others of the support: drop them, add a prior, or ask which are confounded"
    )]
    NotIdentified {
        /// The dependent coefficients.
        columns: Vec<usize>,
    },
    /// A coefficient is NaN or infinite.
    #[error("coefficient {column} is not finite in the estimate or in a replicate")]
    NotFinite {
        /// The coefficient.
        column: usize,
    },
    /// No spread between fewer than two clusters.
    #[error(
        "{clusters} cluster(s): the spread between clusters needs two; cluster by chunk, or scan with shorter chunks"
    )]
    TooFewClusters {
        /// Number of clusters.
        clusters: usize,
    },
    /// No spread between fewer than two replicates.
    #[error("{replicates} replicate(s): quantiles need at least two, and useful ones some hundreds")]
    TooFewReplicates {
        /// Number of replicates.
        replicates: usize,
    },
    /// A level or limit out of range.
    #[error("{name} is {value}: it lies between 0 and 1")]
    Share {
        /// Name of the share.
        name: &'static str,
        /// The value.
        value: f64,
    },
}

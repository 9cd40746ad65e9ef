//! Why an identification could not be done.

use fleetfoot_data::setting::{CONTINUOUS, FOLDS, PARTITION_ON, PHASE, PURGE};

use crate::SpecificationError;

/// Why an identification could not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The rows could not be read.
    #[error(transparent)]
    Data(#[from] fleetfoot_data::Error),
    /// The user stopped the work.
    #[error(transparent)]
    Cancelled(#[from] fleetfoot_data::Cancelled),
    /// An expression reads a column that the source does not have.
    #[error(transparent)]
    UnknownColumn(#[from] fleetfoot_library::UnknownColumn),
    /// A partition could not be understood.
    #[error(transparent)]
    Specification(#[from] SpecificationError),
    /// Two parts of the statistic share a key.
    #[error(transparent)]
    Merge(#[from] fleetfoot_stats::MergeError),
    /// The sums cannot be made, or are not finite.
    #[error(transparent)]
    Sums(#[from] fleetfoot_sums::system::SystemError),
    /// k-means refused its input.
    #[error("clustering: {0}")]
    KMeans(#[from] crate::KMeansError),
    /// Nothing to fit to.
    #[error(
        "{complete} complete rows for {regressors} regressors: too few to fit ({at_border} rows lack neighbours at the border of their episode, \
         {incomplete} have a missing value); give more data, fewer regressors or shorter lags"
    )]
    TooFewRows {
        /// Rows with all values.
        complete: u64,
        /// Columns of the regression, the constant included.
        regressors: usize,
        /// Rows without all neighbours.
        at_border: u64,
        /// Rows with a missing value.
        incomplete: u64,
    },
    /// The purge gap swallows whole spans.
    #[error(
        "a purge gap of {purge} rows is longer than a held-out span ({span} rows of the longest episode in {folds} folds): no rows would be left \
         between them; choose fewer folds or a shorter {PURGE}"
    )]
    PurgeTooLong {
        /// Rows of the gap.
        purge: usize,
        /// Rows of a span of the longest episode.
        span: usize,
        /// Folds.
        folds: u16,
    },
    /// Folds that cannot be made of the rows.
    #[error(transparent)]
    Folds(#[from] fleetfoot_stats::FoldError),
    /// Too many episodes.
    #[error(transparent)]
    Plan(#[from] fleetfoot_stats::PlanError),
    /// A fold leaves nothing to train on.
    #[error(
        "no complete row is left to train on when fold {fold} of {folds} is held out; choose fewer folds ({given_folds} for none)", given_folds = FOLDS.to(0)
    )]
    NothingToTrain {
        /// The fold.
        fold: u16,
        /// Folds.
        folds: u16,
    },
    /// A target that never changes.
    #[error(
        "the target {target} has the same value {value} in all rows: there is nothing to predict; leave it out, or check its column"
    )]
    ConstantTarget {
        /// The left side of its equation.
        target: String,
        /// The value.
        value: f64,
    },
    /// Too many different labels.
    #[error("column `{column}` has more than {limit} different values: it does not look like a label")]
    TooManyLabels {
        /// The column.
        column: String,
        /// The largest number allowed.
        limit: usize,
    },
    /// A column that does not come round.
    #[error(
        "`{column}` ranges from {low} to {high}, but a phase lies within 0 and 1, or within 0 and 2 pi (or -pi and pi); mark a state or input as an angle (kind = \"angle\"), write a periodic expression such as wrap(6.283185*{column}/PERIOD), or name labels ({given_phase})", given_phase = PHASE.to(format_args!("labels:{column}"))
    )]
    NoPhase {
        /// The column.
        column: String,
        /// Its least value.
        low: f64,
        /// Its greatest.
        high: f64,
    },
    /// Separators of more numbers than their Hessian has room for.
    #[error(
        "refined:{regions} on {columns} partition columns needs {} numbers for its separators, and the limit is {limit}; ask for fewer regions or fewer columns ({PARTITION_ON})",
        regions * (columns + 1)
    )]
    TooManySeparators {
        /// Regions.
        regions: usize,
        /// Partition columns.
        columns: usize,
        /// Numbers that there may be.
        limit: usize,
    },
    /// Maps cannot meet at borders that are not linear.
    #[error(
        "{specification}: maps can meet only at linear borders, those of kmeans, refined and tree; name such a partition, or remove {CONTINUOUS}"
    )]
    NotLinear {
        /// The partition.
        specification: String,
    },
    /// Maps cannot meet at borders over a column that they do not see.
    #[error(
        "the partition column {column} is not a regressor, so affine maps cannot meet at a border over it; partition on regressors only ({PARTITION_ON}), or remove {CONTINUOUS}"
    )]
    NoRegressor {
        /// The partition column.
        column: String,
    },
    /// No equation has a target.
    #[error("there is no equation to fit: name at least one state whose derivative or next value the model predicts")]
    NothingToFit,
    /// Aliases that cannot be written out.
    #[error(transparent)]
    Closed(#[from] fleetfoot_model::ClosedError),
    /// A regressor is not linear in a state, so that no matrix describes the state's motion.
    #[error(
        "stability: the regressor `{function}` is not linear in the state `{state}`, so its motion cannot be bounded; leave it out of the library, or remove the bound"
    )]
    Bends {
        /// The regressor.
        function: String,
        /// The state.
        state: String,
    },
    /// No regressor reads a fitted state.
    #[error(
        "stability: no regressor reads a state with a fitted equation, so there is nothing to bound; remove the bound"
    )]
    NothingToBound,
    /// A pair that is no port.
    #[error(
        "passivity: {input}:{output} is not a port: {reason}; a port is an input and a state whose product is a power, such as a force and a speed"
    )]
    NoPort {
        /// The input.
        input: String,
        /// The state.
        output: String,
        /// Why.
        reason: String,
    },
    /// No storage is found.
    #[error(
        "passivity: no storage function makes all regions passive at {ports}; allow more energy gain (INPUT:OUTPUT:SHORTAGE), check that input times output is a power of the right sign, or remove the port"
    )]
    NoStorage {
        /// The ports.
        ports: String,
    },
    /// No metric is found.
    #[error("stability: no metric lets all regions contract by {bound} per sampling period; give a greater bound")]
    NoMetric {
        /// The bound.
        bound: f64,
    },
    /// A row that cannot be summed.
    #[error(transparent)]
    Row(#[from] fleetfoot_stats::scan::RowError),
}

impl Error {
    /// Returns true if the error says that memory is too small.
    pub fn is_memory(&self) -> bool {
        match self {
            Self::Plan(error) | Self::Sums(fleetfoot_sums::system::SystemError::Plan(error)) => error.is_memory(),
            Self::KMeans(error) => matches!(error, crate::KMeansError::Memory(_)),
            _ => false,
        }
    }
}

//! Errors of a pipeline. Every message names the place and the remedy.

use std::path::PathBuf;

use fleetfoot_recipe::{RequestError, request_constructors};

/// Errors of a pipeline.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The recipe cannot be understood, or the logs cannot be read through it.
    #[error(transparent)]
    Dataset(fleetfoot_dataset::Error),
    /// The parameters of a simulated robot cannot be understood, or are not allowed.
    #[error("{name}: {problem}")]
    World {
        /// Their file or origin.
        name: String,
        /// The problem, in words.
        problem: String,
    },
    /// The request cannot be met.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// The answer needs more memory than there is.
    #[error(transparent)]
    Memory(#[from] fleetfoot_data::OutOfMemory),
    /// The user stopped the work.
    #[error(transparent)]
    Cancelled(#[from] fleetfoot_data::Cancelled),
    /// A partition cannot be understood.
    #[error(transparent)]
    Specification(#[from] fleetfoot_pwa::SpecificationError),
    /// The identification failed.
    #[error(transparent)]
    Identification(#[from] fleetfoot_pwa::Error),
    /// A network could not be trained.
    #[error("network: {0}")]
    Network(fleetfoot_learn::Error),
    /// A regularised regression could not be posed or solved.
    #[error(transparent)]
    Sparse(#[from] fleetfoot_sparse::SparseError),
    /// Lambda could not be chosen.
    #[error(transparent)]
    Select(fleetfoot_sparse::select::SelectError),
    /// A bootstrap or stability selection failed.
    #[error(transparent)]
    Bolasso(fleetfoot_sparse::bolasso::BolassoError),
    /// A question about a fit that cannot be answered.
    #[error(transparent)]
    Inference(fleetfoot_sparse::inference::InferenceError),
    /// A fit under constraints has no answer.
    #[error(transparent)]
    Constrained(fleetfoot_sparse::constrained::ConstrainedError),
    /// The model cannot be written in another language.
    #[error(transparent)]
    Export(#[from] fleetfoot_codegen::ExportError),
    /// A network of another program cannot become a model.
    #[error("{}: {source}", path.display())]
    Import {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: fleetfoot_codegen::OnnxError,
    },
    /// Prediction, scoring or rolling out failed.
    #[error(transparent)]
    Dynamics(#[from] fleetfoot_dynamics::Error),
    /// A regulator or a filter cannot be made of the model.
    #[error(transparent)]
    Control(#[from] fleetfoot_control::Error),
    /// Sparse models could not be made.
    #[error(transparent)]
    Threshold(fleetfoot_sparse::threshold::ThresholdError),
    /// The statistic of a system of equations could not be made.
    #[error(transparent)]
    System(fleetfoot_sums::system::SystemError),
    /// Parameters inside expressions could not be estimated.
    #[error(transparent)]
    Estimate(fleetfoot_estimate::EstimateError),
    /// The pass over the rows failed.
    #[error(transparent)]
    Scan(#[from] fleetfoot_sums::structured::ScanError),
    /// Statistics that do not go together.
    #[error(transparent)]
    Merge(#[from] fleetfoot_stats::MergeError),
    /// An error, and its possible reasons.
    #[error("{error}; {reasons}")]
    WithReasons {
        /// The error.
        error: Box<Error>,
        /// Possible reasons, from the rows.
        reasons: String,
    },
    /// A model that predicts nothing.
    #[error(
        "the fit gave no usable model: {what}; look for values that are too large for squares (beyond 1e150) or too small and scale their columns, or leave out functions that are nearly equal"
    )]
    NotFinite {
        /// The coefficient that is not finite.
        what: String,
    },
    /// The user stopped a scan; its complete part is kept.
    #[error("stopped; the finished part is kept in {}: run the same command again to go on", path.display())]
    Paused {
        /// The file that keeps it.
        path: PathBuf,
    },
}

request_constructors!(Error);

impl Error {
    /// Returns true if the error says that memory is too small.
    pub fn is_memory(&self) -> bool {
        use fleetfoot_sums::{structured::ScanError, system::SystemError};
        match self {
            Self::Memory(_) => true,
            Self::Dataset(error) => error.is_memory(),
            Self::Estimate(fleetfoot_estimate::EstimateError::Memory(_)) => true,
            Self::Identification(error) => error.is_memory(),
            Self::System(SystemError::Plan(error)) | Self::Scan(ScanError::Plan(error)) => error.is_memory(),
            Self::WithReasons { error, .. } => error.is_memory(),
            _ => false,
        }
    }
}

/// A refused request, too little memory and a stop by the user are one error each, whatever was being done.
impl From<fleetfoot_dataset::Error> for Error {
    fn from(error: fleetfoot_dataset::Error) -> Self {
        match error {
            fleetfoot_dataset::Error::Request(request) => Self::Request(request),
            fleetfoot_dataset::Error::Memory(memory) => Self::Memory(memory),
            fleetfoot_dataset::Error::Cancelled(cancelled) => Self::Cancelled(cancelled),
            fleetfoot_dataset::Error::Rows(error) => error.into(),
            fleetfoot_dataset::Error::Merge(error) => error.into(),
            other => Self::Dataset(other),
        }
    }
}

impl From<fleetfoot_task::Error> for Error {
    fn from(error: fleetfoot_task::Error) -> Self {
        match error {
            fleetfoot_task::Error::Recipe(error) => error.into(),
            fleetfoot_task::Error::Rows(error) => error.into(),
        }
    }
}

/// Errors of opening logs, where a pipeline meets them itself.
macro_rules! of_dataset {
    ($($error:ty),*) => {
        $(impl From<$error> for Error {
            fn from(error: $error) -> Self {
                fleetfoot_dataset::Error::from(error).into()
            }
        })*
    };
}

of_dataset!(
    fleetfoot_recipe::Error,
    fleetfoot_dataset::StatisticError,
    fleetfoot_log::Error,
    fleetfoot_output::Error,
    fleetfoot_data::Error,
    fleetfoot_library::UnknownColumn,
    fleetfoot_library::LibraryError,
    fleetfoot_library::FilterError,
    fleetfoot_model::FileError
);

/// Stopped by the user is one error, whatever was being done.
macro_rules! or_cancelled {
    ($($variant:ident($room:ident::$module:ident::$error:ident)),*) => {
        $(impl From<$room::$module::$error> for Error {
            fn from(error: $room::$module::$error) -> Self {
                match error {
                    $room::$module::$error::Cancelled(cancelled) => Self::Cancelled(cancelled),
                    other => Self::$variant(other),
                }
            }
        })*
    };
}

or_cancelled!(
    Select(fleetfoot_sparse::select::SelectError),
    Bolasso(fleetfoot_sparse::bolasso::BolassoError),
    Inference(fleetfoot_sparse::inference::InferenceError),
    Constrained(fleetfoot_sparse::constrained::ConstrainedError),
    Threshold(fleetfoot_sparse::threshold::ThresholdError),
    System(fleetfoot_sums::system::SystemError)
);

impl From<fleetfoot_learn::Error> for Error {
    fn from(error: fleetfoot_learn::Error) -> Self {
        match error {
            fleetfoot_learn::Error::Cancelled => Self::Cancelled(fleetfoot_data::Cancelled),
            fleetfoot_learn::Error::TooFewRows { rows, least } => {
                Self::too_few_rows(rows as u64, least as u64, format!("network: {error}"))
            }
            other => Self::Network(other),
        }
    }
}

impl From<fleetfoot_estimate::EstimateError> for Error {
    fn from(error: fleetfoot_estimate::EstimateError) -> Self {
        match error {
            fleetfoot_estimate::EstimateError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Estimate(other),
        }
    }
}

//! What can go wrong in a pipeline. Every message says where, and what to do.

use std::path::PathBuf;

use fleetfoot_data::did_you_mean;

use crate::{Cause, RequestError, statistic_error::StatisticError};

/// What can go wrong in a pipeline.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The recipe cannot be understood.
    #[error("{name}: {problem}")]
    Recipe {
        /// The recipe's file or origin.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// An expression cannot be understood.
    #[error("{place} = \"{text}\": {source}")]
    Expression {
        /// Where it stands.
        place: String,
        /// The expression.
        text: String,
        /// What is wrong.
        source: fleetfoot_library::ParseError,
    },
    /// A column that does not exist.
    #[error("{place}: there is no column `{name}`{}", meant(.candidates))]
    UnknownColumn {
        /// Where it was asked for.
        place: String,
        /// The name.
        name: String,
        /// The nearest names.
        candidates: Vec<String>,
    },
    /// The parameters of a simulated robot cannot be understood, or are not allowed.
    #[error("{name}: {problem}")]
    World {
        /// Their file or origin.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// What was asked for cannot be done.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// A partition by what is predicted.
    #[error(
        "the partition looks at `{column}`, which tells `{target}`, and that is what is predicted: the region of a row would not be known before its \
         answer; name other columns with --partition-on, or its past: lag({target}, 1)"
    )]
    TargetInPartition {
        /// The column of the partition.
        column: String,
        /// The target.
        target: String,
    },
    /// A model that advances row by row on rows of another period.
    #[error(
        "{}: its rows are {} s apart, those that the model was fitted on {} s, and it advances row by row, so that its numbers would mean nothing; {mend}; \
         if the stamps of this log are wrong, give its period with --dt", path.display(), short(*found), short(*expected)
    )]
    OtherPeriod {
        /// The log.
        path: PathBuf,
        /// Its period, s.
        found: f64,
        /// The model's, s.
        expected: f64,
        /// What to do.
        mend: String,
    },
    /// Text where numbers are read.
    #[error("{}: {what} holds text ({found}), and text is no number: {mend}", path.display())]
    TextAsNumber {
        /// The log.
        path: PathBuf,
        /// The column and its part.
        what: String,
        /// The first value that is no number, and where it stands.
        found: String,
        /// How the column is read.
        mend: String,
    },
    /// A label that the model has not seen.
    #[error(
        "{rows} rows have labels of `{column}` that the model has not seen ({labels}); leave them out, or fit with --unseen-labels pool"
    )]
    UnseenLabel {
        /// The column.
        column: String,
        /// Some of the labels.
        labels: String,
        /// How many rows.
        rows: u64,
    },
    /// Reading or writing files.
    #[error(transparent)]
    Log(#[from] fleetfoot_log::Error),
    /// Reading rows.
    #[error(transparent)]
    Data(#[from] fleetfoot_data::Error),
    /// The answer needs more memory than there is.
    #[error(transparent)]
    Memory(#[from] fleetfoot_data::OutOfMemory),
    /// The user stopped the work.
    #[error(transparent)]
    Cancelled(#[from] fleetfoot_data::Cancelled),
    /// Compiling expressions.
    #[error(transparent)]
    Columns(#[from] fleetfoot_library::UnknownColumn),
    /// The library of functions is too large.
    #[error(transparent)]
    Library(#[from] fleetfoot_library::LibraryError),
    /// A partition cannot be understood.
    #[error(transparent)]
    Specification(#[from] fleetfoot_pwa::SpecificationError),
    /// The identification failed.
    #[error(transparent)]
    Identification(#[from] fleetfoot_pwa::Error),
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
    /// A model file was refused.
    #[error(transparent)]
    Model(#[from] fleetfoot_model::FileError),
    /// The model cannot be written in another language.
    #[error(transparent)]
    Export(#[from] fleetfoot_codegen::ExportError),
    /// Prediction, scoring or rolling out failed.
    #[error(transparent)]
    Dynamics(#[from] fleetfoot_dynamics::Error),
    /// A regulator or a filter cannot be made of the model.
    #[error(transparent)]
    Control(#[from] fleetfoot_control::Error),
    /// A `.stats` file, or what was asked of it, was refused.
    #[error(transparent)]
    Statistic(#[from] StatisticError),
    /// Sparse models could not be made.
    #[error(transparent)]
    Threshold(fleetfoot_sparse::threshold::ThresholdError),
    /// The statistic of a system of equations could not be made.
    #[error(transparent)]
    System(fleetfoot_sparse::system::SystemError),
    /// Parameters inside expressions could not be estimated.
    #[error(transparent)]
    Estimate(fleetfoot_estimate::EstimateError),
    /// A channel cannot be prepared.
    #[error("{episode}, `{channel}`: {source}")]
    Signal {
        /// The episode.
        episode: String,
        /// The state or input.
        channel: String,
        /// What is wrong.
        source: fleetfoot_signal::SignalError,
    },
    /// A filter cannot be computed.
    #[error(transparent)]
    Filter(#[from] fleetfoot_library::FilterError),
    /// The pass over the rows failed.
    #[error(transparent)]
    Scan(#[from] fleetfoot_sparse::structured::ScanError),
    /// Statistics that do not go together.
    #[error(transparent)]
    Merge(#[from] fleetfoot_stats::MergeError),
    /// An error, and what may be behind it.
    #[error("{error}; {reasons}")]
    WithReasons {
        /// The error.
        error: Box<Error>,
        /// What was found in the rows.
        reasons: String,
    },
    /// A model that predicts nothing.
    #[error(
        "the fit gave no usable model: {what}; look for values that are too large for squares (beyond 1e150) or too small, and scale their columns, \
         or leave functions out that cannot be told apart"
    )]
    NotFinite {
        /// The coefficient that is not finite.
        what: String,
    },
    /// The user stopped a scan, and what is complete is kept.
    #[error("stopped; what is done is kept in {}: the same command goes on from there", path.display())]
    Paused {
        /// The file that keeps it.
        path: PathBuf,
    },
    /// A file could not be written.
    #[error("{path}: cannot be written: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Error {
    /// Whether less memory would have done.
    pub fn is_memory(&self) -> bool {
        use fleetfoot_sparse::{structured::ScanError, system::SystemError};
        match self {
            Self::Memory(_) => true,
            Self::Log(fleetfoot_log::Error::Memory(_)) => true,
            Self::Estimate(fleetfoot_estimate::EstimateError::Memory(_)) => true,
            Self::Identification(error) => error.is_memory(),
            Self::System(SystemError::Plan(error)) | Self::Scan(ScanError::Plan(error)) => error.is_memory(),
            Self::WithReasons { error, .. } => error.is_memory(),
            _ => false,
        }
    }
}

/// One constructor a cause.
impl Error {
    fn request(cause: Cause, message: String) -> Self {
        Self::Request(RequestError { cause, message })
    }

    /// [`Cause::Value`].
    pub fn value(message: String) -> Self {
        Self::request(Cause::Value, message)
    }

    /// [`Cause::Conflict`].
    pub fn conflict(message: String) -> Self {
        Self::request(Cause::Conflict, message)
    }

    /// [`Cause::Missing`].
    pub fn missing(message: String) -> Self {
        Self::request(Cause::Missing, message)
    }

    /// [`Cause::UnknownName`].
    pub fn unknown(name: impl Into<String>, message: String) -> Self {
        Self::request(Cause::UnknownName { name: name.into() }, message)
    }

    /// [`Cause::NameTaken`].
    pub fn name_taken(name: impl Into<String>, message: String) -> Self {
        Self::request(Cause::NameTaken { name: name.into() }, message)
    }

    /// [`Cause::TooFewRows`].
    pub fn too_few_rows(rows: u64, needed: u64, message: String) -> Self {
        Self::request(Cause::TooFewRows { rows, needed }, message)
    }

    /// [`Cause::NeedsRows`].
    pub fn needs_rows(message: String) -> Self {
        Self::request(Cause::NeedsRows, message)
    }

    /// [`Cause::OtherStatistic`].
    pub fn other_statistic(message: String) -> Self {
        Self::request(Cause::OtherStatistic, message)
    }

    /// [`Cause::Undetermined`].
    pub fn undetermined(message: String) -> Self {
        Self::request(Cause::Undetermined, message)
    }

    /// [`Cause::Output`].
    pub fn output(message: String) -> Self {
        Self::request(Cause::Output, message)
    }

    /// [`Cause::Internal`].
    pub fn internal(message: String) -> Self {
        Self::request(Cause::Internal, message)
    }
}

/// Stopped by the user is one error, whatever was being done.
macro_rules! or_cancelled {
    ($($variant:ident($module:ident::$error:ident)),*) => {
        $(impl From<fleetfoot_sparse::$module::$error> for Error {
            fn from(error: fleetfoot_sparse::$module::$error) -> Self {
                match error {
                    fleetfoot_sparse::$module::$error::Cancelled(cancelled) => Self::Cancelled(cancelled),
                    other => Self::$variant(other),
                }
            }
        })*
    };
}

or_cancelled!(
    Select(select::SelectError),
    Bolasso(bolasso::BolassoError),
    Inference(inference::InferenceError),
    Constrained(constrained::ConstrainedError),
    Threshold(threshold::ThresholdError),
    System(system::SystemError)
);

impl From<fleetfoot_estimate::EstimateError> for Error {
    fn from(error: fleetfoot_estimate::EstimateError) -> Self {
        match error {
            fleetfoot_estimate::EstimateError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Estimate(other),
        }
    }
}

/// A positive number with five digits at most.
pub(crate) fn short(value: f64) -> f64 {
    if value > 0.0 && value.is_finite() { format!("{value:.4e}").parse().unwrap_or(value) } else { value }
}

/// What a name may have meant, else where names are found.
fn meant(candidates: &[String]) -> String {
    match did_you_mean(candidates) {
        nothing if nothing.is_empty() => "; `fleetfoot info` lists those of a log".to_owned(),
        near => near,
    }
}

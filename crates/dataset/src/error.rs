//! Errors between a recipe and the rows of its logs. Every message states the place and the remedy.

use fleetfoot_data::setting::{DT, UNSEEN_LABELS};

use std::path::PathBuf;

use fleetfoot_recipe::{RequestError, request_constructors};

use crate::statistic_error::StatisticError;

/// Errors between a recipe and the rows of its logs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The recipe cannot be understood.
    #[error(transparent)]
    Recipe(fleetfoot_recipe::Error),
    /// A request that cannot be fulfilled.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// A model that advances row by row on rows of another period.
    #[error(
        "{}: its rows are {} s apart and the model advances by rows of {} s, so its predictions would be wrong; {mend}; \
         if the stamps of this log are wrong, give its period with {DT}", path.display(), short(*period), short(*expected)
    )]
    OtherPeriod {
        /// The log.
        path: PathBuf,
        /// Its period, s.
        period: f64,
        /// The model's, s.
        expected: f64,
        /// Remedy.
        mend: String,
    },
    /// Text where numbers are read.
    #[error("{}: {what} holds text ({first}), instead of numbers: {mend}", path.display())]
    TextAsNumber {
        /// The log.
        path: PathBuf,
        /// The column and its part.
        what: String,
        /// The first value that is no number, and where it stands.
        first: String,
        /// Remedy: the setting or the change of the data that makes the column readable.
        mend: String,
    },
    /// A label that the model has not seen.
    #[error(
        "{rows} rows have labels of `{column}` that the model has not seen ({labels}); leave them out, or fit with {given_unseen_labels}", given_unseen_labels = UNSEEN_LABELS.to("pool")
    )]
    UnseenLabel {
        /// The column.
        column: String,
        /// Some of the labels.
        labels: String,
        /// Number of rows.
        rows: u64,
    },
    /// Reading files.
    #[error(transparent)]
    Log(#[from] fleetfoot_log::Error),
    /// Writing files.
    #[error(transparent)]
    Output(#[from] fleetfoot_output::Error),
    /// Reading rows.
    #[error(transparent)]
    Data(#[from] fleetfoot_data::Error),
    /// The answer needs more memory than there is.
    #[error(transparent)]
    Memory(#[from] fleetfoot_data::OutOfMemory),
    /// The user stopped the work.
    #[error(transparent)]
    Cancelled(#[from] fleetfoot_data::Cancelled),
    /// A model file was refused.
    #[error(transparent)]
    Model(#[from] fleetfoot_model::FileError),
    /// A channel cannot be prepared.
    #[error("{episode}, `{channel}`: {source}")]
    Signal {
        /// The episode.
        episode: String,
        /// The state or input.
        channel: String,
        /// Error of the signal.
        source: fleetfoot_signal::SignalError,
    },
    /// A file could not be written.
    #[error("{path}: cannot be written: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The pass over the rows failed.
    #[error(transparent)]
    Rows(#[from] fleetfoot_sums::system::SystemError),
    /// Statistics that do not go together.
    #[error(transparent)]
    Merge(#[from] fleetfoot_stats::MergeError),
    /// A `.stats` file, or a request to it, was refused.
    #[error(transparent)]
    Statistic(#[from] StatisticError),
}

request_constructors!(Error);

impl Error {
    /// Returns true if the request would succeed with less memory.
    pub fn is_memory(&self) -> bool {
        matches!(self, Self::Memory(_) | Self::Log(fleetfoot_log::Error::Memory(_)))
    }
}

/// A refused request is one error, whoever refused it.
impl From<fleetfoot_recipe::Error> for Error {
    fn from(error: fleetfoot_recipe::Error) -> Self {
        match error {
            fleetfoot_recipe::Error::Request(request) => Self::Request(request),
            other => Self::Recipe(other),
        }
    }
}

/// Errors of expressions, where logs are opened through them.
macro_rules! of_recipe {
    ($($error:ty),*) => {
        $(impl From<$error> for Error {
            fn from(error: $error) -> Self {
                fleetfoot_recipe::Error::from(error).into()
            }
        })*
    };
}

of_recipe!(fleetfoot_library::UnknownColumn, fleetfoot_library::LibraryError, fleetfoot_library::FilterError);

/// A positive number with five digits at most.
pub fn short(value: f64) -> f64 {
    if value > 0.0 && value.is_finite() { format!("{value:.4e}").parse().unwrap_or(value) } else { value }
}

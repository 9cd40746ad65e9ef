//! What can go wrong with the words of a recipe. Every message says where, and what to do.

use fleetfoot_data::did_you_mean;
use fleetfoot_data::setting::{self, INFO, PARTITION_ON};

use crate::{request::RequestError, request_constructors};

/// What can go wrong with the words of a recipe.
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
    #[error("{}: {source}", setting::assigned(place, text))]
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
    /// What was asked for cannot be done.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// A partition by what is predicted.
    #[error(
        "the partition looks at `{column}`, which tells `{target}`, and that is what is predicted: the region of a row would not be known before its \
         answer; name other columns with {PARTITION_ON}, or its past: lag({target}, 1)"
    )]
    TargetInPartition {
        /// The column of the partition.
        column: String,
        /// The target.
        target: String,
    },
    /// Compiling expressions.
    #[error(transparent)]
    Columns(#[from] fleetfoot_library::UnknownColumn),
    /// The library of functions is too large.
    #[error(transparent)]
    Library(#[from] fleetfoot_library::LibraryError),
    /// A filter cannot be computed.
    #[error(transparent)]
    Filter(#[from] fleetfoot_library::FilterError),
}

request_constructors!(Error);

/// What a name may have meant, else where names are found.
fn meant(candidates: &[String]) -> String {
    match did_you_mean(candidates) {
        nothing if nothing.is_empty() => format!("; {INFO} lists those of a log"),
        near => near,
    }
}

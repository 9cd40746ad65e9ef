//! Errors in the settings of a recipe. Every message names the place and the remedy.

use fleetfoot_data::did_you_mean;
use fleetfoot_data::setting::{self, INFO, PARTITION_ON};

use crate::{request::RequestError, request_constructors};

/// Errors in the settings of a recipe.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The recipe cannot be understood.
    #[error("{name}: {problem}")]
    Recipe {
        /// The recipe's file or origin.
        name: String,
        /// The problem, in words.
        problem: String,
    },
    /// An expression cannot be understood.
    #[error("{}: {source}", setting::assigned(place, text))]
    Expression {
        /// Its place.
        place: String,
        /// The expression.
        text: String,
        /// The problem.
        source: fleetfoot_library::ParseError,
    },
    /// A column that does not exist.
    #[error("{place}: there is no column `{name}`{}", meant(.candidates))]
    UnknownColumn {
        /// Place of the name.
        place: String,
        /// The name.
        name: String,
        /// The nearest names.
        candidates: Vec<String>,
    },
    /// The request cannot be met.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// A partition by the predicted quantity.
    #[error(
        "the partition uses `{column}`, which determines the target `{target}`: the region of a row would be unknown before its \
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

/// Suggestion of similar names, else the command that lists names.
fn meant(candidates: &[String]) -> String {
    match did_you_mean(candidates) {
        nothing if nothing.is_empty() => format!("; {INFO} lists those of a log"),
        near => near,
    }
}

//! What was asked for and cannot be done: a cause that a program can act on, and a message for people.

use crate::Error;

/// A request that cannot be met.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct RequestError {
    /// Why.
    pub cause: Cause,
    /// Where, what, and what to do about it.
    pub message: String,
}

/// Why a request cannot be met.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// An option, or a key of the recipe, has a value that it does not take.
    Value,
    /// Two options exclude each other, or one is of no use without another.
    Conflict,
    /// Something that is needed was not given.
    Missing,
    /// Nothing has this name.
    UnknownName {
        /// The name.
        name: String,
    },
    /// Two things would have this name.
    NameTaken {
        /// The name.
        name: String,
    },
    /// Too few rows for what is to be learnt from them.
    TooFewRows {
        /// Rows that can be used.
        rows: u64,
        /// How many it takes at least.
        needed: u64,
    },
    /// It takes the rows of logs, and a statistic has none.
    NeedsRows,
    /// The statistic was scanned for something else.
    OtherStatistic,
    /// The data do not determine what was asked for.
    Undetermined,
    /// A file that cannot be written as asked: it stands in the way, or its kind does not fit.
    Output,
    /// A mistake in fleetfoot itself.
    Internal,
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

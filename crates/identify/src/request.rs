//! What was asked for and cannot be done: a cause that a program can act on, and a message for people.

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

//! Requests that cannot be met: a cause that a program can act on, and a message for people.

/// A request that cannot be met.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct RequestError {
    /// Why.
    pub cause: Cause,
    /// Place, problem and remedy.
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
    /// Too few rows for the fit.
    TooFewRows {
        /// Rows that can be used.
        rows: u64,
        /// The least number of rows.
        needed: u64,
    },
    /// It takes the rows of logs, and a statistic has none.
    NeedsRows,
    /// The statistic was scanned for something else.
    OtherStatistic,
    /// The data do not determine the answer.
    Undetermined,
    /// An output file that cannot be written: a file stands in the way, or its kind does not fit.
    Output,
    /// A mistake in fleetfoot itself.
    Internal,
}

/// Gives an error one constructor for every [`Cause`](crate::Cause) of a request that cannot be met.
#[macro_export]
macro_rules! request_constructors {
    ($error:ident) => {
        /// One constructor a cause.
        impl $error {
            fn request(cause: $crate::Cause, message: String) -> Self {
                Self::Request($crate::RequestError { cause, message })
            }

            /// [`Cause::Value`]($crate::Cause::Value).
            pub fn value(message: String) -> Self {
                Self::request($crate::Cause::Value, message)
            }

            /// [`Cause::Conflict`]($crate::Cause::Conflict).
            pub fn conflict(message: String) -> Self {
                Self::request($crate::Cause::Conflict, message)
            }

            /// [`Cause::Missing`]($crate::Cause::Missing).
            pub fn missing(message: String) -> Self {
                Self::request($crate::Cause::Missing, message)
            }

            /// [`Cause::UnknownName`]($crate::Cause::UnknownName).
            pub fn unknown(name: impl Into<String>, message: String) -> Self {
                Self::request($crate::Cause::UnknownName { name: name.into() }, message)
            }

            /// [`Cause::NameTaken`]($crate::Cause::NameTaken).
            pub fn name_taken(name: impl Into<String>, message: String) -> Self {
                Self::request($crate::Cause::NameTaken { name: name.into() }, message)
            }

            /// [`Cause::TooFewRows`]($crate::Cause::TooFewRows).
            pub fn too_few_rows(rows: u64, needed: u64, message: String) -> Self {
                Self::request($crate::Cause::TooFewRows { rows, needed }, message)
            }

            /// [`Cause::NeedsRows`]($crate::Cause::NeedsRows).
            pub fn needs_rows(message: String) -> Self {
                Self::request($crate::Cause::NeedsRows, message)
            }

            /// [`Cause::OtherStatistic`]($crate::Cause::OtherStatistic).
            pub fn other_statistic(message: String) -> Self {
                Self::request($crate::Cause::OtherStatistic, message)
            }

            /// [`Cause::Undetermined`]($crate::Cause::Undetermined).
            pub fn undetermined(message: String) -> Self {
                Self::request($crate::Cause::Undetermined, message)
            }

            /// [`Cause::Output`]($crate::Cause::Output).
            pub fn output(message: String) -> Self {
                Self::request($crate::Cause::Output, message)
            }

            /// [`Cause::Internal`]($crate::Cause::Internal).
            pub fn internal(message: String) -> Self {
                Self::request($crate::Cause::Internal, message)
            }
        }
    };
}

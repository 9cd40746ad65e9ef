//! Errors of filters.

use crate::UnknownColumn;

/// Why filters cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// A constant with names in it.
    #[error("the second argument of `{filter}` has no value: `{name}` is not a parameter with a number")]
    NoValue {
        /// The filter.
        filter: String,
        /// The first name in its constant.
        name: String,
    },
    /// A constant out of its range.
    #[error("`{filter}` has {value} seconds: {allowed}")]
    Range {
        /// The filter.
        filter: String,
        /// The value of its constant.
        value: f64,
        /// The allowed range.
        allowed: &'static str,
    },
    /// The input reads a column that is not there.
    #[error("in the filter `{filter}`: {error}")]
    UnknownColumn {
        /// The filter.
        filter: String,
        /// The column.
        error: UnknownColumn,
    },
}

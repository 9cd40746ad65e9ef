//! Limit of the number of values in a column of labels.

use std::collections::BTreeSet;

use crate::Error;

/// Different values that a label column may have.
const LIMIT: usize = 1_000;

/// Refuses a column with more values (bits of numbers) than labels have.
///
/// # Errors
/// There are more.
pub(crate) fn limit_labels(column: &str, seen: &BTreeSet<u64>) -> Result<(), Error> {
    if seen.len() > LIMIT {
        return Err(Error::TooManyLabels { column: column.to_owned(), limit: LIMIT });
    }
    Ok(())
}

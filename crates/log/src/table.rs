//! Interface of a file format: rows, stamps and values by range of rows.

use std::ops::Range;

use fleetfoot_data::{Column, ScalarBuffer};

use crate::Error;

/// A stamp that is missing or cannot be read.
pub(crate) const MISSING: i64 = i64::MIN;

/// Different texts that a category may have.
pub(crate) const MAX_CATEGORIES: usize = 65_536;

/// Rows of a file as columns; the seam between the formats and the recording.
pub(crate) trait Table: Send + Sync {
    /// Rows of the file, whatever their stamps.
    fn rows(&self) -> usize;

    /// The selected columns, in the order of the selection. Categories carry this file's own names.
    fn columns(&self) -> &[TableColumn];

    /// Ranges that are decoded independently of each other, in order, covering all rows.
    fn pieces(&self) -> Vec<Range<usize>>;

    /// The stamps of these rows, nanoseconds, [`MISSING`] where there is none; empty when the table has no time column.
    fn stamps(&self, rows: Range<usize>) -> Result<ScalarBuffer<i64>, Error>;

    /// The selected columns of these rows. `keep` is the number of rows at the end that a following read will probably repeat.
    fn values(&self, rows: Range<usize>, keep: usize) -> Result<TableRows, Error>;
}

/// Rows read from a table.
pub(crate) struct TableRows {
    /// Stamps as of [`Table::stamps`].
    pub time: ScalarBuffer<i64>,
    /// Values, one buffer a column.
    pub columns: Vec<ScalarBuffer<f64>>,
}

/// A selected column as this file has it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TableColumn {
    /// Name, unit and kind.
    pub column: Column,
    /// No value was seen, so that the kind says nothing.
    pub empty: bool,
}

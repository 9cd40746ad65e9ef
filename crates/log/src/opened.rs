//! What opening a file gives, whichever format it is in.

use crate::{Stamp, TimeUnit, breaks::Breaks, table::Table};

/// What opening a file gives: its table and what had to be assumed.
pub(crate) struct Opened {
    pub table: Box<dyn Table>,
    /// The unit that was assumed for whole-number stamps: it must be the same in all files.
    pub assumed_unit: Option<TimeUnit>,
    pub time_column: Option<String>,
    pub notes: Vec<String>,
    /// Which of its messages' stamps were taken, of a robot's log.
    pub stamp: Option<Stamp>,
    /// What must be added to the stamps to get the log's, nanoseconds.
    pub log_offset: i64,
    /// Where rows are known to be lost.
    pub breaks: Breaks,
}

impl Opened {
    /// A table whose stamps are a column of its own, or none.
    pub(crate) fn of_table(
        table: Box<dyn Table>,
        assumed_unit: Option<TimeUnit>,
        time_column: Option<String>,
        notes: Vec<String>,
    ) -> Self {
        Self { table, assumed_unit, time_column, notes, stamp: None, log_offset: 0, breaks: Breaks::default() }
    }
}

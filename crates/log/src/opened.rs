//! Result of opening a file of any format.

use crate::{
    Stamp,
    breaks::Breaks,
    cycles::Cycle,
    table::Table,
    time_column::{Chosen, SettledClock},
};

/// Result of opening a file: its table, and notes on assumptions.
pub(crate) struct Opened {
    pub table: Box<dyn Table>,
    /// Name of the stamps' column, for messages; `None` without a clock.
    pub time_column: Option<String>,
    /// The way in which its stamps may begin anew.
    pub cycle: Cycle,
    /// Origin of the choice of that column.
    pub chosen: Chosen,
    pub notes: Vec<String>,
    /// Kind of its messages' stamps that was used, for a robot's log.
    pub stamp: Option<Stamp>,
    /// Offset to add to the stamps for the log's times, nanoseconds.
    pub log_offset: i64,
    /// Breaks at which rows are known to be lost.
    pub breaks: Breaks,
    /// First rows of the sessions behind the first one, of a text file that has several.
    pub sessions: Vec<usize>,
}

impl Opened {
    /// A table whose stamps are a column of its own, or none.
    pub(crate) fn of_table(table: Box<dyn Table>, clock: Option<SettledClock>, notes: Vec<String>) -> Self {
        let chosen = clock.as_ref().map_or(Chosen::Caller, |clock| clock.chosen);
        Self {
            table,
            time_column: clock.map(|clock| clock.name),
            cycle: Cycle::Never,
            chosen,
            notes,
            stamp: None,
            log_offset: 0,
            breaks: Breaks::default(),
            sessions: Vec::new(),
        }
    }
}

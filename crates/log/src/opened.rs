//! What opening a file gives, whichever format it is in.

use crate::{
    Stamp,
    breaks::Breaks,
    table::Table,
    time_column::{Chosen, SettledClock},
};

/// What opening a file gives: its table and what had to be assumed.
pub(crate) struct Opened {
    pub table: Box<dyn Table>,
    /// Where its stamps are, for messages; `None` without a clock.
    pub time_column: Option<String>,
    /// Whether its stamps may be times of the day, which pass midnight.
    pub of_day: bool,
    /// Who chose that column.
    pub chosen: Chosen,
    pub notes: Vec<String>,
    /// Which of its messages' stamps were taken, of a robot's log.
    pub stamp: Option<Stamp>,
    /// What must be added to the stamps to get the log's, nanoseconds.
    pub log_offset: i64,
    /// Where rows are known to be lost.
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
            of_day: false,
            chosen,
            notes,
            stamp: None,
            log_offset: 0,
            breaks: Breaks::default(),
            sessions: Vec::new(),
        }
    }
}

//! Tables of an SQLite database, read and never written: as much of the format as rosbag2's recordings need.
//!
//! Format: <https://www.sqlite.org/fileformat2.html>. A [`Database`] gives pages, those of the write-ahead log beside the file before those of the
//! file; [`Table`] walks a table's tree to its leaves, whose cells are rows in the order of their row ids; [`Row`] reads columns of a row, bytes on
//! overflow pages included. Indexes, tables without row ids and encryption are not read.
//!
//! Nothing is believed unchecked: page numbers, lengths and depths are held against the file, and no page is visited twice.

mod database;
mod row;
mod table;
#[cfg(test)]
mod tests;
mod write_ahead;

pub(crate) use database::Database;
pub(crate) use row::{Row, Value};
pub(crate) use table::Table;

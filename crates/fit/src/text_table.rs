//! Tables of words, for a terminal as for a page.

/// A table of words: its numbers are written already.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct TextTable {
    /// Content of the table, in a sentence; empty if the header says it.
    pub caption: String,
    /// Heads of the columns.
    pub header: Vec<&'static str>,
    /// Cells, as many a row as there are heads.
    pub rows: Vec<Vec<String>>,
}

//! Errors of reading rows.

use crate::Cancelled;

/// Why rows could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file or stream behind the source failed; the inner error names the file, the place and the mend.
    #[error(transparent)]
    Read(Box<dyn std::error::Error + Send + Sync>),
    /// A range of rows that the episode does not have.
    #[error("rows {start}..{end} of episode {episode}, which has {rows} rows")]
    OutOfRange {
        /// The episode's name.
        episode: String,
        /// First requested row.
        start: usize,
        /// End of the range.
        end: usize,
        /// Rows there are.
        rows: usize,
    },
    /// The user stopped the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

//! Cost of opening a recording.

/// Estimated cost of opening robots' logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Estimate {
    /// Bytes of the files.
    pub bytes: u64,
    /// Rows at most, from the counts in the files.
    pub rows: u64,
    /// Bytes of the decoded columns; the cache holds them compressed.
    pub decoded_bytes: u64,
    /// The decoded columns are in the cache already.
    pub cached: bool,
}

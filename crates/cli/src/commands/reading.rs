//! What a pass over logs would read, for `--dry-run`.

use crate::table::{bytes, count};

/// Files, episodes and rows of a plan, its columns, and what must be decoded for them: bytes, and whether the cache has them.
pub(super) struct Reading<'a> {
    pub(super) files: usize,
    /// Of the statistic that grows, files that it has.
    pub(super) skipped: usize,
    pub(super) episodes: Option<usize>,
    pub(super) rows: usize,
    pub(super) columns: &'a [String],
    pub(super) decoded: Option<(u64, bool)>,
}

impl Reading<'_> {
    pub(super) fn in_words(&self) -> String {
        let skipped = match self.skipped {
            0 => String::new(),
            number => format!(" ({number} more are there already)"),
        };
        let episodes =
            self.episodes.map_or("at most ".to_owned(), |episodes| format!("{}, ", count(episodes, "episode")));
        let decoded = match self.decoded {
            None => String::new(),
            Some((size, true)) => format!("\n{} of decoded columns, in the cache already", bytes(size)),
            Some((size, false)) => format!("\none pass to decode them: {} of columns, less in the cache", bytes(size)),
        };
        let (files, columns) = (count(self.files, "file"), self.columns);
        format!(
            "{files}{skipped}, {episodes}{} rows\n{} columns read: {}{decoded}",
            self.rows,
            columns.len(),
            columns.join(", ")
        )
    }
}

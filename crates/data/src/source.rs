//! Sources: where episodes are read from.

use std::ops::Range;

use crate::{Block, Column, Episode, Error, Halo};

/// A set of episodes with the same columns, read lazily and from many threads at once.
pub trait Source: Send + Sync {
    /// The columns of every block, in this order.
    fn columns(&self) -> &[Column];

    /// The episodes.
    fn episodes(&self) -> &[Episode];

    /// Reads the rows `rows` of an episode (by index) with up to `halo` neighbours of the same episode.
    ///
    /// The same range always gives the same values, whatever was read before.
    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error>;

    /// The index of a column by name.
    fn column_index(&self, name: &str) -> Option<usize> {
        self.columns().iter().position(|column| column.name == name)
    }

    /// Rows of all episodes.
    fn rows(&self) -> usize {
        self.episodes().iter().map(|episode| episode.rows).sum()
    }
}

/// About `rows` rows of a source as at most `runs` short runs spread evenly over all episodes: `(episode, rows)`.
///
/// The choice depends on the episodes' identities and lengths, not on their order or on the files that hold them. When the
/// source has no more than `rows` rows, all are chosen.
pub fn sample_ranges(episodes: &[Episode], rows: usize, runs: usize) -> Vec<(usize, Range<usize>)> {
    let total: usize = episodes.iter().map(|episode| episode.rows).sum();
    let mut order: Vec<usize> = (0..episodes.len()).collect();
    order.sort_by_key(|&e| episodes[e].id);
    if total <= rows {
        return order.into_iter().filter(|&e| episodes[e].rows > 0).map(|e| (e, 0..episodes[e].rows)).collect();
    }
    // Cut the concatenation into `runs` equal strides and take the middle of each.
    let runs = runs.clamp(1, rows.max(1));
    let length = rows.div_ceil(runs);
    let mut ranges = Vec::with_capacity(runs);
    let (mut at, mut before) = (0, 0);
    for run in 0..runs {
        let begin = (run as u128 * total as u128 / runs as u128) as usize;
        let end = ((run as u128 + 1) * total as u128 / runs as u128) as usize;
        let mut middle = begin + (end - begin).saturating_sub(length) / 2;
        let stop = (middle + length).min(end);
        while middle < stop {
            while before + episodes[order[at]].rows <= middle {
                before += episodes[order[at]].rows;
                at += 1;
            }
            let episode = order[at];
            let part = middle - before..(stop - before).min(episodes[episode].rows);
            middle = before + part.end;
            ranges.push((episode, part));
        }
    }
    ranges
}

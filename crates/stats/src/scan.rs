//! The one scan: the columns of a method evaluated over the rows of a source, tile by tile, and summed chunk by chunk.
//!
//! A method says which groups of columns its rows have ([`Columns`]) and what a chunk sums of them: Gram matrices by region ([`RegionGrams`]), least and
//! greatest values ([`RegionRanges`]), or anything else that can be merged in the order of the chunks. Which rows count, what is refused and what a pilot
//! sample is are the same for all of them.

mod columns;
mod grams;
mod pilot;
mod ranges;

use fleetfoot_data::{Cancelled, EpisodeId, Error, Progress, Source};
use fleetfoot_library::DesignRows;

pub use columns::{Columns, RowError, Tile};
pub use grams::RegionGrams;
pub use pilot::pilot_tiles;
pub use ranges::{RegionRanges, extreme, extremes, widen};

use crate::{Chunk, reduce};

/// Number of rows that were used and that were left out, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RowCounts {
    /// Rows with all values.
    pub complete: u64,
    /// Rows that lack neighbours at the border of their episode.
    pub at_border: u64,
    /// Rows with a missing value.
    pub incomplete: u64,
}

impl RowCounts {
    /// Adds other rows.
    pub fn add(&mut self, other: Self) {
        self.complete += other.complete;
        self.at_border += other.at_border;
        self.incomplete += other.incomplete;
    }

    /// Of the rows of a tile.
    pub fn of(rows: &DesignRows) -> Self {
        Self { complete: rows.rows() as u64, at_border: rows.at_border, incomplete: rows.incomplete }
    }
}

/// Position of the rows of a tile.
#[derive(Debug, Clone, Copy)]
pub struct Place<'a> {
    /// Their chunk.
    pub chunk: &'a Chunk,
    /// Their episode.
    pub episode: EpisodeId,
    /// The row of the episode from which [`Tile::index`] counts.
    pub first: usize,
}

/// Sums, counts and rows of a chunk so far.
struct Part<S> {
    sums: S,
    counts: RowCounts,
    rows: DesignRows,
}

/// Reduces the complete rows of `chunks` to one value a chunk: [`reduce`] with columns in the place of blocks. `add` is called for tiles that have complete
/// rows, `merge` for every chunk, in their order.
///
/// # Errors
/// Those of reading, of values that cannot be summed, of `add` and of `merge`.
pub fn scan<S, E>(
    columns: &Columns,
    source: &dyn Source,
    chunks: &[Chunk],
    progress: &dyn Progress,
    start: impl Fn() -> S + Sync,
    add: impl Fn(&mut S, Place<'_>, &Tile<'_>) -> Result<(), E> + Sync,
    mut merge: impl FnMut(&Chunk, RowCounts, S) -> Result<(), E> + Send,
) -> Result<(), E>
where
    S: Send,
    E: Send + From<RowError> + From<Error> + From<Cancelled>,
{
    reduce(
        source,
        chunks,
        columns.halo(),
        progress,
        || Part { sums: start(), counts: RowCounts::default(), rows: DesignRows::default() },
        |part, chunk, block, range| {
            let episode = &source.episodes()[chunk.episode];
            let tile = columns.evaluate(block, episode, range, &mut part.rows)?;
            part.counts.add(tile.counts());
            let place = Place { chunk, episode: episode.id, first: block.first };
            if tile.is_empty() { Ok(()) } else { add(&mut part.sums, place, &tile) }
        },
        |chunk, part| merge(chunk, part.counts, part.sums),
    )
}

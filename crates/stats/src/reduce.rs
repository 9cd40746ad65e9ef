//! The one reduction over rows: chunks in parallel, blocks within a chunk in order, results merged in the order of the chunks.

use std::ops::Range;

use fleetfoot_data::{Block, Error, Halo, Progress, Source, parallel_fold};

use crate::Chunk;

/// Rows that are read at once.
const READ_ROWS: usize = 65_536;
/// Rows that are worked on at once: their regressors stay in second-level cache.
pub const TILE_ROWS: usize = 4_096;

/// Reduces the rows of `chunks` to one value a chunk, and hands these values on in the order of the chunks.
///
/// For each chunk `start` makes an empty value, `add` is called for the chunk's tiles in order (a block that was read and the range of
/// its core rows that is the tile), and `merge` receives the result. Tiles are anchored at the start of the chunk, so a result depends on the chunk's
/// rows alone. Only the chunks in flight are in memory.
pub fn reduce<S, E>(
    source: &dyn Source,
    chunks: &[Chunk],
    halo: Halo,
    progress: &dyn Progress,
    start: impl Fn() -> S + Sync,
    add: impl Fn(&mut S, &Chunk, &Block, Range<usize>) -> Result<(), E> + Sync,
    mut merge: impl FnMut(&Chunk, S) -> Result<(), E> + Send,
) -> Result<(), E>
where
    S: Send,
    E: Send + From<Error> + From<fleetfoot_data::Cancelled>,
{
    let mut done = chunks.iter();
    parallel_fold(
        chunks.len(),
        progress,
        |i| {
            let chunk = &chunks[i];
            let mut value = start();
            let mut from = chunk.rows.start;
            while from < chunk.rows.end {
                let to = (from + READ_ROWS).min(chunk.rows.end);
                let block = source.read(chunk.episode, from..to, halo)?;
                let mut tile = 0;
                while tile < block.rows {
                    let end = (tile + TILE_ROWS).min(block.rows);
                    add(&mut value, chunk, &block, tile..end)?;
                    tile = end;
                }
                from = to;
            }
            Ok(value)
        },
        |value| match done.next() {
            Some(chunk) => merge(chunk, value),
            None => Ok(()),
        },
    )
}

//! The pilot sample: rows that are looked at before a pass, to fix its coordinates.

use std::ops::Range;

use fleetfoot_data::{Block, Episode, Error, Halo, Source, sample_ranges};

use crate::TILE_ROWS;

/// Rows of the sample, and of one of its runs.
const ROWS: usize = 20_000;
const RUNS: usize = 64;

/// Hands on a strided sample of some 20,000 rows of a source, tile by tile in order: the episode, a block that was read, and the range of its core rows that is
/// the tile.
///
/// # Errors
/// Those of reading and of `take`.
pub fn pilot_tiles<E: From<Error>>(
    source: &dyn Source,
    halo: Halo,
    mut take: impl FnMut(&Episode, &Block, Range<usize>) -> Result<(), E>,
) -> Result<(), E> {
    for (episode, range) in sample_ranges(source.episodes(), ROWS, RUNS) {
        let block = source.read(episode, range, halo)?;
        for from in (0..block.rows).step_by(TILE_ROWS) {
            take(&source.episodes()[episode], &block, from..(from + TILE_ROWS).min(block.rows))?;
        }
    }
    Ok(())
}

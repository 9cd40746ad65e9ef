//! Rows in pieces that are read at once.

use fleetfoot_data::Source;

/// Rows read at once.
pub const ROWS: usize = 65_536;

/// All rows of a source in pieces that are read at once: episodes, and rows of them.
pub fn blocks(source: &dyn Source) -> Vec<(usize, std::ops::Range<usize>)> {
    blocks_of(source, ROWS)
}

/// All rows of a source in pieces of so many rows, less at the end of an episode.
pub fn blocks_of(source: &dyn Source, most: usize) -> Vec<(usize, std::ops::Range<usize>)> {
    let of = |(episode, rows): (usize, usize)| {
        (0..rows).step_by(most).map(move |from| (episode, from..(from + most).min(rows)))
    };
    source.episodes().iter().map(|episode| episode.rows).enumerate().flat_map(of).collect()
}

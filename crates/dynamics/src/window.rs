//! The recorded rows around starts, read once for all starts that lie near each other.

use std::ops::Range;

use fleetfoot_data::{Block, Halo, Source};

use crate::{Error, Start};

/// Rows that may be read for nothing to save a separate read.
const SPARE_ROWS: usize = 4_096;

/// The recording around one start.
pub(crate) struct Window<'a> {
    pub(crate) block: &'a Block,
    /// Index of the start's row in the block.
    pub(crate) at: usize,
    pub(crate) start: Start,
    map: &'a [usize],
}

impl<'a> Window<'a> {
    /// The recording around a start in a block of its episode; `map` gives the source's index of each column of the model.
    pub(crate) fn new(block: &'a Block, start: Start, map: &'a [usize]) -> Self {
        Self { block, at: start.row + block.before - block.first, start, map }
    }

    /// A column of the model from `from` to `to`, in rows relative to the start.
    #[inline(always)]
    pub(crate) fn values(&self, column: usize, from: i64, to: i64) -> &[f64] {
        let at = self.at as i64;
        &self.block.column(self.map[column])[(at + from) as usize..(at + to) as usize]
    }
}

/// Blocks that cover starts, and which start lies in which.
pub(crate) struct Windows {
    blocks: Vec<Block>,
    of_start: Vec<usize>,
}

impl Windows {
    /// One window a start; `map` gives the source's index of each column of the model.
    pub(crate) fn windows<'a>(&'a self, starts: &[Start], map: &'a [usize]) -> Vec<Window<'a>> {
        starts.iter().zip(&self.of_start).map(|(&start, &block)| Window::new(&self.blocks[block], start, map)).collect()
    }
}

/// Reads the rows that `starts` need; neighbouring starts share a read.
pub(crate) fn read_windows(source: &dyn Source, starts: &[Start], needed: Halo) -> Result<Windows, Error> {
    let mut ranges: Vec<(usize, Range<usize>)> = Vec::new();
    let mut of_start = Vec::with_capacity(starts.len());
    for start in starts {
        let rows = start.row - needed.before..start.row + needed.after + 1;
        if let Some((episode, range)) = ranges.last_mut() {
            let union = range.start.min(rows.start)..range.end.max(rows.end);
            if *episode == start.episode && union.len() <= range.len() + rows.len() + SPARE_ROWS {
                *range = union;
                of_start.push(ranges.len() - 1);
                continue;
            }
        }
        ranges.push((start.episode, rows));
        of_start.push(ranges.len() - 1);
    }
    let blocks = ranges
        .into_iter()
        .map(|(episode, rows)| source.read(episode, rows, Halo::default()))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(Windows { blocks, of_start })
}

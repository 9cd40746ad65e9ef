//! Arrays as a source of episodes, read where they lie.

use std::{collections::BTreeMap, ops::Range};

use fleetfoot::{
    data::{Block, Column, Episode, EpisodeId, Error, Halo, Source},
    log::MemoryTable,
};

use crate::{array::Arrays, error::Kind};

/// Arrays of equal length whose rows are one episode after the other; row k of an episode has the stamp k.
///
/// Episodes are known by their place, not by their values: a random draw for a row depends on the seed and the row
/// alone.
pub(crate) struct ArraySource {
    arrays: Arrays,
    episodes: Vec<Episode>,
    /// First row of every episode.
    first: Vec<usize>,
}

impl ArraySource {
    /// Cuts the rows into episodes of these lengths.
    pub(crate) fn new(arrays: Arrays, lengths: &[usize]) -> pyo3::PyResult<Self> {
        let rows = arrays.rows();
        let total: usize = lengths.iter().sum();
        if total != rows {
            return Err(Kind::Data.error(format!("the groups have {total} rows and X has {rows}: label every row")));
        }
        let mut first = Vec::with_capacity(lengths.len());
        let mut next = 0;
        for length in lengths {
            first.push(next);
            next += length;
        }
        let episode = |(k, &rows): (usize, &usize)| Episode {
            id: EpisodeId(k as u128),
            name: format!("group {k}"),
            file: None,
            labels: BTreeMap::new(),
            rows,
            start: 0,
            end: rows.saturating_sub(1) as i64,
            period: 1e-9,
            marks: Vec::new(),
        };
        Ok(Self { episodes: lengths.iter().enumerate().map(episode).collect(), arrays, first })
    }
}

impl Source for ArraySource {
    fn columns(&self) -> &[Column] {
        self.arrays.columns()
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        self.episodes[episode].check(&rows)?;
        let length = self.episodes[episode].rows;
        let (before, after) = (halo.before.min(rows.start), halo.after.min(length - rows.end));
        let (from, to) = (rows.start - before, rows.end + after);
        let columns: Vec<usize> = (0..self.arrays.columns().len()).collect();
        let first = self.first[episode];
        Ok(Block {
            first: rows.start,
            before,
            rows: rows.len(),
            after,
            start: 0,
            time: (from as i64..to as i64).collect::<Vec<_>>().into(),
            columns: self.arrays.values(&columns, first + from..first + to),
        })
    }
}

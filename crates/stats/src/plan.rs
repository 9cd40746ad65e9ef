//! Plan of a scan: its chunks of rows, and the fold of each chunk.
//!
//! The chunk grid is anchored at the start of each episode. It depends only on the episodes' identities and lengths and
//! on the plan's numbers: not on files, their order, block sizes or threads.

use std::ops::Range;

use fleetfoot_data::setting::{DT, TIME, TIME_SECTION};
use fleetfoot_data::{Episode, OutOfMemory, ensure_memory};

use crate::{Fold, FoldLayout, Preconditioner};

/// The rows behind one stored statistic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chunk {
    /// Index of the episode in its source.
    pub episode: usize,
    /// Number of the chunk within the episode.
    pub index: u32,
    /// Its rows.
    pub rows: Range<usize>,
    /// Its place in cross-validation.
    pub fold: Fold,
}

/// Division of a scan into chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Rows of a chunk, at most.
    pub chunk_rows: usize,
}

/// Rows of a chunk where sums of some rows must be enough, and where folds are made of the chunks afterwards: of two recordings of 512 rows a tenth of a
/// tenth is five.
pub const COARSE: usize = 256;
/// See [`COARSE`].
pub const FINE: usize = 4;

/// Chunks that there are at least, where there are rows enough.
const LEAST_CHUNKS: usize = 8;
/// Bytes of statistics beyond which a plan is refused.
const MOST_BYTES: usize = 2 << 30;
/// Episodes of about one row beyond which a plan is refused.
const MOST_SINGLE: usize = 1_000;

/// Episodes that no plan can be made for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Every row is an episode.
    #[error(
        "{rows} rows in {episodes} episodes, hardly more than a row each: an episode ends where stamps do not rise, so the time column is no clock, or the rows are not in the order of time; sort the rows, name the clock ({TIME_SECTION} column, {TIME}), or give a sampling period ({TIME_SECTION} dt, {DT})"
    )]
    SingleRows {
        /// Rows.
        rows: usize,
        /// Episodes.
        episodes: usize,
    },
    /// A statistic of every episode takes more memory than there should be.
    #[error(
        "{episodes} episodes need a statistic of {bytes} bytes each, {} GiB in all, and {} GiB is the limit: offer fewer candidates or regions, or fewer and longer episodes",
        episodes.saturating_mul(*bytes) >> 30,
        MOST_BYTES >> 30
    )]
    Memory {
        /// Episodes.
        episodes: usize,
        /// Bytes of the statistics of one chunk.
        bytes: usize,
    },
    /// The statistics need more memory than there is.
    #[error(transparent)]
    Room(#[from] OutOfMemory),
}

impl PlanError {
    /// Returns true if a plan that needs less memory would be accepted.
    pub fn is_memory(&self) -> bool {
        matches!(self, Self::Memory { .. } | Self::Room(_))
    }
}

impl Grid {
    /// Chunk length such that about `keys_per_chunk` statistics of `bytes` bytes a chunk fit into `budget` bytes, and that there are
    /// still enough chunks (about 200) for folds, standard errors and all threads, of at least `finest` rows ([`COARSE`], [`FINE`]).
    pub fn for_budget(rows: usize, keys_per_chunk: usize, bytes: usize, budget: usize, finest: usize) -> usize {
        let chunks = (budget / (keys_per_chunk * bytes).max(1)).clamp(LEAST_CHUNKS, 1 << 20);
        let needed = rows.div_ceil(chunks);
        let wanted = (rows / 200).clamp(finest, 65_536);
        let length = needed.max(wanted);
        if length < COARSE { length } else { length.next_multiple_of(COARSE) }
    }

    /// Refuses episodes whose statistics, `keys_per_chunk` of `bytes` bytes at least for each, would not fit: every episode has a chunk of its own.
    ///
    /// # Errors
    /// Nearly every row is an episode; or the statistics take more than 2 GiB, or more than the system gives.
    pub fn check(episodes: &[Episode], keys_per_chunk: usize, bytes: usize) -> Result<(), PlanError> {
        let count = episodes.iter().filter(|episode| episode.rows > 0).count();
        let rows: usize = episodes.iter().map(|episode| episode.rows).sum();
        if count > MOST_SINGLE && rows < 2 * count {
            return Err(PlanError::SingleRows { rows, episodes: count });
        }
        let bytes = keys_per_chunk.saturating_mul(bytes);
        if count.saturating_mul(bytes) > MOST_BYTES {
            return Err(PlanError::Memory { episodes: count, bytes });
        }
        // As many chunks as there are at least, and two on their way into them.
        let chunks = count.max(LEAST_CHUNKS.min(rows.div_ceil(COARSE))) + 2;
        ensure_memory(
            chunks.saturating_mul(bytes),
            &format!("a statistic of {rows} rows in {chunks} parts"),
            "offer fewer candidates, a lower degree or fewer regions",
        )?;
        Ok(())
    }

    /// The chunks of these episodes, in the order of the episodes' identities, of no fold.
    pub fn chunks(&self, episodes: &[Episode]) -> Vec<Chunk> {
        self.cut(episodes, |episode| vec![(0..episode.rows, Fold::default())])
    }

    /// The same, cut so that all rows of a chunk have one place in the folds.
    pub fn chunks_in(&self, folds: &FoldLayout, episodes: &[Episode]) -> Vec<Chunk> {
        self.cut(episodes, |episode| folds.pieces(episode.id, episode.rows))
    }

    fn cut(&self, episodes: &[Episode], pieces: impl Fn(&Episode) -> Vec<(Range<usize>, Fold)>) -> Vec<Chunk> {
        let mut order: Vec<usize> = (0..episodes.len()).collect();
        order.sort_by_key(|&e| episodes[e].id);
        let mut chunks = Vec::new();
        for episode in order {
            let mut index = 0;
            for (piece, fold) in pieces(&episodes[episode]) {
                let mut from = piece.start;
                while from < piece.end {
                    let to = (from + self.chunk_rows.max(1)).min(piece.end);
                    chunks.push(Chunk { episode, index, rows: from..to, fold });
                    index += 1;
                    from = to;
                }
            }
        }
        chunks
    }
}

/// The hash of a plan: `description` has columns, library, targets, partitions and grid; the preconditioner is part of it.
pub fn plan_hash(description: &[u8], preconditioner: &Preconditioner) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(description);
    hasher.update(&preconditioner.to_bytes());
    hasher.finalize().to_hex()[..32].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FoldRule, Purge};
    use fleetfoot_data::{Column, MemorySource, Source};

    fn episodes(lengths: &[usize]) -> Vec<Episode> {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        for &length in lengths {
            source.push_uniform("e", 1.0, vec![(0..length).map(|i| (i + length) as f64).collect()]);
        }
        source.episodes().to_vec()
    }

    #[test]
    fn every_row_is_in_exactly_one_chunk() {
        for (lengths, folds, purge) in
            [(&[100, 7, 0, 53][..], 10, 2), (&[1000, 999], 10, 40), (&[5], 3, 1), (&[30; 12], 4, 5)]
        {
            let episodes = episodes(lengths);
            let rows = || episodes.iter().map(|episode| (episode.id, episode.rows));
            let grid = Grid { chunk_rows: 16 };
            let mut cuts = vec![grid.chunks(&episodes)];
            // Five rows are too few for three folds.
            if let Ok(layout) = FoldLayout::new(FoldRule::Count(folds), rows(), Purge::Exactly(purge)) {
                cuts.push(grid.chunks_in(&layout, &episodes));
            }
            assert_eq!(cuts.len(), 1 + usize::from(lengths != [5]));
            for (e, &length) in lengths.iter().enumerate() {
                for chunks in &cuts {
                    let mut mine: Vec<&Chunk> = chunks.iter().filter(|chunk| chunk.episode == e).collect();
                    mine.sort_by_key(|chunk| chunk.index);
                    let mut next = 0;
                    for chunk in mine {
                        assert_eq!(chunk.rows.start, next);
                        assert!(chunk.rows.len() <= 16 && !chunk.rows.is_empty());
                        next = chunk.rows.end;
                    }
                    assert_eq!(next, length);
                }
            }
        }
    }

    #[test]
    fn chunks_are_some_two_hundred_within_the_budget() {
        let rows = |rows: usize, finest: usize| Grid::for_budget(rows, 1, 1000, 1 << 30, finest);
        assert_eq!((rows(1024, FINE), rows(1024, COARSE), rows(10_000_000, FINE)), (5, 256, 50_176));
        // Ten statistics fit.
        assert_eq!(Grid::for_budget(1000, 10, 1 << 20, 100 << 20, FINE), 100);
    }

    #[test]
    fn a_row_an_episode_is_refused_with_the_reason() {
        let single = episodes(&vec![1; 1200]);
        let error = Grid::check(&single, 1, 100).unwrap_err();
        assert_eq!(error, PlanError::SingleRows { rows: 1200, episodes: 1200 });
        assert!(error.to_string().contains("stamps do not rise"));
        assert_eq!(Grid::check(&episodes(&vec![3; 1200]), 1, 100), Ok(()));
        let huge = Grid::check(&episodes(&[100; 300]), 2, 5 << 20).unwrap_err();
        assert_eq!(huge, PlanError::Memory { episodes: 300, bytes: 10 << 20 });
    }
}

//! The plan of a scan: which rows make which chunk, and which fold each chunk belongs to.
//!
//! The chunk grid is anchored at the start of each episode and depends on nothing but the episodes' identities and lengths and the plan's
//! numbers: not on files, their order, block sizes or threads.

use std::ops::Range;

use fleetfoot_data::Episode;

use crate::{Fold, Preconditioner};

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

/// How a scan is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Rows of a chunk, at most.
    pub chunk_rows: usize,
    /// Number of folds; 0 or 1 for none.
    pub folds: u16,
    /// Rows on either side of a held-out span that train nothing for it.
    pub purge: usize,
}

impl Grid {
    /// Chunk length such that about `keys_per_chunk` statistics of `bytes` bytes a chunk fit into `budget` bytes, and that there are
    /// still enough chunks (about 200) for standard errors and for all threads.
    pub fn for_budget(rows: usize, keys_per_chunk: usize, bytes: usize, budget: usize) -> usize {
        let chunks = (budget / (keys_per_chunk * bytes).max(1)).clamp(8, 1 << 20);
        let needed = rows.div_ceil(chunks);
        let wanted = (rows / 200).clamp(256, 65_536);
        needed.max(wanted).next_multiple_of(256)
    }

    /// The chunks of these episodes, in the order of the episodes' identities.
    ///
    /// Folds are whole episodes when there are at least as many episodes as folds (the longest first, each to the fold with the
    /// fewest rows). Otherwise every episode is cut into as many contiguous spans as there are folds, with the purge gap between
    /// neighbours, so that each fold sees every episode.
    pub fn chunks(&self, episodes: &[Episode]) -> Vec<Chunk> {
        let mut order: Vec<usize> = (0..episodes.len()).collect();
        order.sort_by_key(|&e| episodes[e].id);
        let whole = self.episode_folds(episodes);
        let mut chunks = Vec::new();
        for episode in order {
            let mut index = 0;
            let rows = episodes[episode].rows;
            let spans = match &whole {
                Some(folds) => vec![(0..rows, Fold { own: folds[episode], purged: [None; 2] })],
                None => self.spans(rows),
            };
            for (span, fold) in spans {
                let mut from = span.start;
                while from < span.end {
                    let to = (from + self.chunk_rows.max(1)).min(span.end);
                    chunks.push(Chunk { episode, index, rows: from..to, fold });
                    index += 1;
                    from = to;
                }
            }
        }
        chunks
    }

    /// The fold of each episode, where folds are whole episodes.
    fn episode_folds(&self, episodes: &[Episode]) -> Option<Vec<u16>> {
        if self.folds <= 1 {
            return Some(vec![0; episodes.len()]);
        }
        if episodes.len() < usize::from(self.folds) {
            return None;
        }
        let mut order: Vec<usize> = (0..episodes.len()).collect();
        order.sort_by_key(|&e| (std::cmp::Reverse(episodes[e].rows), episodes[e].id));
        let mut load = vec![0usize; usize::from(self.folds)];
        let mut folds = vec![0; episodes.len()];
        for episode in order {
            let lightest = (0..load.len()).min_by_key(|&fold| (load[fold], fold)).unwrap_or(0);
            load[lightest] += episodes[episode].rows;
            folds[episode] = lightest as u16;
        }
        Some(folds)
    }

    /// The spans of an episode that is cut into folds, purge zones apart.
    fn spans(&self, rows: usize) -> Vec<(Range<usize>, Fold)> {
        let folds = usize::from(self.folds);
        let border = |fold: usize| fold * rows / folds;
        let mut spans = Vec::new();
        for fold in 0..folds {
            let (start, end) = (border(fold), border(fold + 1));
            let near_previous = if fold > 0 { (start + self.purge).min(end) } else { start };
            let near_next = if fold + 1 < folds { end.saturating_sub(self.purge).max(start) } else { end };
            let mut cuts = [start, near_previous, near_next, end];
            cuts.sort_unstable();
            for pair in cuts.windows(2).filter(|pair| pair[0] < pair[1]) {
                let previous = (fold > 0 && pair[0] < start + self.purge).then(|| fold as u16 - 1);
                let next = (fold + 1 < folds && pair[1] > end.saturating_sub(self.purge)).then_some(fold as u16 + 1);
                spans.push((pair[0]..pair[1], Fold { own: fold as u16, purged: [previous, next] }));
            }
        }
        spans
    }
}

/// The hash of a plan: `text` says columns, library, targets, partitions and grid; the preconditioner is part of it.
pub fn plan_hash(text: &str, preconditioner: &Preconditioner) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(text.as_bytes());
    hasher.update(&preconditioner.to_bytes());
    hasher.finalize().to_hex()[..32].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
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
            let grid = Grid { chunk_rows: 16, folds, purge };
            let chunks = grid.chunks(&episodes);
            for (e, &length) in lengths.iter().enumerate() {
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

    #[test]
    fn training_rows_keep_their_distance_from_held_out_rows() {
        let episodes = episodes(&[1000]);
        let purge = 25;
        let chunks = Grid { chunk_rows: 64, folds: 10, purge }.chunks(&episodes);
        for fold in 0..10 {
            let held: Vec<usize> = chunks.iter().filter(|c| c.fold.own == fold).flat_map(|c| c.rows.clone()).collect();
            let trained: Vec<usize> =
                chunks.iter().filter(|c| c.fold.trains(fold)).flat_map(|c| c.rows.clone()).collect();
            assert_eq!(held.len(), 100);
            let gaps = if fold == 0 || fold == 9 { 1 } else { 2 };
            assert_eq!(trained.len(), 900 - gaps * purge);
            assert!(trained.iter().all(|t| held.iter().all(|h| t.abs_diff(*h) > purge)));
        }
    }

    #[test]
    fn whole_episodes_are_folds_when_there_are_enough() {
        let episodes = episodes(&[100, 200, 300, 101, 102, 50]);
        let chunks = Grid { chunk_rows: 1000, folds: 3, purge: 10 }.chunks(&episodes);
        assert_eq!(chunks.len(), 6);
        let mut load = [0; 3];
        for chunk in &chunks {
            load[usize::from(chunk.fold.own)] += chunk.rows.len();
        }
        assert!(load.iter().all(|&rows| (252..=303).contains(&rows)), "{load:?}");
    }
}

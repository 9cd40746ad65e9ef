//! The chunks into which folds cut the rows, beside chunks without folds. Sums over all rows then depend on no fold, to
//! the bit.

use std::{collections::BTreeMap, ops::Range};

use fleetfoot_stats::Chunk;

/// The chunks of the folds, in order.
pub(crate) struct Cuts<'a> {
    /// All of them.
    pub(crate) chunks: &'a [Chunk],
    /// The places of an episode's.
    episodes: BTreeMap<usize, Range<usize>>,
}

impl<'a> Cuts<'a> {
    pub(crate) fn new(chunks: &'a [Chunk]) -> Self {
        let mut episodes: BTreeMap<usize, Range<usize>> = BTreeMap::new();
        for (at, chunk) in chunks.iter().enumerate() {
            episodes.entry(chunk.episode).or_insert(at..at).end = at + 1;
        }
        Self { chunks, episodes }
    }

    /// The places of those that share rows with another chunk.
    pub(crate) fn of(&self, other: &Chunk) -> Range<usize> {
        let episode = self.episodes.get(&other.episode).cloned().unwrap_or(0..0);
        let chunks = &self.chunks[episode.clone()];
        let from = chunks.partition_point(|chunk| chunk.rows.end <= other.rows.start);
        let to = chunks.partition_point(|chunk| chunk.rows.start < other.rows.end);
        episode.start + from..episode.start + to
    }

    /// Places of the complete rows of a tile of that chunk, and these rows. `index`: each row's number in its block,
    /// which begins at row `first` of the episode.
    pub(crate) fn pieces(&self, other: &Chunk, first: usize, index: &[usize]) -> Vec<(usize, Range<usize>)> {
        let rows = |place: usize| {
            let Range { start, end } = self.chunks[place].rows;
            let [from, to] = [start, end].map(|end| index.partition_point(|row| first + row < end));
            (place, from..to)
        };
        self.of(other).map(rows).filter(|(_, rows)| !rows.is_empty()).collect()
    }
}

/// Some rows of columns.
pub(crate) fn rows_of<'t>(columns: &[&'t [f64]], rows: &Range<usize>) -> Vec<&'t [f64]> {
    columns.iter().map(|column| &column[rows.clone()]).collect()
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource, Source};
    use fleetfoot_stats::{FoldLayout, FoldRule, Grid, Purge};

    use super::*;

    #[test]
    fn pieces_partition_complete_rows() {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        for length in [203, 0, 91] {
            source.push_uniform("e", 1.0, vec![(0..length).map(|i| f64::from(i + length)).collect()]);
        }
        let episodes = source.episodes();
        let rows = episodes.iter().map(|episode| (episode.id, episode.rows));
        let folds = FoldLayout::new(FoldRule::Count(4), rows, Purge::TENTH).unwrap();
        let cut = Grid { chunk_rows: 16 }.chunks_in(&folds, episodes);
        let cuts = Cuts::new(&cut);
        let (mut counts, mut complete) = (vec![0; cut.len()], 0);
        for chunk in (Grid { chunk_rows: 25 }).chunks(episodes) {
            // Every third row lacks a value.
            let index: Vec<usize> = (0..chunk.rows.len()).filter(|row| row % 3 != 1).collect();
            complete += index.len();
            let pieces = cuts.pieces(&chunk, chunk.rows.start, &index);
            assert_eq!(pieces.iter().map(|(_, rows)| rows.len()).sum::<usize>(), index.len());
            for (place, rows) in pieces {
                assert!(index[rows.clone()].iter().all(|row| cut[place].rows.contains(&(chunk.rows.start + row))));
                assert_eq!(cut[place].episode, chunk.episode);
                counts[place] += rows.len();
            }
        }
        assert_eq!((counts.iter().sum::<usize>(), complete), (200, 200));
    }
}

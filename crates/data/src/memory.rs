//! A source whose rows are already in memory.

use std::{collections::BTreeMap, convert::Infallible, ops::Range};

use arrow_buffer::ScalarBuffer;

use crate::{Block, Column, Episode, Error, Fingerprint, Halo, Source};

/// Episodes held in memory; arrow buffers are shared, not copied.
#[derive(Debug, Clone, Default)]
pub struct MemorySource {
    columns: Vec<Column>,
    episodes: Vec<Episode>,
    data: Vec<(ScalarBuffer<i64>, Vec<ScalarBuffer<f64>>)>,
}

impl MemorySource {
    /// An empty source with these columns.
    pub fn new(columns: Vec<Column>) -> Self {
        Self { columns, episodes: Vec::new(), data: Vec::new() }
    }

    /// Adds an episode: its stamps in nanoseconds, strictly increasing, and one buffer per column.
    ///
    /// # Panics
    /// If the number of columns or their lengths differ.
    pub fn push(&mut self, name: impl Into<String>, time: ScalarBuffer<i64>, values: Vec<ScalarBuffer<f64>>) {
        assert_eq!(values.len(), self.columns.len(), "one buffer per column");
        assert!(values.iter().all(|column| column.len() == time.len()), "columns of one length");
        let rows = time.len();
        let mut steps: Vec<i64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_unstable();
        let mut fingerprint = Fingerprint::new();
        fingerprint.stamps(&time);
        let read = |rows| Ok::<_, Infallible>(cut(&time, &values, rows, Halo::default()));
        let Ok((id, marks)) = fingerprint.identify(&self.columns, rows, read);
        self.episodes.push(Episode {
            id,
            name: name.into(),
            file: None,
            labels: BTreeMap::new(),
            rows,
            start: time.first().copied().unwrap_or(0),
            end: time.last().copied().unwrap_or(0),
            period: steps.get(steps.len() / 2).map_or(0.0, |&step| step as f64 * 1e-9),
            marks,
        });
        self.data.push((time, values));
    }

    /// Adds an episode sampled every `dt` seconds from time zero.
    pub fn push_uniform(&mut self, name: impl Into<String>, dt: f64, values: Vec<Vec<f64>>) {
        let rows = values.first().map_or(0, Vec::len);
        let time = (0..rows).map(|row| (row as f64 * dt * 1e9).round() as i64).collect();
        self.push(name, time, values.into_iter().map(ScalarBuffer::from).collect());
    }
}

impl Source for MemorySource {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        let info = &self.episodes[episode];
        info.check(&rows)?;
        let (time, values) = &self.data[episode];
        Ok(cut(time, values, rows, halo))
    }
}

fn cut(time: &ScalarBuffer<i64>, values: &[ScalarBuffer<f64>], rows: Range<usize>, halo: Halo) -> Block {
    let before = halo.before.min(rows.start);
    let after = halo.after.min(time.len() - rows.end);
    let (from, length) = (rows.start - before, before + rows.len() + after);
    Block {
        first: rows.start,
        before,
        rows: rows.len(),
        after,
        start: time.first().copied().unwrap_or(0),
        time: time.slice(from, length),
        columns: values.iter().map(|column| column.slice(from, length)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample_ranges;

    fn source() -> MemorySource {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        source.push_uniform("a", 0.5, vec![(0..10).map(f64::from).collect()]);
        source.push_uniform("b", 0.5, vec![(100..103).map(f64::from).collect()]);
        source
    }

    #[test]
    fn a_halo_stops_at_the_border_of_the_episode() {
        let source = source();
        let block = source.read(0, 1..4, Halo { before: 3, after: 2 }).unwrap();
        assert_eq!((block.before, block.rows, block.after), (1, 3, 2));
        assert_eq!(block.column(0), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(block.core(0), [1.0, 2.0, 3.0]);
        assert_eq!(block.seconds(), [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]);
        let block = source.read(1, 0..3, Halo { before: 5, after: 5 }).unwrap();
        assert_eq!((block.before, block.after), (0, 0));
        assert!(source.read(1, 2..4, Halo::default()).is_err());
        let episode = &source.episodes()[1];
        assert!(episode.check(&(0..3)).is_ok() && episode.check(&(3..3)).is_ok());
        let backwards = Range { start: 2, end: 1 };
        let message = episode.check(&backwards).unwrap_err().to_string();
        assert_eq!(message, format!("rows 2..1 of episode {}, which has 3 rows", episode.name));
    }

    #[test]
    fn identity_follows_the_data() {
        let (a, b) = (source(), source());
        assert_eq!(a.episodes()[0].id, b.episodes()[0].id);
        assert_ne!(a.episodes()[0].id, a.episodes()[1].id);
        let mut c = MemorySource::new(vec![Column::float("x")]);
        c.push_uniform("other", 0.5, vec![(0..10).map(|i| f64::from(i) + f64::from(i == 5)).collect()]);
        assert_ne!(a.episodes()[0].id, c.episodes()[0].id);
        let text = a.episodes()[0].id.to_string();
        assert_eq!(text.parse::<crate::EpisodeId>().unwrap(), a.episodes()[0].id);
    }

    #[test]
    fn samples_are_spread_and_disjoint() {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        for length in [1000, 3, 500, 0, 2000] {
            source.push_uniform("e", 1.0, vec![(0..length).map(|i| f64::from(i + length)).collect()]);
        }
        let ranges = sample_ranges(source.episodes(), 100, 20);
        let total: usize = ranges.iter().map(|(_, rows)| rows.len()).sum();
        assert!((90..=110).contains(&total), "{total}");
        let mut seen = std::collections::HashSet::new();
        for (episode, rows) in ranges {
            assert!(rows.end <= source.episodes()[episode].rows);
            assert!(rows.into_iter().all(|row| seen.insert((episode, row))));
        }
        let all = sample_ranges(source.episodes(), 10_000, 20);
        assert_eq!(all.iter().map(|(_, rows)| rows.len()).sum::<usize>(), 3503);
    }
}

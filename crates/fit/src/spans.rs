//! Parts of episodes, and every n-th row of them, as separate episodes: training, held-out and test rows.

use std::ops::Range;

use fleetfoot_data::{Block, Column, Episode, EpisodeId, Error, Halo, ScalarBuffer, Source, mix};
use fleetfoot_sparse::select::SelectError;
use fleetfoot_stats::{FoldLayout, FoldRule, Purge};

/// A source whose episodes are spans of another source's, every n-th row of them.
///
/// No row beyond a span is seen, so that lags do not reach from test rows into training rows.
pub struct Spans<'a> {
    inner: &'a dyn Source,
    /// Episode and rows of the other source behind every episode of this one.
    spans: Vec<(usize, Range<usize>)>,
    episodes: Vec<Episode>,
    every: usize,
}

impl<'a> Spans<'a> {
    /// These spans of rows; empty ones are left out. `every` is at least 1. The first row of a span is kept, then every n-th.
    pub(crate) fn new(inner: &'a dyn Source, spans: Vec<(usize, Range<usize>)>, every: usize) -> Result<Self, Error> {
        let every = every.max(1);
        let spans: Vec<(usize, Range<usize>)> = spans.into_iter().filter(|(_, rows)| !rows.is_empty()).collect();
        let mut episodes = Vec::with_capacity(spans.len());
        for (episode, rows) in &spans {
            let whole = &inner.episodes()[*episode];
            if *rows == (0..whole.rows) && every == 1 {
                episodes.push(whole.clone());
                continue;
            }
            let last = rows.start + (rows.len() - 1) / every * every;
            let stamp = |row: usize| inner.read(*episode, row..row + 1, Halo::default()).map(|block| block.stamps()[0]);
            let part = if *rows == (0..whole.rows) { String::new() } else { format!("[{}..{}]", rows.start, rows.end) };
            episodes.push(Episode {
                id: part_id(whole.id, rows, every),
                name: format!("{}{part}", whole.name),
                rows: rows.len().div_ceil(every),
                start: stamp(rows.start)?,
                end: stamp(last)?,
                period: whole.period * every as f64,
                marks: (whole.marks.iter())
                    .filter(|mark| rows.start <= mark.row && mark.rows().end <= rows.end)
                    .cloned()
                    .collect(),
                ..whole.clone()
            });
        }
        Ok(Self { inner, spans, episodes, every })
    }

    /// Every episode cut into its first rows and the `tested` last ones, without the first `apart` of these.
    pub(crate) fn split(
        inner: &'a dyn Source,
        tested: impl Fn(usize) -> usize,
        every: usize,
        apart: usize,
    ) -> Result<(Self, Self), Error> {
        let rows = |episode: usize| inner.episodes()[episode].rows;
        let cut = |episode: usize| rows(episode).saturating_sub(tested(rows(episode)));
        let count = inner.episodes().len();
        let train = (0..count).map(|e| (e, 0..cut(e))).collect();
        let test = (0..count).map(|e| (e, behind(cut(e)..rows(e), apart))).collect();
        Ok((Self::new(inner, train, every)?, Self::new(inner, test, every)?))
    }

    /// All rows but the last one in `share`, and these, without the first `apart` of them where an episode is cut.
    pub(crate) fn last(inner: &'a dyn Source, share: usize, apart: usize) -> Result<(Self, Self), Error> {
        let mut left = inner.rows() - inner.rows() / share;
        let mut cut = Vec::with_capacity(inner.episodes().len());
        for episode in inner.episodes() {
            let trains = left.min(episode.rows);
            left -= trains;
            cut.push((trains, episode.rows));
        }
        let train = cut.iter().enumerate().map(|(e, &(trains, _))| (e, 0..trains)).collect();
        let test = cut.iter().enumerate().map(|(e, &(trains, rows))| (e, behind(trains..rows, apart))).collect();
        Ok((Self::new(inner, train, 1)?, Self::new(inner, test, 1)?))
    }

    /// The episodes, or their spans, that are held out together, and the fold (0 to count - 1) of each, by the one rule ([`FoldLayout`]). Lags do not
    /// reach over the borders of spans: the first rows of each are no regressors' targets, a purge gap of as many rows. Spans are `apart` more rows apart:
    /// those over which the episodes were smoothed.
    pub(crate) fn folds(inner: &'a dyn Source, count: usize, apart: usize) -> Result<(Self, Vec<usize>), crate::Error> {
        let episodes = inner.episodes();
        let rows = episodes.iter().map(|episode| (episode.id, episode.rows));
        let layout = FoldLayout::new(FoldRule::Count(count), rows, Purge::Exactly(0)).map_err(SelectError::from)?;
        let of = |(e, episode): (usize, &Episode)| {
            let cut = layout.spans(episode.id, episode.rows).into_iter();
            cut.map(move |(rows, fold)| ((e, behind(rows, apart)), usize::from(fold))).collect::<Vec<_>>()
        };
        let (spans, folds) = episodes.iter().enumerate().flat_map(of).unzip();
        Ok((Self::new(inner, spans, 1)?, folds))
    }
}

/// Rows without the first `apart`, if others of the episode stand before them.
fn behind(rows: Range<usize>, apart: usize) -> Range<usize> {
    let first = if rows.start > 0 { rows.start.saturating_add(apart).min(rows.end) } else { 0 };
    first..rows.end
}

/// The same part of the same episode is the same again.
fn part_id(whole: EpisodeId, rows: &Range<usize>, every: usize) -> EpisodeId {
    let key =
        [rows.start as u64, rows.end as u64, every as u64].into_iter().fold(0, |key, value| mix(mix(key) ^ value));
    EpisodeId(whole.0 ^ (u128::from(key) << 64 | u128::from(mix(key))))
}

impl Source for Spans<'_> {
    fn columns(&self) -> &[Column] {
        self.inner.columns()
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        let (inner, span) = &self.spans[episode];
        let info = &self.episodes[episode];
        info.check(&rows)?;
        let before = halo.before.min(rows.start);
        let after = halo.after.min(info.rows - rows.end);
        let (from, to) = (rows.start - before, rows.end + after);
        // The last row that is wanted ends the read, not the row before the next wanted one.
        let end = if to > from { span.start + (to - 1) * self.every + 1 } else { span.start + from * self.every };
        let block = self.inner.read(*inner, span.start + from * self.every..end, Halo::default())?;
        let (time, columns) = if self.every == 1 {
            (block.time, block.columns)
        } else {
            let thin = |values: &ScalarBuffer<f64>| values.iter().step_by(self.every).copied().collect();
            (block.time.iter().step_by(self.every).copied().collect(), block.columns.iter().map(thin).collect())
        };
        Ok(Block { first: rows.start, before, rows: rows.len(), after, start: info.start, time, columns })
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::MemorySource;

    use super::*;

    fn source() -> MemorySource {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        source.push_uniform("a", 0.5, vec![(0..101).map(f64::from).collect()]);
        source.push_uniform("b", 0.5, vec![(0..7).map(|i| 1000.0 + f64::from(i)).collect()]);
        source
    }

    #[test]
    fn halos_end_at_the_span() {
        let inner = source();
        let spans = Spans::new(&inner, vec![(0, 20..75), (1, 3..3), (1, 0..7)], 10).unwrap();
        let rows: Vec<usize> = spans.episodes().iter().map(|episode| episode.rows).collect();
        assert_eq!(rows, [6, 1]);
        assert_eq!((spans.episodes()[0].start, spans.episodes()[0].end), (10_000_000_000, 35_000_000_000));
        assert_eq!(spans.episodes()[0].period, 5.0);
        let block = spans.read(0, 1..3, Halo { before: 5, after: 9 }).unwrap();
        assert_eq!((block.first, block.before, block.rows, block.after), (1, 1, 2, 3));
        assert_eq!(block.columns[0].to_vec(), [20.0, 30.0, 40.0, 50.0, 60.0, 70.0]);
        let seconds: Vec<i64> = block.time.iter().map(|stamp| (stamp - block.start) / 1_000_000_000).collect();
        assert_eq!(seconds, [0, 5, 10, 15, 20, 25]);
        assert_eq!(spans.read(1, 0..1, Halo::default()).unwrap().columns[0].to_vec(), [1000.0]);
        assert!(spans.read(0, 3..7, Halo::default()).is_err());
        assert!(spans.read(0, 2..2, Halo::default()).unwrap().columns[0].is_empty());
    }

    #[test]
    fn parts_of_episodes_have_separate_identities() {
        let inner = source();
        let whole = Spans::new(&inner, vec![(0, 0..101), (1, 0..7)], 1).unwrap();
        assert_eq!(whole.episodes(), inner.episodes());
        let (train, test) = Spans::split(&inner, |rows| rows / 5, 1, 0).unwrap();
        assert_eq!(train.episodes().iter().map(|e| e.rows).collect::<Vec<_>>(), [81, 6]);
        assert_eq!(test.episodes().iter().map(|e| e.rows).collect::<Vec<_>>(), [20, 1]);
        assert!(train.episodes()[0].id != test.episodes()[0].id && train.episodes()[0].id != inner.episodes()[0].id);
        assert_eq!(test.read(0, 0..1, Halo { before: 9, after: 0 }).unwrap().columns[0].to_vec(), [81.0]);
        assert_eq!(test.episodes()[0].name, "a[81..101]");
    }

    #[test]
    fn last_rows_match_last_episodes() {
        let inner = source();
        // 108 rows, of which a fifth is 21: all seven of the second episode, and 14 of the first.
        let (train, test) = Spans::last(&inner, 5, 3).unwrap();
        assert_eq!(train.episodes().iter().map(|e| e.rows).collect::<Vec<_>>(), [87]);
        assert_eq!(
            test.episodes().iter().map(|e| (e.name.as_str(), e.rows)).collect::<Vec<_>>(),
            [("a[90..101]", 11), ("b", 7)]
        );
    }

    #[test]
    fn folds_are_episodes_or_spans() {
        let inner = source();
        // Two episodes are few: six spans of each for two folds.
        let (spans, folds) = Spans::folds(&inner, 2, 0).unwrap();
        assert_eq!(folds, [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]);
        assert_eq!((spans.rows(), spans.episodes().len()), (108, 12));
        // Smoothing over five rows: no two spans are nearer, and what begins an episode stays.
        let (apart, spans_alone) = Spans::folds(&inner, 2, 5).unwrap();
        assert_eq!((spans_alone, apart.rows()), (folds, 108 - 5 * 5 - 6));
        assert_eq!(apart.episodes()[1].name, "a[21..33]");
        let mut many = MemorySource::new(vec![Column::float("x")]);
        (0..6).for_each(|e| many.push_uniform(format!("e{e}"), 0.5, vec![vec![f64::from(e); 20]]));
        let (spans, folds) = Spans::folds(&many, 3, 5).unwrap();
        assert_eq!(spans.episodes(), many.episodes());
        assert!((0..3).all(|fold| folds.iter().filter(|&&number| number == fold).count() == 2));
        assert!(Spans::folds(&inner, 200, 0).is_err());
    }
}

//! The samples of one channel, in the order of their stamps.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use crate::{
    Error,
    breaks::Breaks,
    join::{
        reorder::Reorder,
        rows::{Rows, Run, Samples},
    },
    store::{Budget, ColumnStore, StoreBuilder},
};

/// Samples of one channel, sorted by stamp within each run.
#[derive(Debug)]
pub(crate) struct Series {
    /// For messages: the channel.
    pub name: String,
    /// For messages: the file.
    pub source: PathBuf,
    /// Stamps and values.
    pub store: ColumnStore,
    /// Runs in which the stamps rise strictly; together they are all rows.
    pub runs: Vec<Run>,
    /// Typical step between neighbours of a run ([`Steps::period`](crate::steps::Steps::period)), nanoseconds; `None` when no run has two rows.
    pub median_step: Option<u64>,
    /// Counts of samples that were used and left out.
    pub counts: Counts,
    /// Median of log time less stamp, nanoseconds, over at most a few thousand rows spread evenly; `None` without rows.
    pub offset: Option<i64>,
    /// Breaks at which samples are known to be lost.
    pub breaks: Breaks,
}

/// Samples that came, and those that were left out, each for one reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Counts {
    /// All that came.
    pub samples: usize,
    /// With the stamp of a sample before; the first is kept.
    pub repeated: usize,
    /// Without a stamp, or with one more than 146 years from 1970.
    pub missing: usize,
    /// With a stamp of zero: a header that nobody filled. When these are all samples, the channel needs another clock.
    pub zero_stamps: usize,
    /// Alone or in pairs before or after their time, by more than the window.
    pub stray: usize,
}

impl Counts {
    /// Notes on samples that were left out, in sentences; `messages`: the name of the samples.
    pub(crate) fn left_out(&self, messages: &str) -> impl Iterator<Item = String> {
        let counts = [
            (self.zero_stamps, "with a stamp of zero"),
            (self.missing, "without a usable stamp"),
            (self.repeated, "with the stamp of another"),
            (self.stray, "far out of order"),
        ];
        let counted = counts.into_iter().filter(|(count, _)| *count > 0);
        counted.map(move |(count, what)| format!("{count} {messages} {what} left out"))
    }
}

/// Fills a [`Series`] in recorded order. The answer depends on the order of the samples alone.
///
/// A sample that comes at most the window behind the newest of its run is put in its place. One or two samples further
/// behind are strays if the time then goes on as before. One or two that leap ahead are strays if the time then comes
/// back. If the time stays back (three samples, or up to the end), a new run begins.
pub(crate) struct SeriesBuilder {
    name: String,
    source: PathBuf,
    counts: Counts,
    /// True if zero is a valid stamp.
    from_zero: bool,
    reorder: Reorder,
    rows: Rows,
}

impl SeriesBuilder {
    /// A series of `columns` columns of the channel `name` in the file `source`, with a reordering window in nanoseconds.
    pub(crate) fn new(source: &Path, name: &str, columns: usize, window_ns: i64, budget: Arc<Budget>) -> Self {
        Self {
            name: name.to_owned(),
            source: source.into(),
            counts: Counts::default(),
            from_zero: false,
            reorder: Reorder::new(columns, window_ns),
            rows: Rows::new(StoreBuilder::new(source, columns, budget)),
        }
    }

    /// The rows of a table: they may begin at zero, and a stamp that goes back is never put in order.
    pub(crate) fn of_table(source: &Path, columns: usize, budget: Arc<Budget>) -> Self {
        Self { from_zero: true, ..Self::new(source, "its rows", columns, 0, budget) }
    }

    /// Adds a sample, with one value a column.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(crate) fn push(&mut self, stamp: i64, log_time: i64, row: &[f64]) -> Result<(), Error> {
        self.counts.samples += 1;
        if !usable(stamp) {
            self.counts.missing += 1;
            return Ok(());
        }
        if stamp == 0 && !self.from_zero {
            self.counts.zero_stamps += 1;
            return Ok(());
        }
        self.reorder.push(stamp, log_time, row, &mut self.rows)
    }

    /// Adds samples, their values sample by sample: as [`Self::push`] for each, but quicker when the stamps rise.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(crate) fn extend(&mut self, samples: &Samples<'_>) -> Result<(), Error> {
        let in_order = samples.stamps.windows(2).all(|pair| pair[0] < pair[1])
            && samples.stamps.iter().all(|&stamp| usable(stamp) && (stamp != 0 || self.from_zero));
        if in_order && self.reorder.extend(samples, &mut self.rows)? {
            self.counts.samples += samples.stamps.len();
            return Ok(());
        }
        let row = |at: usize| &samples.values[at * samples.width..(at + 1) * samples.width];
        let stamps = samples.stamps.iter().zip(samples.log_times).enumerate();
        stamps.into_iter().try_for_each(|(at, (&stamp, &log_time))| self.push(stamp, log_time, row(at)))
    }

    /// The filled series.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(crate) fn finish(mut self) -> Result<Series, Error> {
        self.reorder.finish(&mut self.rows)?;
        let Rows { store, runs, mut steps, offsets, .. } = self.rows;
        let counts = Counts { repeated: self.reorder.repeated, stray: self.reorder.stray, ..self.counts };
        Ok(Series {
            name: self.name,
            source: self.source,
            store: store.finish()?,
            runs,
            median_step: steps.period(),
            counts,
            offset: offsets.median(),
            breaks: Breaks::default(),
        })
    }
}

/// Differences of such stamps fit a `u64`, and 1970 +- 146 years is enough for a robot.
fn usable(stamp: i64) -> bool {
    stamp.unsigned_abs() <= 1 << 62
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WINDOW: i64 = 50;

    /// Each sample is a stamp; its value and its log time follow from its place.
    fn series(stamps: &[i64]) -> Series {
        pushed(&stamps.iter().zip(0i64..).map(|(&stamp, place)| (stamp, place)).collect::<Vec<_>>(), WINDOW)
    }

    fn pushed(samples: &[(i64, i64)], window: i64) -> Series {
        let mut builder = SeriesBuilder::new(Path::new("x.mcap"), "/a", 1, window, Arc::new(Budget::new(0)));
        for &(stamp, log_time) in samples {
            builder.push(stamp, log_time, &[log_time as f64]).unwrap();
        }
        builder.finish().unwrap()
    }

    /// The stamps run by run.
    fn stamps(series: &Series) -> Vec<Vec<i64>> {
        series.runs.iter().map(|run| series.store.stamps(run.rows.clone()).unwrap().to_vec()).collect()
    }

    fn values(series: &Series) -> Vec<f64> {
        series.store.values(0..series.store.rows()).unwrap().columns[0].to_vec()
    }

    #[test]
    fn late_samples_within_window_are_sorted() {
        let sorted = series(&[100, 150, 120, 110, 160, 210, 200, 300]);
        assert_eq!(stamps(&sorted), [[100, 110, 120, 150, 160, 200, 210, 300]]);
        assert_eq!(values(&sorted), [0.0, 3.0, 2.0, 1.0, 4.0, 6.0, 5.0, 7.0]);
        assert_eq!(sorted.counts, Counts { samples: 8, ..Counts::default() });
        assert_eq!(sorted.median_step, Some(28), "uneven: the mean");
        assert_eq!(series(&[100, 200, 150]).runs.len(), 1);
    }

    #[test]
    fn samples_without_stamp_are_counted() {
        let filled = series(&[10, 0, 20, 20, i64::MIN, 15, 10, i64::MAX, 0, 30]);
        assert_eq!(stamps(&filled), [[10, 15, 20, 30]]);
        assert_eq!(values(&filled), [0.0, 5.0, 2.0, 9.0]);
        let expected = Counts { samples: 10, repeated: 2, missing: 2, zero_stamps: 2, stray: 0 };
        assert_eq!(filled.counts, expected);
        let never = series(&[0, 0, 0]);
        assert_eq!((never.counts.zero_stamps, never.counts.samples, never.runs.len()), (3, 3, 0));
        assert_eq!((never.median_step, never.offset), (None, None));
    }

    #[test]
    fn misplaced_samples_are_strays() {
        let behind = series(&[1000, 1100, 1200, 300, 1300, 1400, 310, 320, 1500]);
        assert_eq!(stamps(&behind), [[1000, 1100, 1200, 1300, 1400, 1500]]);
        assert_eq!(behind.counts.stray, 3);
        let ahead = series(&[1000, 1100, 1200, 1 << 60, 1300, 1400, 1500, 9000, 8000, 1600, 1700, 1800]);
        assert_eq!(stamps(&ahead), [[1000, 1100, 1200, 1300, 1400, 1500, 1600, 1700, 1800]]);
        assert_eq!(ahead.counts.stray, 3);
    }

    #[test]
    fn lasting_backward_jump_begins_a_run() {
        let twice = series(&[100, 200, 300, 400, 100, 200, 300, 400, 500]);
        assert_eq!(stamps(&twice), [vec![100, 200, 300, 400], vec![100, 200, 300, 400, 500]]);
        let expected = Run { rows: 4..9, start: 100, end: 500, log_start: 4, log_end: 8 };
        assert_eq!((&twice.runs[1], twice.counts.stray, twice.median_step), (&expected, 0, Some(100)));
        // Nothing says that the time went on.
        assert_eq!(stamps(&series(&[100, 200, 300, 400, 100, 200])), [vec![100, 200, 300, 400], vec![100, 200]]);
        assert_eq!(stamps(&series(&[500, 300, 100])), [[500], [300], [100]]);
        assert_eq!(stamps(&series(&[500, 400, 300, 200, 100])), [[500], [400], [300], [200], [100]]);
    }

    #[test]
    fn a_dense_series_waits_in_bounded_memory() {
        let count = 100_000;
        let samples: Vec<(i64, i64)> = (2..count + 2).map(|i| (i ^ 1, i)).collect();
        let dense = pushed(&samples, i64::MAX);
        assert_eq!(dense.runs.len(), 1);
        assert_eq!(dense.store.rows() as i64, count);
        assert!(stamps(&dense)[0].is_sorted());
    }

    #[test]
    fn the_offset_is_the_median_over_the_whole_series() {
        // 200,000 rows: 40 % are 5 late, the rest 7.
        let samples: Vec<(i64, i64)> =
            (1..=200_000).map(|i| (10 * i, 10 * i + if i <= 80_000 { 5 } else { 7 })).collect();
        assert_eq!(pushed(&samples, 0).offset, Some(7));
        let samples: Vec<(i64, i64)> =
            samples.iter().map(|&(s, log)| (s, if s <= 1_200_000 { s - 9 } else { log })).collect();
        assert_eq!(pushed(&samples, 0).offset, Some(-9));
    }

    proptest! {
        #[test]
        fn any_order_within_the_window_gives_the_same_series(
            steps in prop::collection::vec((1..120i64, 0..=WINDOW), 1..200),
        ) {
            let mut stamp = 1000;
            let mut samples: Vec<(i64, i64, i64)> = Vec::new();
            for (step, delay) in steps {
                stamp += step;
                samples.push((stamp + delay, stamp, 3 * stamp));
            }
            let in_order: Vec<(i64, i64)> = samples.iter().map(|&(_, stamp, log_time)| (stamp, log_time)).collect();
            samples.sort_by_key(|&(arrival, ..)| arrival);
            let mixed: Vec<(i64, i64)> = samples.iter().map(|&(_, stamp, log_time)| (stamp, log_time)).collect();
            let (a, b) = (pushed(&in_order, WINDOW), pushed(&mixed, WINDOW));
            prop_assert_eq!(stamps(&a), vec![in_order.iter().map(|sample| sample.0).collect::<Vec<_>>()]);
            prop_assert_eq!(stamps(&a), stamps(&b));
            prop_assert_eq!(values(&a), values(&b));
            prop_assert_eq!((&a.runs, a.median_step, a.counts, a.offset), (&b.runs, b.median_step, b.counts, b.offset));
        }

        #[test]
        fn batched_samples_equal_single_samples(
            steps in prop::collection::vec(
                prop_oneof![30 => 1..40i64, 1 => -60..1i64, 1 => -2000..0i64, 1 => 1000..100_000i64], 0..400),
            pieces in prop::collection::vec(1..60usize, 1..20),
            window in prop_oneof![Just(0), Just(WINDOW), Just(i64::MAX)],
        ) {
            let mut stamp = 1000;
            let mut samples = Vec::new();
            for (step, place) in steps.into_iter().zip(0i64..) {
                stamp += step;
                samples.push((stamp, stamp + place % 7));
            }
            let mut builder = SeriesBuilder::new(Path::new("run.mcap"), "/odom", 2, window, Arc::new(Budget::new(usize::MAX)));
            let mut at = 0;
            for piece in pieces.into_iter().chain([samples.len()]) {
                let part = &samples[at..samples.len().min(at + piece)];
                let values: Vec<f64> = part.iter().flat_map(|&(_, log)| [log as f64, -(log as f64)]).collect();
                let (stamps, log_times): (Vec<i64>, Vec<i64>) = part.iter().copied().unzip();
                builder.extend(&Samples { stamps: &stamps, log_times: &log_times, values: &values, width: 2 }).unwrap();
                at += part.len();
            }
            let (a, b) = (builder.finish().unwrap(), pushed(&samples, window));
            prop_assert_eq!(stamps(&a), stamps(&b));
            prop_assert_eq!(values(&a), values(&b));
            prop_assert_eq!((&a.runs, a.median_step, a.counts, a.offset), (&b.runs, b.median_step, b.counts, b.offset));
        }

        #[test]
        fn no_sample_is_lost(
            stamps in prop::collection::vec(prop_oneof![8 => -500..500i64, 1 => any::<i64>(), 1 => Just(i64::MIN)], 0..300),
            window in prop_oneof![0..100i64, any::<i64>()],
        ) {
            let samples: Vec<(i64, i64)> = stamps.iter().zip(0i64..).map(|(&stamp, place)| (stamp, place)).collect();
            let series = pushed(&samples, window);
            let Counts { samples: all, repeated, missing, zero_stamps, stray } = series.counts;
            prop_assert_eq!(all, stamps.len());
            prop_assert_eq!(series.store.rows() + repeated + missing + zero_stamps + stray, all);
            let values = values(&series);
            let mut next = 0;
            for run in &series.runs {
                prop_assert!(run.rows.start == next && !run.rows.is_empty());
                next = run.rows.end;
                let stamps_of_run = series.store.stamps(run.rows.clone()).unwrap();
                prop_assert!(stamps_of_run.windows(2).all(|pair| pair[0] < pair[1]));
                prop_assert_eq!((stamps_of_run.first(), stamps_of_run.last()), (Some(&run.start), Some(&run.end)));
                // Every row is the sample that it says.
                for (stamp, value) in stamps_of_run.iter().zip(&values[run.rows.clone()]) {
                    prop_assert_eq!(*stamp, samples[*value as usize].0);
                    prop_assert!((run.log_start..=run.log_end).contains(&(*value as i64)));
                }
            }
            prop_assert_eq!(next, series.store.rows());
        }
    }
}

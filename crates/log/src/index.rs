//! Episodes of one file, from a pass over its stamps; only a compact index stays.

use std::{ops::Range, path::Path};

use fleetfoot_data::{Fingerprint, Progress, ScalarBuffer, parallel_fold};
use serde::Serialize;

use crate::{
    Error, MaxGap,
    breaks::Breaks,
    cycles::{Cycle, Cycles, Turns},
    row_mask::RowMask,
    steps::Steps,
    table::{MISSING, Table},
};

/// Counts and steps of the stamps of a file.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[non_exhaustive]
pub struct ClockSummary {
    /// Rows of the file.
    pub rows: usize,
    /// Rows without a readable stamp; dropped.
    pub missing: usize,
    /// Rows with the stamp of the row before; dropped.
    pub repeated: usize,
    /// Stamps before the one of the row before; each starts an episode.
    pub backward: usize,
    /// Gaps larger than the accepted one; each starts an episode.
    pub gaps: usize,
    /// The largest step between two rows of the file, seconds.
    pub largest_step: f64,
    /// The accepted gap, seconds; infinite when there is none.
    pub max_gap: f64,
    /// Median sampling period, seconds; 0 when unknown.
    pub period: f64,
    /// Earliest stamp, nanoseconds.
    pub start: i64,
    /// Latest stamp, nanoseconds.
    pub end: i64,
}

/// The used rows of a file and how they fall into episodes.
pub(crate) struct FileIndex {
    pub mask: RowMask,
    /// Of stamps that begin anew, the turns.
    pub turns: Turns,
    pub spans: Vec<Span>,
    pub clock: ClockSummary,
}

/// An episode within a file.
pub(crate) struct Span {
    /// Its first row, counted over the used rows of the file.
    pub first: usize,
    pub rows: usize,
    pub start: i64,
    pub end: i64,
    /// Median period, seconds.
    pub period: f64,
    /// All stamps have gone in, no values yet.
    pub fingerprint: Fingerprint,
}

/// The stamp of a row of an equally spaced recording.
pub(crate) fn uniform_stamp(row: usize, dt: f64) -> i64 {
    (row as f64 * dt * 1e9).round() as i64
}

/// Stamps of consecutive rows of an equally spaced recording.
pub(crate) fn uniform_stamps(rows: Range<usize>, dt: f64) -> ScalarBuffer<i64> {
    rows.map(|row| uniform_stamp(row, dt)).collect::<Vec<_>>().into()
}

/// Equally spaced rows: one episode, or one a session where `sessions` are the first rows of those behind the first.
pub(crate) fn uniform(path: &Path, rows: usize, dt: f64, sessions: &[usize]) -> Result<FileIndex, Error> {
    let end = rows.saturating_sub(1) as f64 * dt * 1e9;
    // i64 nanoseconds reach 292 years.
    if end > 9.2e18 {
        return Err(Error::Damaged {
            path: path.into(),
            place: "its row count".into(),
            problem: format!("{rows} rows of {dt} s are longer than 292 years"),
            mend: "check the sampling period and the file",
        });
    }
    let firsts = std::iter::once(0).chain(sessions.iter().copied());
    let ends = sessions.iter().copied().chain([rows]);
    let spans: Vec<Span> = firsts.zip(ends).map(|(first, end)| uniform_span(first, end - first, dt)).collect();
    let longest = spans.iter().map(|span| span.end).max().unwrap_or(0);
    let period = if rows > 1 { dt } else { 0.0 };
    let clock = ClockSummary {
        rows,
        max_gap: f64::INFINITY,
        period,
        largest_step: period,
        end: longest,
        ..ClockSummary::default()
    };
    Ok(FileIndex { mask: RowMask::default(), turns: Turns::default(), spans, clock })
}

/// An episode of equally spaced rows that starts at zero.
fn uniform_span(first: usize, rows: usize, dt: f64) -> Span {
    let mut fingerprint = Fingerprint::new();
    for row in (0..rows).step_by(65_536) {
        fingerprint.stamps(&uniform_stamps(row..(row + 65_536).min(rows), dt));
    }
    let (end, period) = (uniform_stamp(rows.saturating_sub(1), dt), if rows > 1 { dt } else { 0.0 });
    Span { first, rows, start: 0, end, period, fingerprint }
}

/// Finds the episodes of a table with a time column. The stamps are read twice when the accepted gap follows from their
/// typical step, else once.
///
/// In the first case, rows are also parted if others are known to be lost between them. `cycle`: the way in which the
/// stamps may begin anew.
pub(crate) fn build(
    table: &dyn Table,
    max_gap: MaxGap,
    breaks: &Breaks,
    cycle: Cycle,
    progress: &dyn Progress,
) -> Result<FileIndex, Error> {
    let mut steps = Steps::default();
    let mut last = MISSING;
    let mut period = None;
    let gap = match max_gap {
        MaxGap::Unlimited => None,
        MaxGap::Seconds(seconds) => Some((seconds * 1e9).round().min(9.2e18) as i64),
        MaxGap::Auto => {
            scan(table, cycle, progress, |stamps| {
                for &stamp in stamps.iter().filter(|&&stamp| usable(stamp)) {
                    if last != MISSING && stamp > last {
                        steps.push(stamp.abs_diff(last));
                    }
                    last = stamp;
                }
            })?;
            period = steps.row_period();
            period.map(|period| i64::try_from(period).unwrap_or(i64::MAX).saturating_mul(5))
        }
    };
    let mut cutter = Cutter::new(gap);
    cutter.lost = (breaks.clone(), period);
    let turns = scan(table, cycle, progress, |stamps| cutter.feed(stamps))?;
    Ok(FileIndex { turns, ..cutter.finish() })
}

fn scan(
    table: &dyn Table,
    cycle: Cycle,
    progress: &dyn Progress,
    mut each: impl FnMut(&[i64]) + Send,
) -> Result<Turns, Error> {
    let pieces = table.pieces();
    let mut cycles = Cycles::new(cycle);
    parallel_fold(
        pieces.len(),
        progress,
        |i| table.stamps(pieces[i].clone()),
        |stamps| {
            each(&cycles.pass(stamps));
            Ok(())
        },
    )?;
    Ok(cycles.finish())
}

/// Stamps within 146 years of 1970, so that differences of two never overflow; [`MISSING`] is not one.
fn usable(stamp: i64) -> bool {
    stamp.unsigned_abs() <= 1 << 62
}

/// Cuts a stream of stamps into episodes.
struct Cutter {
    gap: Option<i64>,
    /// Breaks at which rows were lost, and the median step that confirms them; unused if the step is not known.
    lost: (Breaks, Option<u64>),
    row: usize,
    used: usize,
    last: i64,
    mask: RowMask,
    spans: Vec<Span>,
    /// Steps of the episode under way, and of the whole file.
    steps: Steps,
    all_steps: Steps,
    /// Stamps of the episode under way that are not yet in its fingerprint.
    pending: Vec<i64>,
    clock: ClockSummary,
}

impl Cutter {
    fn new(gap: Option<i64>) -> Self {
        let max_gap = gap.map_or(f64::INFINITY, |gap| gap as f64 * 1e-9);
        Self {
            gap,
            lost: (Breaks::default(), None),
            row: 0,
            used: 0,
            last: MISSING,
            mask: RowMask::default(),
            spans: Vec::new(),
            steps: Steps::default(),
            all_steps: Steps::default(),
            pending: Vec::new(),
            clock: ClockSummary { max_gap, start: i64::MAX, end: i64::MIN, ..ClockSummary::default() },
        }
    }

    fn feed(&mut self, stamps: &[i64]) {
        for &stamp in stamps {
            let row = self.row;
            self.row += 1;
            if !usable(stamp) {
                self.clock.missing += 1;
                self.mask.drop_row(row);
                continue;
            }
            if self.last == MISSING {
                self.begin(stamp);
            } else if stamp == self.last {
                self.clock.repeated += 1;
                self.mask.drop_row(row);
                continue;
            } else if stamp < self.last {
                self.clock.backward += 1;
                self.begin(stamp);
            } else {
                let step = stamp.abs_diff(self.last);
                self.clock.largest_step = self.clock.largest_step.max(step as f64 * 1e-9);
                let (breaks, period) = &self.lost;
                if self.gap.is_some_and(|gap| step > gap.unsigned_abs()) || breaks.lost(self.last, stamp, *period) {
                    self.clock.gaps += 1;
                    self.begin(stamp);
                } else {
                    self.steps.push(step);
                    self.all_steps.push(step);
                }
            }
            self.last = stamp;
            self.used += 1;
            self.pending.push(stamp);
        }
        self.flush();
    }

    /// Moves the pending stamps into the episode under way.
    fn flush(&mut self) {
        let (Some(span), Some(&end)) = (self.spans.last_mut(), self.pending.last()) else {
            return;
        };
        span.fingerprint.stamps(&self.pending);
        span.rows += self.pending.len();
        span.end = end;
        self.pending.clear();
    }

    fn close(&mut self) {
        self.flush();
        let Some(span) = self.spans.last_mut() else {
            return;
        };
        span.period = std::mem::take(&mut self.steps).median().map_or(0.0, |step| step as f64 * 1e-9);
        self.clock.start = self.clock.start.min(span.start);
        self.clock.end = self.clock.end.max(span.end);
    }

    fn begin(&mut self, stamp: i64) {
        self.close();
        let fingerprint = Fingerprint::new();
        self.spans.push(Span { first: self.used, rows: 0, start: stamp, end: stamp, period: 0.0, fingerprint });
    }

    fn finish(mut self) -> FileIndex {
        self.close();
        self.mask.finish();
        self.clock.rows = self.row;
        self.clock.period = self.all_steps.median().map_or(0.0, |step| step as f64 * 1e-9);
        if self.spans.is_empty() {
            (self.clock.start, self.clock.end) = (0, 0);
        }
        FileIndex { mask: self.mask, turns: Turns::default(), spans: self.spans, clock: self.clock }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(stamps: &[i64], gap: Option<i64>, piece: usize) -> FileIndex {
        let mut cutter = Cutter::new(gap);
        stamps.chunks(piece).for_each(|part| cutter.feed(part));
        cutter.finish()
    }

    #[test]
    fn gaps_and_backward_stamps_cut_and_repeats_are_dropped() {
        let stamps = [0, 10, 20, 20, 30, MISSING, 40, 100, 110, 105, 115, 125];
        for piece in [1, 2, 5, 12] {
            let index = cut(&stamps, Some(50), piece);
            let spans: Vec<_> = index.spans.iter().map(|span| (span.first, span.rows, span.start, span.end)).collect();
            assert_eq!(spans, [(0, 5, 0, 40), (5, 2, 100, 110), (7, 3, 105, 125)]);
            let clock = index.clock;
            assert_eq!((clock.missing, clock.repeated, clock.backward, clock.gaps, clock.rows), (1, 1, 1, 1, 12));
            assert_eq!((index.mask.place(3), index.mask.place(4), index.mask.place(5)), (4, 6, 7));
            assert!((clock.period - 10e-9).abs() < 1e-15 && (clock.largest_step - 60e-9).abs() < 1e-15);
        }
    }

    #[test]
    fn the_fingerprint_does_not_depend_on_the_pieces() {
        let stamps: Vec<i64> = (0..2000).map(|i| i * 10).collect();
        let ids: Vec<_> =
            [1, 7, 256, 2000].map(|piece| cut(&stamps, None, piece).spans.remove(0).fingerprint.finish()).into();
        assert!(ids.iter().all(|id| *id == ids[0]));
    }

    #[test]
    fn no_stamps_no_episodes() {
        let index = cut(&[MISSING, MISSING], None, 1);
        assert!(index.spans.is_empty());
        assert_eq!((index.clock.missing, index.clock.start), (2, 0));
    }
}

//! Sorted samples on their way into the store: runs, steps and offsets of the clock.

use std::ops::Range;

use crate::{Error, steps::Steps, store::StoreBuilder};

/// Rows whose offset between log time and stamp is kept for the median.
const OFFSETS: usize = 1 << 14;

/// Rows over which the clock did not jump back.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Run {
    /// Its rows; never empty.
    pub rows: Range<usize>,
    /// First stamp, nanoseconds.
    pub start: i64,
    /// Last stamp.
    pub end: i64,
    /// Earliest log time of its samples.
    pub log_start: i64,
    /// Latest log time.
    pub log_end: i64,
}

/// Samples in recorded order.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Samples<'a> {
    pub stamps: &'a [i64],
    /// As many as stamps.
    pub log_times: &'a [i64],
    /// `width` values for each stamp, one sample after the other.
    pub values: &'a [f64],
    /// Values of a sample.
    pub width: usize,
}

impl<'a> Samples<'a> {
    /// The first so many, and the others.
    pub(super) fn split_at(&self, at: usize) -> (Self, Self) {
        let (stamps, log_times) = (self.stamps.split_at(at), self.log_times.split_at(at));
        let values: (&'a [f64], &'a [f64]) = self.values.split_at(at * self.width);
        let part = |stamps, log_times, values| Self { stamps, log_times, values, width: self.width };
        (part(stamps.0, log_times.0, values.0), part(stamps.1, log_times.1, values.1))
    }
}

/// Sorted samples on their way into the store.
pub(super) struct Rows {
    pub(super) store: StoreBuilder,
    written: usize,
    pub(super) runs: Vec<Run>,
    /// The run under way.
    run: Option<Run>,
    pub(super) steps: Steps,
    pub(super) offsets: Offsets,
}

impl Rows {
    pub(super) fn new(store: StoreBuilder) -> Self {
        Self { store, written: 0, runs: Vec::new(), run: None, steps: Steps::default(), offsets: Offsets::default() }
    }

    /// Adds the next row of the run under way; its stamp lies after that of the row before.
    pub(super) fn push(&mut self, stamp: i64, log_time: i64, row: &[f64]) -> Result<(), Error> {
        self.store.push(stamp, row)?;
        self.count(stamp, log_time);
        Ok(())
    }

    /// Adds rows of the run under way; their stamps rise strictly, from after that of the row before.
    pub(super) fn extend(&mut self, samples: &Samples<'_>) -> Result<(), Error> {
        self.store.push_rows(samples.stamps, samples.values)?;
        samples.stamps.iter().zip(samples.log_times).for_each(|(&stamp, &log_time)| self.count(stamp, log_time));
        Ok(())
    }

    fn count(&mut self, stamp: i64, log_time: i64) {
        self.offsets.push(log_time.saturating_sub(stamp));
        let at = self.written;
        self.written += 1;
        match &mut self.run {
            Some(run) => {
                self.steps.push(stamp.abs_diff(run.end));
                run.rows.end = at + 1;
                run.end = stamp;
                run.log_start = run.log_start.min(log_time);
                run.log_end = run.log_end.max(log_time);
            }
            none => {
                *none =
                    Some(Run { rows: at..at + 1, start: stamp, end: stamp, log_start: log_time, log_end: log_time });
            }
        }
    }

    /// Ends the run under way.
    pub(super) fn end_run(&mut self) {
        self.runs.extend(self.run.take());
    }
}

/// Every so manieth offset of a stream: all at first, and half as dense whenever there are too many.
#[derive(Debug)]
pub(super) struct Offsets {
    kept: Vec<i64>,
    stride: u64,
    seen: u64,
}

impl Default for Offsets {
    fn default() -> Self {
        Self { kept: Vec::new(), stride: 1, seen: 0 }
    }
}

impl Offsets {
    fn push(&mut self, offset: i64) {
        if self.seen.is_multiple_of(self.stride) {
            if self.kept.len() == OFFSETS {
                let mut place = 0;
                self.kept.retain(|_| {
                    place += 1;
                    place % 2 == 1
                });
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.kept.push(offset);
            }
        }
        self.seen += 1;
    }

    /// The upper median.
    pub(super) fn median(mut self) -> Option<i64> {
        self.kept.sort_unstable();
        self.kept.get(self.kept.len() / 2).copied()
    }
}

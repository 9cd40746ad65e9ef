//! Samples put in the order of their stamps, in bounded memory.

use std::collections::VecDeque;

use crate::{
    Error,
    join::rows::{Rows, Samples},
};

/// Samples that wait at most; beyond it the oldest goes on, however wide the window is.
const WAITING: usize = 1 << 14;
/// Samples out of their time that are strays; one more, and the time has changed.
const STRAYS: usize = 2;

/// A sample that waits; its values stand in a slot of the shared buffer.
#[derive(Debug, Clone, Copy)]
struct Sample {
    stamp: i64,
    log_time: i64,
    slot: usize,
}

/// The reordering buffer of a series.
///
/// `waiting` holds the newest samples of the run in order. A sample leaves it when one newer by more than the window has come, so that
/// nothing which is late by at most the window can come before one that has left. The newest [`STRAYS`] always stay, to be taken back if they
/// were a leap of the clock. Samples that are later than the window are held in `late` until it is known whether the time goes on or stays back.
pub(super) struct Reorder {
    columns: usize,
    window: i64,
    waiting: VecDeque<Sample>,
    late: Vec<Sample>,
    /// Stamp of the last sample of the run that has left.
    released: Option<i64>,
    /// Values by slot, `columns` each.
    values: Vec<f64>,
    slots: usize,
    free: Vec<usize>,
    pub repeated: usize,
    pub stray: usize,
}

impl Reorder {
    pub(super) fn new(columns: usize, window: i64) -> Self {
        Self {
            columns,
            window: window.max(0),
            waiting: VecDeque::new(),
            late: Vec::new(),
            released: None,
            values: Vec::new(),
            slots: 0,
            free: Vec::new(),
            repeated: 0,
            stray: 0,
        }
    }

    /// Takes a sample, and gives on those whose place is certain.
    pub(super) fn push(&mut self, stamp: i64, log_time: i64, row: &[f64], rows: &mut Rows) -> Result<(), Error> {
        let slot = self.keep(row);
        self.admit(Sample { stamp, log_time, slot }, rows)
    }

    /// Takes samples whose stamps rise strictly, when the first of them lies after all that have come, and answers whether it has.
    ///
    /// The result is that of adding the samples one by one: every sample that one of them releases, the next one would
    /// release as well. So the newest decides at once, and only the samples that stay are copied into the buffer.
    pub(super) fn extend(&mut self, samples: &Samples<'_>, rows: &mut Rows) -> Result<bool, Error> {
        let (Some(&first), Some(&newest)) = (samples.stamps.first(), samples.stamps.last()) else { return Ok(true) };
        let before = self.waiting.back().map(|sample| sample.stamp).max(self.released);
        if !self.late.is_empty() || before.is_some_and(|before| first <= before) {
            return Ok(false);
        }
        let certain = newest.saturating_sub(self.window);
        let old = self.waiting.partition_point(|sample| sample.stamp < certain);
        let new = samples.stamps.partition_point(|&stamp| stamp < certain);
        let all = self.waiting.len() + samples.stamps.len();
        // The window is not below zero, so that all of `waiting` is certain where one of the new samples is.
        let leaving = (old + new).max(all.saturating_sub(WAITING)).min(all.saturating_sub(STRAYS));
        let old = leaving.min(self.waiting.len());
        let (given, kept) = samples.split_at(leaving - old);
        for _ in 0..old {
            self.give_oldest(rows)?;
        }
        rows.extend(&given)?;
        self.released = given.stamps.last().copied().or(self.released);
        for (at, (&stamp, &log_time)) in kept.stamps.iter().zip(kept.log_times).enumerate() {
            let slot = self.keep(&kept.values[at * kept.width..(at + 1) * kept.width]);
            self.waiting.push_back(Sample { stamp, log_time, slot });
        }
        Ok(true)
    }

    /// Gives on all that wait. Late samples that nothing came after have stayed back: they are runs of their own.
    pub(super) fn finish(&mut self, rows: &mut Rows) -> Result<(), Error> {
        loop {
            let late = std::mem::take(&mut self.late);
            self.begin_run(rows)?;
            if late.is_empty() {
                return Ok(());
            }
            // The first of them is never late in an empty run, so that each turn has fewer.
            for sample in late {
                self.admit(sample, rows)?;
            }
        }
    }

    fn admit(&mut self, sample: Sample, rows: &mut Rows) -> Result<(), Error> {
        if self.is_late(sample.stamp) {
            self.late.push(sample);
            return if self.late.len() > STRAYS { self.fall_back(rows) } else { Ok(()) };
        }
        self.stray += self.late.len();
        self.free.extend(self.late.drain(..).map(|late| late.slot));
        match self.place(sample.stamp) {
            Ok(_) => {
                self.repeated += 1;
                self.free.push(sample.slot);
            }
            Err(place) => self.waiting.insert(place, sample),
        }
        self.release(rows)
    }

    fn is_late(&self, stamp: i64) -> bool {
        let newest = self.waiting.back().map(|sample| sample.stamp);
        newest.is_some_and(|newest| stamp < newest.saturating_sub(self.window))
            || self.released.is_some_and(|released| stamp <= released)
    }

    /// Place of a stamp among the waiting samples. Samples mostly come in order, so the end is tried first.
    fn place(&self, stamp: i64) -> Result<usize, usize> {
        match self.waiting.back() {
            Some(newest) if stamp <= newest.stamp => self.waiting.binary_search_by_key(&stamp, |sample| sample.stamp),
            _ => Err(self.waiting.len()),
        }
    }

    fn release(&mut self, rows: &mut Rows) -> Result<(), Error> {
        while self.waiting.len() > STRAYS {
            let certain = match (self.waiting.front(), self.waiting.back()) {
                (Some(oldest), Some(newest)) => oldest.stamp < newest.stamp.saturating_sub(self.window),
                _ => false,
            };
            if !certain && self.waiting.len() <= WAITING {
                break;
            }
            self.give_oldest(rows)?;
        }
        Ok(())
    }

    fn give_oldest(&mut self, rows: &mut Rows) -> Result<(), Error> {
        let Some(sample) = self.waiting.pop_front() else {
            return Ok(());
        };
        let from = sample.slot * self.columns;
        rows.push(sample.stamp, sample.log_time, &self.values[from..from + self.columns])?;
        self.released = Some(sample.stamp);
        self.free.push(sample.slot);
        Ok(())
    }

    /// The time stays back. Either it goes on from where it was before one or two samples leapt ahead, or it is another run.
    fn fall_back(&mut self, rows: &mut Rows) -> Result<(), Error> {
        let late = std::mem::take(&mut self.late);
        let back_to = late.first().map_or(i64::MAX, |first| first.stamp);
        let ahead = self.waiting.iter().rev().take_while(|s| s.stamp > back_to.saturating_add(self.window)).count();
        let rest = self.waiting.len() - ahead;
        let before = rest.checked_sub(1).map(|last| self.waiting[last].stamp).or(self.released);
        let goes_on = before.is_some_and(|before| back_to >= before.saturating_sub(self.window))
            && self.released.is_none_or(|released| back_to > released);
        if ahead <= STRAYS && goes_on {
            self.stray += ahead;
            self.free.extend(self.waiting.drain(rest..).map(|sample| sample.slot));
        } else {
            self.begin_run(rows)?;
        }
        // The first is on time now, so that at most two are late again: this cannot go round.
        late.into_iter().try_for_each(|sample| self.admit(sample, rows))
    }

    fn begin_run(&mut self, rows: &mut Rows) -> Result<(), Error> {
        while !self.waiting.is_empty() {
            self.give_oldest(rows)?;
        }
        self.released = None;
        rows.end_run();
        Ok(())
    }

    fn keep(&mut self, row: &[f64]) -> usize {
        let slot = self.free.pop().unwrap_or_else(|| {
            self.slots += 1;
            self.values.resize(self.slots * self.columns, f64::NAN);
            self.slots - 1
        });
        let from = slot * self.columns;
        for (kept, &value) in self.values[from..from + self.columns].iter_mut().zip(row) {
            *kept = value;
        }
        slot
    }
}

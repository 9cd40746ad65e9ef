//! Stamps that begin anew and go on: times of the day over midnight, and counters of 16 or 32 bits that wrap.

use std::ops::Range;

use fleetfoot_data::ScalarBuffer;

use crate::{TimeUnit, table::MISSING};

/// Nanoseconds of a day.
const DAY: i64 = 86_400_000_000_000;
/// Step back over midnight, nanoseconds, within which a row came late.
const LATE: i64 = 3_600_000_000_000;
/// Bits of counters.
const BITS: [u32; 2] = [16, 32];
/// Rising steps before a counter may wrap: they show its usual step.
const FEWEST_STEPS: i64 = 2;
/// Mean steps that a counter takes at most where it wraps.
const LONGEST: i64 = 3;

/// The way in which the stamps of a clock may begin anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Cycle {
    /// They do not.
    #[default]
    Never,
    /// Times of the day.
    Day,
    /// Ticks of a counter in this unit.
    Counter(TimeUnit),
}

/// A pass over the stamps of a file that finds the turns of its rows: days, or rounds of a counter.
///
/// A stamp beyond the first day is no time of the day and stays. More than half a day back is the next day; less is a step back. A row that goes back over
/// midnight by less than an hour came late: it belongs to the day before, and the rows behind it do not.
///
/// A counter wraps where 2^16 or 2^32 ticks more make the step back one of the usual length, and no tick was beyond that
/// range.
#[derive(Debug, Default)]
pub(crate) struct Cycles {
    cycle: Cycle,
    last: Option<i64>,
    counter: Counter,
    turn: i64,
    row: usize,
    turns: Turns,
}

/// The ticks of a counter so far.
#[derive(Debug, Default)]
struct Counter {
    lowest: i64,
    highest: i64,
    /// Sum and number of the rising steps.
    rise: i64,
    steps: i64,
}

/// The turns of the rows of a file, counted from its first one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Turns {
    /// Nanoseconds of a turn, and the stamps that lie within one.
    period: i64,
    within: Range<i64>,
    /// Rows from which on another turn counts, and that turn.
    changes: Vec<(usize, i64)>,
    /// Bits of the counter and its unit.
    counter: Option<(u32, TimeUnit)>,
}

impl Cycles {
    /// A pass over stamps that begin anew in such a way.
    pub(crate) fn new(cycle: Cycle) -> Self {
        let turns = Turns { period: DAY, within: 0..DAY, ..Turns::default() };
        Self { cycle, turns, ..Self::default() }
    }

    /// The stamps of the next rows, with their turns.
    pub(crate) fn pass(&mut self, stamps: ScalarBuffer<i64>) -> ScalarBuffer<i64> {
        let from = self.row;
        for &stamp in &*stamps {
            let row = self.row;
            self.row += 1;
            let turn = match self.cycle {
                Cycle::Never => continue,
                Cycle::Day if (0..DAY).contains(&stamp) => self.day(stamp),
                Cycle::Counter(unit) if stamp != MISSING => self.round(stamp, unit),
                Cycle::Day | Cycle::Counter(_) => continue,
            };
            if self.turns.changes.last().map_or(0, |&(_, turn)| turn) != turn {
                self.turns.changes.push((row, turn));
            }
        }
        self.turns.add(from..self.row, stamps)
    }

    /// The day of a time of the day.
    fn day(&mut self, stamp: i64) -> i64 {
        let step = self.last.map_or(0, |last| stamp - last);
        let is_late = step > DAY - LATE;
        if step < -DAY / 2 {
            self.turn += 1;
        }
        if !is_late {
            self.last = Some(stamp);
        }
        if is_late { self.turn - 1 } else { self.turn }
    }

    /// The round of a counter.
    fn round(&mut self, stamp: i64, unit: TimeUnit) -> i64 {
        let last = self.last.replace(stamp).unwrap_or(stamp);
        let counter = &mut self.counter;
        (counter.lowest, counter.highest) = (counter.lowest.min(stamp), counter.highest.max(stamp));
        let step = stamp.saturating_sub(last);
        if step > 0 {
            counter.rise = counter.rise.saturating_add(step);
            counter.steps += 1;
        } else if let Some(bits) = BITS.into_iter().find(|&bits| step < 0 && counter.wraps(step, period(bits, unit)))
            && self.turns.counter.is_none_or(|known| known == (bits, unit))
        {
            let period = period(bits, unit);
            (self.turns.period, self.turns.within) = (period, -period / 2..period);
            self.turns.counter = Some((bits, unit));
            self.turn += 1;
        }
        self.turn
    }

    pub(crate) fn finish(self) -> Turns {
        self.turns
    }
}

/// Nanoseconds in which a counter comes round.
fn period(bits: u32, unit: TimeUnit) -> i64 {
    (1 << bits) * unit.nanoseconds()
}

impl Counter {
    /// Returns true if a step back is that of a counter with such a period.
    fn wraps(&self, step: i64, period: i64) -> bool {
        let is_within = if self.lowest < 0 {
            self.lowest >= -period / 2 && self.highest < period / 2
        } else {
            self.highest < period
        };
        let step = step.saturating_add(period);
        let longest = (self.rise / self.steps.max(1)).saturating_mul(LONGEST).min(period / 2);
        is_within && self.steps >= FEWEST_STEPS && (1..=longest).contains(&step)
    }
}

impl Turns {
    /// Note on a counter that wrapped.
    pub(crate) fn note(&self, column: &str) -> Option<String> {
        let (bits, unit) = self.counter?;
        // Without numbers of the file, so that the notes of many files become one.
        Some(format!("the ticks of `{column}` wrap at 2^{bits} {} and are counted on", unit.symbol()))
    }

    /// The stamps of some rows, with their turns; [`MISSING`] beyond what nanoseconds hold.
    pub(crate) fn add(&self, rows: Range<usize>, stamps: ScalarBuffer<i64>) -> ScalarBuffer<i64> {
        let first = self.changes.partition_point(|&(row, _)| row <= rows.start).saturating_sub(1);
        let mut changes = self.changes[first.min(self.changes.len())..].iter().peekable();
        if changes.peek().is_none_or(|&&(row, _)| row >= rows.end) {
            return stamps;
        }
        let mut turn = 0;
        let of_row = |(row, &stamp): (usize, &i64)| {
            while let Some(&(_, next)) = changes.next_if(|&&(from, _)| from <= row) {
                turn = next;
            }
            let moved = || self.period.checked_mul(turn).and_then(|begin| begin.checked_add(stamp)).unwrap_or(MISSING);
            if self.within.contains(&stamp) { moved() } else { stamp }
        };
        rows.zip(stamps.iter()).map(of_row).collect::<Vec<_>>().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn passed(stamps: &[i64]) -> (Vec<i64>, Turns) {
        let mut cycles = Cycles::new(Cycle::Day);
        let stamps = cycles.pass(stamps.to_vec().into()).to_vec();
        (stamps, cycles.finish())
    }

    #[test]
    fn backward_time_begins_the_next_day() {
        let hours = [22, 23, 0, 1, 23, 22, 0].map(|hour| hour * 3600 * SECOND);
        let days = passed(&hours).0.iter().map(|stamp| stamp / (3600 * SECOND)).collect::<Vec<_>>();
        assert_eq!(days, [22, 23, 24, 25, 47, 46, 48]);
        let dates = [1_700_000_000 * SECOND, MISSING, -5];
        assert_eq!(passed(&dates).0, dates);
        // A late row belongs to the day before, and those behind it do not go on with another day.
        let seconds = [86_399, 1, 86_398, 2, 86_399, 3, 7200].map(|second| second * SECOND);
        let days = passed(&seconds).0.iter().map(|stamp| stamp / SECOND).collect::<Vec<_>>();
        assert_eq!(days, [86_399, 86_401, 86_398, 86_402, 86_399, 86_403, 93_600]);
    }

    #[test]
    fn row_ranges_match_the_pass() {
        let stamps: Vec<i64> = (0..90).map(|row| (row * 7 % 24) * 3600 * SECOND + row).collect();
        let (all, days) = passed(&stamps);
        let mut cycles = Cycles::new(Cycle::Day);
        let pieces = stamps.chunks(7).flat_map(|piece| cycles.pass(piece.to_vec().into()).to_vec());
        assert_eq!(pieces.collect::<Vec<_>>(), all);
        for from in 0..90 {
            for to in [from, from + 1, 60, 90] {
                let rows = from..to.max(from);
                assert_eq!(days.add(rows.clone(), stamps[rows.clone()].to_vec().into())[..], all[rows]);
            }
        }
    }

    #[test]
    fn days_beyond_nanoseconds_are_missing() {
        let hours: Vec<i64> = (0..300_000).map(|row| if row % 2 == 0 { 23 } else { 1 } * 3600 * SECOND).collect();
        let (stamps, _) = passed(&hours);
        assert_eq!((stamps[1], stamps[299_999]), (25 * 3600 * SECOND, MISSING));
    }

    #[test]
    fn counter_wraps_at_usual_steps() {
        let counted = |ticks: &[i64]| {
            let mut cycles = Cycles::new(Cycle::Counter(TimeUnit::Milliseconds));
            let stamps = ticks.iter().map(|tick| tick * 1_000_000).collect::<Vec<_>>();
            let passed = cycles.pass(stamps.into()).iter().map(|stamp| stamp / 1_000_000).collect::<Vec<_>>();
            (passed, cycles.finish().note("t"))
        };
        for bits in BITS {
            let period = 1i64 << bits;
            // Unsigned and signed, with a pause and a late row before.
            let truth: Vec<i64> = (0..40).map(|k| period - 205 + 10 * k).collect();
            let unsigned = counted(&truth.iter().map(|tick| tick % period).collect::<Vec<_>>());
            assert_eq!(unsigned.0, truth);
            assert_eq!(unsigned.1.unwrap(), format!("the ticks of `t` wrap at 2^{bits} ms and are counted on"));
            let truth: Vec<i64> = (0..40).map(|k| period / 2 - 205 + 10 * k).collect();
            let signed = |tick: &i64| if *tick >= period / 2 { tick - period } else { *tick };
            let ticks: Vec<i64> = std::iter::once(-5).chain(truth.iter().map(signed)).collect();
            assert_eq!(counted(&ticks).0[1..], truth);
        }
        // Sessions, a step over the end of the range, and ticks beyond it.
        for ticks in [
            vec![64_000, 64_010, 64_020, 0, 10, 20],
            vec![65_500, 65_510, 65_520, 300, 310],
            vec![65_510, 65_520, 65_530, 65_540, 4, 14],
            vec![65_530, 4, 14],
        ] {
            assert_eq!(counted(&ticks), (ticks, None));
        }
    }
}

//! Times of the day that pass midnight continue on the next day.

use std::ops::Range;

use fleetfoot_data::ScalarBuffer;

use crate::table::MISSING;

/// Nanoseconds of a day.
const DAY: i64 = 86_400_000_000_000;
/// Step back over midnight, nanoseconds, within which a row came late.
const LATE: i64 = 3_600_000_000_000;

/// A pass over the stamps of a file that finds the days of its rows.
///
/// A stamp beyond the first day is no time of the day and stays. More than half a day back is the next day; less is a step back. A row that goes back over
/// midnight by less than an hour came late: it belongs to the day before, and the rows behind it do not.
#[derive(Debug, Default)]
pub(crate) struct Midnights {
    last: Option<i64>,
    day: i64,
    row: usize,
    days: Days,
}

/// The days of the rows of a file, counted from its first one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Days {
    /// Rows from which on another day counts, and that day.
    changes: Vec<(usize, i64)>,
}

impl Midnights {
    /// The stamps of the next rows, with their days.
    pub(crate) fn pass(&mut self, stamps: ScalarBuffer<i64>) -> ScalarBuffer<i64> {
        let from = self.row;
        for &stamp in &*stamps {
            let row = self.row;
            self.row += 1;
            if !is_of_day(stamp) {
                continue;
            }
            let step = self.last.map_or(0, |last| stamp - last);
            let is_late = step > DAY - LATE;
            if step < -DAY / 2 {
                self.day += 1;
            }
            if !is_late {
                self.last = Some(stamp);
            }
            let day = if is_late { self.day - 1 } else { self.day };
            if self.days.changes.last().map_or(0, |&(_, day)| day) != day {
                self.days.changes.push((row, day));
            }
        }
        self.days.add(from..self.row, stamps)
    }

    pub(crate) fn finish(self) -> Days {
        self.days
    }
}

impl Days {
    /// The stamps of some rows, with their days; [`MISSING`] beyond what nanoseconds hold.
    pub(crate) fn add(&self, rows: Range<usize>, stamps: ScalarBuffer<i64>) -> ScalarBuffer<i64> {
        let first = self.changes.partition_point(|&(row, _)| row <= rows.start).saturating_sub(1);
        let mut changes = self.changes[first.min(self.changes.len())..].iter().peekable();
        if changes.peek().is_none_or(|&&(row, _)| row >= rows.end) {
            return stamps;
        }
        let mut day = 0;
        let of_row = |(row, &stamp): (usize, &i64)| {
            while let Some(&(_, next)) = changes.next_if(|&&(from, _)| from <= row) {
                day = next;
            }
            let moved = || DAY.checked_mul(day).and_then(|midnight| midnight.checked_add(stamp)).unwrap_or(MISSING);
            if is_of_day(stamp) { moved() } else { stamp }
        };
        rows.zip(stamps.iter()).map(of_row).collect::<Vec<_>>().into()
    }
}

fn is_of_day(stamp: i64) -> bool {
    (0..DAY).contains(&stamp)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn passed(stamps: &[i64]) -> (Vec<i64>, Days) {
        let mut midnights = Midnights::default();
        let stamps = midnights.pass(stamps.to_vec().into()).to_vec();
        (stamps, midnights.finish())
    }

    #[test]
    fn the_next_day_begins_where_the_time_goes_back() {
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
    fn any_rows_are_those_of_the_pass() {
        let stamps: Vec<i64> = (0..90).map(|row| (row * 7 % 24) * 3600 * SECOND + row).collect();
        let (all, days) = passed(&stamps);
        let mut midnights = Midnights::default();
        let pieces = stamps.chunks(7).flat_map(|piece| midnights.pass(piece.to_vec().into()).to_vec());
        assert_eq!(pieces.collect::<Vec<_>>(), all);
        for from in 0..90 {
            for to in [from, from + 1, 60, 90] {
                let rows = from..to.max(from);
                assert_eq!(days.add(rows.clone(), stamps[rows.clone()].to_vec().into())[..], all[rows]);
            }
        }
    }

    #[test]
    fn days_beyond_what_nanoseconds_hold_are_missing() {
        let hours: Vec<i64> = (0..300_000).map(|row| if row % 2 == 0 { 23 } else { 1 } * 3600 * SECOND).collect();
        let (stamps, _) = passed(&hours);
        assert_eq!((stamps[1], stamps[299_999]), (25 * 3600 * SECOND, MISSING));
    }
}

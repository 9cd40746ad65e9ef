//! Possible units of a clock's numbers, by their size and by their steps.
//!
//! A unit is possible if it makes the stamps dates of this century, or counts from a start at most ten days ago. The
//! rows must also come at a rate that logs have. Logs between 9 and 110 Hz leave one unit. Others leave two, and only a
//! name, a date or another file decides.

use std::fmt;

use crate::{TimeUnit, stamp};

/// All units, the coarsest first.
const UNITS: [TimeUnit; 4] = [TimeUnit::Seconds, TimeUnit::Milliseconds, TimeUnit::Microseconds, TimeUnit::Nanoseconds];
/// The slowest rate of logs, Hz. It is above 0.1, or 100 Hz in ms would be a log of 0.1 Hz in s too.
const SLOWEST: f64 = 0.11;
/// The fastest rate of logs, Hz.
const FASTEST: f64 = 9e3;
/// The slowest rate of rows that come unevenly: events may be far apart.
const SLOWEST_EVENTS: f64 = 1e-3;
/// The fastest rate at which numbers with decimals are taken for another unit than seconds.
const FASTEST_FRACTIONS: f64 = 500.0;
/// The longest time since a clock's start, seconds. Dates in one unit are beyond it in the next finer one.
const LONGEST: f64 = 864e3;
/// Seconds since 1970 of the dates from 2000 to 2100.
const DATES: [f64; 2] = [946_684_800.0, 4_102_444_800.0];
/// Seconds since a start that are more than [`LONGEST`], but not out of the question where no other unit fits.
const FAR: f64 = 3e8;

/// Rate and first stamp of a file if its stamps are in this unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The unit.
    pub unit: TimeUnit,
    /// Rows a second, by the median step; `None` of a single stamp.
    pub rate: Option<f64>,
    /// The first stamp, seconds; NaN where the first rows have none.
    pub start: f64,
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.start.is_nan() {
            return f.write_str(self.unit.symbol());
        }
        let rate = self.rate.map(|rate| format!("{} Hz, ", digits(rate))).unwrap_or_default();
        write!(f, "{} ({rate}from {} on)", self.unit.symbol(), moment(self.start))
    }
}

/// Four digits of a number.
fn digits(value: f64) -> String {
    rounded(value, 4)
}

/// So many digits of a number.
pub(super) fn rounded(value: f64, digits: u8) -> String {
    let scale = 10f64.powf(f64::from(digits) - 1.0 - value.abs().log10().floor());
    if value == 0.0 || !scale.is_finite() { format!("{value}") } else { format!("{}", (value * scale).round() / scale) }
}

/// A date, or the time since a start in a unit that people read.
fn moment(seconds: f64) -> String {
    if (DATES[0]..DATES[1]).contains(&seconds) {
        let date = jiff::Timestamp::from_nanosecond(i128::from(stamp::from_f64(seconds, TimeUnit::Seconds)));
        return date.map_or_else(|_| format!("{seconds} s"), |date| date.strftime("%F %T").to_string());
    }
    match seconds.abs() {
        86_400.0.. => format!("{} days", digits(seconds / 86_400.0)),
        3600.0.. => format!("{} h", digits(seconds / 3600.0)),
        _ => format!("{} s", digits(seconds)),
    }
}

/// The units that a sample of stamps may be in; no unit where it says nothing.
pub(super) fn readings(sample: &[f64]) -> Vec<Reading> {
    let values: Vec<f64> = sample.iter().copied().filter(|value| value.is_finite()).collect();
    let largest = values.iter().copied().map(f64::abs).fold(0.0, f64::max);
    let steps = Steps::of(&values);
    let is_whole = values.iter().all(|value| value.fract() == 0.0);
    let reading = |unit: TimeUnit| Reading {
        unit,
        rate: steps.as_ref().map(|steps| 1.0 / (steps.median * unit.seconds())),
        start: values.first().copied().unwrap_or(0.0) * unit.seconds(),
    };
    if values.is_empty() && !sample.is_empty() {
        // Rows without a stamp leave all units open.
        return UNITS.into_iter().map(|unit| Reading { unit, rate: None, start: f64::NAN }).collect();
    }
    if largest == 0.0 {
        // Nought is nought in every unit.
        return vec![reading(TimeUnit::Seconds)];
    }
    let is_date = |unit: &TimeUnit| (DATES[0]..DATES[1]).contains(&(largest * unit.seconds()));
    let fits = |unit: &TimeUnit| largest * unit.seconds() <= LONGEST || is_date(unit);
    let by_size: Vec<TimeUnit> = UNITS.into_iter().filter(fits).collect();
    let has_rate = |unit: &TimeUnit| steps.as_ref().is_some_and(|steps| steps.are_of(*unit, is_whole));
    let by_rate: Vec<TimeUnit> = by_size.iter().copied().filter(has_rate).collect();
    // A date at a common rate is no accident.
    let is_common =
        |unit: &TimeUnit| steps.as_ref().is_some_and(|steps| steps.is_common(unit.seconds(), [SLOWEST, FASTEST]));
    let units = match by_rate.iter().find(|unit| is_date(unit) && is_common(unit)) {
        Some(&date) => vec![date],
        None if !by_rate.is_empty() => by_rate,
        // Numbers with decimals are seconds where nothing speaks for another unit.
        None if !is_whole && by_size.first().is_none_or(|&unit| unit == TimeUnit::Seconds) => vec![TimeUnit::Seconds],
        None if steps.is_none() => by_size,
        None => {
            let is_far = |unit: &TimeUnit| largest * unit.seconds() <= FAR && has_rate(unit);
            let dates = UNITS.into_iter().filter(|unit| is_date(unit) || is_far(unit)).collect::<Vec<_>>();
            if dates.is_empty() { by_size } else { dates }
        }
    };
    units.into_iter().map(reading).collect()
}

/// The unit that seconds with decimals may be instead: milliseconds at a rate that only [`FASTEST_FRACTIONS`] forbids.
pub(super) fn instead(reading: &Reading) -> Option<TimeUnit> {
    let milliseconds = TimeUnit::Milliseconds;
    let rate = reading.rate? / milliseconds.seconds();
    let is_possible = reading.unit == TimeUnit::Seconds
        && (FASTEST_FRACTIONS..=FASTEST).contains(&rate)
        && reading.start.abs() * milliseconds.seconds() <= LONGEST;
    is_possible.then_some(milliseconds)
}

/// The rate of a reading, and the symbol of the next coarser unit, where only [`SLOWEST`] forbids that one.
pub(super) fn slower(reading: &Reading) -> Option<(f64, &'static str)> {
    let rate = reading.rate?;
    let place = UNITS.iter().position(|&unit| unit == reading.unit)?;
    let coarser = UNITS.get(place.checked_sub(1)?)?;
    let is_possible = (SLOWEST_EVENTS..SLOWEST).contains(&(rate * 1e-3)) && reading.start.abs() * 1e3 <= LONGEST;
    is_possible.then_some((rate, coarser.symbol()))
}

/// The units of readings, but for one.
pub(super) fn symbols(readings: &[Reading], without: TimeUnit) -> Vec<&'static str> {
    readings.iter().filter(|reading| reading.unit != without).map(|reading| reading.unit.symbol()).collect()
}

/// The steps between the rows of a sample, in its numbers.
struct Steps {
    median: f64,
    mean: f64,
    even: bool,
}

impl Steps {
    fn of(values: &[f64]) -> Option<Self> {
        let mut steps: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).filter(|&step| step > 0.0).collect();
        steps.sort_by(f64::total_cmp);
        let median = *steps.get(steps.len() / 2)?;
        // A jump from a stamp that was never set to a date is no step.
        let real: Vec<f64> = steps.iter().copied().filter(|&step| step < 1e6 * median).collect();
        let near = steps.iter().filter(|&&step| (step - median).abs() <= 0.25 * median).count();
        let mean = real.iter().sum::<f64>() / real.len() as f64;
        Some(Self { median, mean, even: steps.len() > 1 && 2 * near > steps.len() })
    }

    /// Returns true if rows come at such a rate, by their median step or, for bursts, their mean one.
    fn is_common(&self, unit: f64, [slowest, fastest]: [f64; 2]) -> bool {
        [self.median, self.mean].into_iter().any(|step| (slowest..=fastest).contains(&(1.0 / (step * unit))))
    }

    fn are_of(&self, unit: TimeUnit, is_whole: bool) -> bool {
        let slowest = if self.even { SLOWEST } else { SLOWEST_EVENTS };
        let seconds = unit.seconds();
        if !is_whole {
            return match unit {
                TimeUnit::Seconds => self.is_common(seconds, [SLOWEST_EVENTS, f64::INFINITY]),
                // The median alone: pauses between runs make the mean step of seconds that of common rates in milliseconds.
                _ => (slowest..=FASTEST_FRACTIONS).contains(&(1.0 / (self.median * seconds))),
            };
        }
        // Slow loggers write every so many minutes.
        let minutes = self.median * seconds / 60.0;
        let is_minutes =
            (1.0..=1440.0).contains(&minutes.round()) && (minutes - minutes.round()).abs() < 1e-9 * minutes;
        is_minutes || self.is_common(seconds, [slowest, FASTEST])
    }
}

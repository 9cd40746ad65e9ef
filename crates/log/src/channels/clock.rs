//! A field of the messages as the clock of a log: `/imu.timestamp_sample`.
//!
//! The field of that path in each channel's own messages stamps them, as a header does: what is joined is of one clock.

use fleetfoot_message::{FieldPath, Row};

use super::sample::Sample;
use crate::{TimeUnit, stamp, table::MISSING};

/// The field that is the clock: its place among the wanted fields of every topic in use, and its unit.
pub(super) struct FieldClock {
    pub slots: Vec<Option<usize>>,
    pub unit: TimeUnit,
}

/// Returns true if a column can be a field that is the clock. The seconds of a header's stamp are half a clock: the
/// whole is `stamp = "header"`.
pub(super) fn is_clock(column: &str) -> bool {
    let parts = [".sec", ".nanosec", ".secs", ".nsecs"];
    column.starts_with('/') && !parts.iter().any(|part| column.ends_with(part))
}

/// The stamp of a message whose clock says this.
pub(super) fn stamp_of(value: f64, unit: TimeUnit) -> i64 {
    if value.is_nan() { MISSING } else { stamp::from_f64(value, unit) }
}

/// The unit in which a field goes on as the log's clock does, from some messages; `None` where they tell nothing.
pub(super) fn unit_of(sample: &Sample, field: &FieldPath) -> Option<TimeUnit> {
    let extract = sample.codec.as_ref().ok()?.compile(std::slice::from_ref(field)).ok()?;
    let mut row = Row::new(extract.as_ref());
    let mut read: Vec<(i64, f64)> = Vec::new();
    for message in &sample.messages {
        if extract.extract(&message.data, &mut row).is_ok()
            && let Some(&value) = row.values.first()
            && value.is_finite()
        {
            read.push((message.log_time, value));
        }
    }
    let ((from, first), (to, last)) = (*read.first()?, *read.last()?);
    // Nanoseconds of the log for one of the field's.
    let ratio = (to.checked_sub(from)? as f64 / (last - first)).log10();
    let units = [TimeUnit::Nanoseconds, TimeUnit::Microseconds, TimeUnit::Milliseconds, TimeUnit::Seconds];
    let distance = |unit: &TimeUnit| (ratio - f64::from(unit.exponent())).abs();
    // A simulation may run at another pace than the log's clock, but hardly thirty times as fast or slow.
    units.into_iter().find(|unit| distance(unit) < 1.5)
}

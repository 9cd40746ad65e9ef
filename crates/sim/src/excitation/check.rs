//! Checks that the signals' parameters share.

use crate::ParameterError;
use crate::parameter_error::finite;

pub(super) fn that(
    holds: bool,
    name: &str,
    value: impl std::fmt::Display,
    allowed: impl Into<String>,
) -> Result<(), ParameterError> {
    if holds { Ok(()) } else { Err(ParameterError::new(name, value, allowed)) }
}

/// A frequency that samples every `dt` seconds can show.
pub(super) fn frequency(name: &str, value: f64, dt: f64) -> Result<(), ParameterError> {
    let nyquist = 0.5 / dt;
    that(
        value > 0.0 && value <= nyquist,
        name,
        value,
        format!("above 0 and at most half the sampling rate, {nyquist} Hz"),
    )
}

pub(super) fn band(lowest: f64, highest: f64, dt: f64) -> Result<(), ParameterError> {
    frequency("lowest", lowest, dt)?;
    frequency("highest", highest, dt)?;
    that(lowest < highest, "highest", highest, format!("above lowest, {lowest} Hz"))
}

pub(super) fn interval(low: f64, high: f64) -> Result<(), ParameterError> {
    finite("low", low)?;
    finite("high", high)?;
    that(low < high && (high - low).is_finite(), "high", high, format!("above low, {low}"))
}

/// A time of one sample at least.
pub(super) fn time(name: &str, value: f64, dt: f64) -> Result<(), ParameterError> {
    // A sampling period that was computed may be a rounding error longer than the same time as written.
    that(value >= 0.999 * dt && value.is_finite(), name, value, format!("at least the sampling period, {dt} s"))
}

pub(super) fn hold(shortest: f64, longest: f64, dt: f64) -> Result<(), ParameterError> {
    time("shortest", shortest, dt)?;
    time("longest", longest, dt)?;
    that(shortest <= longest, "longest", longest, format!("at least shortest, {shortest} s"))
}

/// Whole samples in a time, at least 1.
pub(super) fn samples(seconds: f64, dt: f64) -> u64 {
    // The conversion saturates, and is 0 for what is not a number.
    ((seconds / dt).round() as u64).max(1)
}

//! Ranges of parameters.

use std::ops::RangeInclusive;

use crate::ParameterError;

/// A number in a closed range; no number (NaN) is in none.
pub(super) fn within(name: &str, value: f64, allowed: RangeInclusive<f64>) -> Result<(), ParameterError> {
    let words = || format!("between {} and {}", allowed.start(), allowed.end());
    if allowed.contains(&value) { Ok(()) } else { Err(ParameterError::new(name, value, words())) }
}

/// A number above 0, no greater than `most`.
pub(super) fn positive(name: &str, value: f64, most: f64) -> Result<(), ParameterError> {
    let words = || format!("above 0 and at most {most}");
    if value > 0.0 && value <= most { Ok(()) } else { Err(ParameterError::new(name, value, words())) }
}

/// A point in the body's axes, m.
pub(super) fn position(name: &str, value: [f64; 3]) -> Result<(), ParameterError> {
    value.into_iter().zip(0..).try_for_each(|(axis, index)| within(&format!("{name}[{index}]"), axis, -100.0..=100.0))
}

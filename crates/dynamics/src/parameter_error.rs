//! Errors in a parameter of a controller or of a simulated robot.

use std::fmt;

/// A parameter outside of its allowed values.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name} = {value}: must be {allowed}")]
pub struct ParameterError {
    /// Its name, in a world file its path, e.g. `leg.mass`.
    pub name: String,
    /// The given value.
    pub value: String,
    /// The allowed values, in words.
    pub allowed: String,
}

impl ParameterError {
    /// An error about the parameter `name`.
    pub fn new(name: &str, value: impl fmt::Display, allowed: impl Into<String>) -> Self {
        Self { name: name.to_owned(), value: value.to_string(), allowed: allowed.into() }
    }

    /// The same error about a parameter of the table `table`.
    #[must_use]
    pub fn within(mut self, table: &str) -> Self {
        self.name = format!("{table}.{}", self.name);
        self
    }
}

/// Finite and above zero.
///
/// # Errors
/// Names the parameter.
pub fn positive(name: &str, value: f64) -> Result<(), ParameterError> {
    in_range(name, value, f64::MIN_POSITIVE, f64::MAX, "a number above 0")
}

/// Finite and not below zero.
///
/// # Errors
/// Names the parameter.
pub fn not_negative(name: &str, value: f64) -> Result<(), ParameterError> {
    in_range(name, value, 0.0, f64::MAX, "a number, 0 or more")
}

/// Finite.
///
/// # Errors
/// Names the parameter.
pub fn finite(name: &str, value: f64) -> Result<(), ParameterError> {
    in_range(name, value, f64::MIN, f64::MAX, "a finite number")
}

/// Checks that a value is from `least` to `most`; `allowed` says so in words.
///
/// # Errors
/// Names the parameter.
pub fn in_range(name: &str, value: f64, least: f64, most: f64, allowed: &str) -> Result<(), ParameterError> {
    if (least..=most).contains(&value) { Ok(()) } else { Err(ParameterError::new(name, value, allowed)) }
}

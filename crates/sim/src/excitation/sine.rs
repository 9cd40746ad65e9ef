//! A sine.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::check::frequency;
use crate::ParameterError;
use crate::parameter_error::{finite, not_negative};

/// `offset + amplitude sin(2 pi frequency t + phase)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sine {
    /// Mean, in the channel's unit.
    pub offset: f64,
    /// In the channel's unit.
    pub amplitude: f64,
    /// Hz
    pub frequency: f64,
    /// At the start, rad.
    pub phase: f64,
}

impl Default for Sine {
    fn default() -> Self {
        Self { offset: 0.0, amplitude: 1.0, frequency: 0.5, phase: 0.0 }
    }
}

impl Sine {
    pub(super) fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        finite("offset", self.offset)?;
        not_negative("amplitude", self.amplitude)?;
        frequency("frequency", self.frequency, dt)?;
        finite("phase", self.phase)
    }

    /// The value at time `t`, s.
    pub fn value(&self, t: f64) -> f64 {
        // Whole turns are taken off first: the sine of a large angle would lose digits.
        self.offset + self.amplitude * ((self.frequency * t).fract() * TAU + self.phase).sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_has_level_frequency_and_phase() {
        let sine = Sine { offset: 0.2, amplitude: 3.0, frequency: 4.0, phase: 0.5 };
        assert!((sine.value(0.0) - (0.2 + 3.0 * 0.5f64.sin())).abs() < 1e-15);
        assert!((sine.value(1.0 / 16.0) - (0.2 + 3.0 * 0.5f64.cos())).abs() < 1e-12);
        assert!((sine.value(1e6 + 0.3) - sine.value(0.3)).abs() < 1e-7);
    }
}

//! The belt under the robot.

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::parameter_error::{in_range, not_negative, positive};
use crate::{OrnsteinUhlenbeck, ParameterError};

/// A treadmill's belt, after II-B.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BeltParameters {
    /// Commanded speed, backward, m/s.
    pub speed: f64,
    /// Along x, m; the robot's place is counted from the middle.
    pub length: f64,
    /// Along y, m.
    pub width: f64,
    /// Standard deviation of the belt's speed about the commanded one, m/s.
    pub noise: f64,
    /// Correlation time of that, s.
    pub noise_time: f64,
    /// Time to come up to speed from standing, s.
    pub ramp: f64,
}

impl Default for BeltParameters {
    /// The paper's belt and its largest deviation; it does not say how quick the deviation is.
    fn default() -> Self {
        Self { speed: 0.25, length: 0.5, width: 0.3, noise: 0.023, noise_time: 2.0, ramp: 1.0 }
    }
}

impl BeltParameters {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        in_range("speed", self.speed, 0.0, 10.0, "from 0 to 10 m/s")?;
        positive("length", self.length)?;
        positive("width", self.width)?;
        not_negative("noise", self.noise)?;
        positive("noise_time", self.noise_time)?;
        not_negative("ramp", self.ramp)
    }
}

/// The belt's speed in time.
pub(super) struct Belt {
    speed: f64,
    ramp: f64,
    noise: OrnsteinUhlenbeck,
    random: Pcg64,
}

impl Belt {
    /// A belt that is asked for its speed every `period` seconds.
    pub(super) fn new(parameters: &BeltParameters, period: f64, mut random: Pcg64) -> Self {
        let noise = OrnsteinUhlenbeck::new(parameters.noise, parameters.noise_time, period, &mut random);
        Self { speed: parameters.speed, ramp: parameters.ramp, noise, random }
    }

    /// Commanded speed `seconds` after switching on, m/s.
    pub(super) fn commanded(&self, seconds: f64) -> f64 {
        if seconds < self.ramp { self.speed * seconds / self.ramp } else { self.speed }
    }

    /// Speed of the belt, m/s.
    pub(super) fn next(&mut self, seconds: f64) -> f64 {
        // A standing motor has no speed error.
        let share = if self.speed > 0.0 { self.commanded(seconds) / self.speed } else { 0.0 };
        self.commanded(seconds) + share * self.noise.next(&mut self.random)
    }
}

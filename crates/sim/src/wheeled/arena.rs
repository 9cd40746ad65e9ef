//! The room that the robot drives in.

use serde::{Deserialize, Serialize};

use crate::ParameterError;
use crate::parameter_error::{in_range, not_negative, positive};

/// A rectangle of floor about the origin with four walls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Arena {
    /// Inside, along x, m.
    pub length: f64,
    /// Inside, along y, m.
    pub width: f64,
    /// Of the walls, m.
    pub height: f64,
    /// True for an arena with walls: without them the floor is endless, and references avoid nothing.
    pub walls: bool,
    /// Share of the free floor that runs start in, from 0: in the middle, heading along x, to 1: anywhere, heading
    /// anywhere.
    pub scatter: f64,
}

/// Of the walls, m: much more than the robot moves in a step.
pub(super) const THICKNESS: f64 = 0.2;

impl Default for Arena {
    fn default() -> Self {
        Self { length: 4.0, width: 4.0, height: 0.2, walls: true, scatter: 0.5 }
    }
}

impl Arena {
    /// Checks every value for a robot of this radius, m.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self, radius: f64) -> Result<(), ParameterError> {
        for (name, value) in [("length", self.length), ("width", self.width)] {
            in_range(name, value, 3.0 * radius, 1e4, &format!("from {}, 1.5 robots, to 10000", 3.0 * radius))?;
        }
        positive("height", self.height)?;
        not_negative("scatter", self.scatter)?;
        in_range("scatter", self.scatter, 0.0, 1.0, "from 0 to 1")
    }

    /// Half of the free floor along x and y for the middle of a robot that keeps `distance` from the walls, m.
    pub(super) fn free(&self, distance: f64) -> [f64; 2] {
        [self.length, self.width].map(|side| (0.5 * side - distance).max(0.0))
    }
}

//! References that do not drive into walls.

use serde::{Deserialize, Serialize};

use crate::ParameterError;
use crate::parameter_error::{in_range, not_negative, positive};

/// Collision avoidance by the procedure of Towards Sim-to-Real via Real-to-Sim, section 4.2: (1) check whether the reference
/// velocity leads out of a bounding box; (2) if so, reverse it; (3) if that fails, reduce it by a fixed share until the check passes.
///
/// It departs from the paper in two ways. The paper's robot moves in any direction and so has a reversal for each axis.
/// This robot is round and turns on the spot: it leaves the box by its forward velocity alone, which is reversed and
/// reduced. The check looks further than one period of the references, as a robot with inertia needs its stopping time.
/// A robot that has come out of the box nevertheless may move inwards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Avoidance {
    /// True if references are checked at all.
    pub enabled: bool,
    /// Time over which the check follows the reference, s.
    pub lookahead: f64,
    /// Of the bounding box from the robot's shell at the walls, m.
    pub margin: f64,
    /// Share of the velocity that a reduction takes away, 1.
    pub reduction: f64,
    /// Reductions after which the velocity is 0.
    pub reductions: u32,
}

impl Default for Avoidance {
    fn default() -> Self {
        Self { enabled: true, lookahead: 0.4, margin: 0.15, reduction: 0.3, reductions: 10 }
    }
}

impl Avoidance {
    /// Checks every value.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        positive("lookahead", self.lookahead)?;
        not_negative("margin", self.margin)?;
        in_range("reduction", self.reduction, 0.01, 1.0, "from 0.01 to 1")?;
        in_range("reductions", f64::from(self.reductions), 0.0, 1000.0, "0 to 1000")
    }
}

/// Pose in the plane: x and y in m, yaw in rad.
pub(super) type Pose2 = [f64; 3];

/// The avoidance along a run. A reversal stays until the reference draws another level or changes its sign: taken back at
/// the next check it would hold the robot at the wall.
#[derive(Debug, Clone)]
pub struct AvoidanceState {
    parameters: Avoidance,
    /// Half of the box along x and y, m.
    half: [f64; 2],
    reversed: bool,
    sign: f64,
    levels: u64,
    reversals: u64,
}

impl AvoidanceState {
    /// In a box about the origin, half of it as given, m. The parameters have passed [`Avoidance::validate`].
    pub fn new(parameters: &Avoidance, half: [f64; 2]) -> Self {
        Self { parameters: parameters.clone(), half, reversed: false, sign: 0.0, levels: 0, reversals: 0 }
    }

    /// The forward velocity that replaces the reference `velocity` (m/s), with the yaw rate `turn` (rad/s), at a pose `[x, y, yaw]` (m,
    /// rad). `levels` counts the levels that the reference's signal has drawn so far.
    pub fn command(&mut self, velocity: f64, turn: f64, levels: u64, pose: [f64; 3]) -> f64 {
        if !self.parameters.enabled {
            return velocity;
        }
        let sign = if velocity == 0.0 { 0.0 } else { velocity.signum() };
        if levels != self.levels || sign != self.sign {
            self.reversed = false;
        }
        (self.levels, self.sign) = (levels, sign);
        let mut command = if self.reversed { -velocity } else { velocity };
        // Step 1.
        if !self.collides(command, turn, pose) {
            return command;
        }
        // Step 2.
        if !self.collides(-command, turn, pose) {
            self.reversed = !self.reversed;
            self.reversals += 1;
            return -command;
        }
        // Step 3.
        for _ in 0..self.parameters.reductions {
            command *= 1.0 - self.parameters.reduction;
            if !self.collides(command, turn, pose) {
                return command;
            }
        }
        0.0
    }

    /// Number of references that were reversed.
    pub fn reversals(&self) -> u64 {
        self.reversals
    }

    /// Returns true if a velocity leads out of the box, or further out.
    fn collides(&self, velocity: f64, turn: f64, pose: Pose2) -> bool {
        let next = arc(pose, velocity, turn, self.parameters.lookahead);
        let outside = |pose: Pose2, axis: usize| (pose[axis].abs() - self.half[axis]).max(0.0);
        (0..2).any(|axis| outside(next, axis) > outside(pose, axis))
    }
}

/// The pose after moving with a constant velocity (m/s) and yaw rate (rad/s).
pub(super) fn arc([x, y, yaw]: Pose2, velocity: f64, turn: f64, seconds: f64) -> Pose2 {
    let half = 0.5 * turn * seconds;
    // The chord of an arc over its length.
    let share = if half.abs() < 1e-6 { 1.0 - half * half / 6.0 } else { half.sin() / half };
    let way = velocity * seconds * share;
    [x + way * (yaw + half).cos(), y + way * (yaw + half).sin(), yaw + 2.0 * half]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn state() -> AvoidanceState {
        AvoidanceState::new(&Avoidance { lookahead: 0.5, ..Avoidance::default() }, [1.0, 2.0])
    }

    #[test]
    fn arcs_end_where_circles_do() {
        let [x, y, yaw] = arc([1.0, 2.0, 0.0], 0.5, 0.25, FRAC_PI_2 / 0.25);
        assert!((x - 3.0).abs() < 1e-12 && (y - 4.0).abs() < 1e-12 && (yaw - FRAC_PI_2).abs() < 1e-12);
        assert_eq!(arc([0.0, 0.0, 0.0], 2.0, 0.0, 3.0), [6.0, 0.0, 0.0]);
    }

    #[test]
    fn references_pass_are_reversed_or_reduced() {
        let mut free = state();
        assert_eq!(free.command(1.0, 0.0, 1, [0.0, 0.0, 0.0]), 1.0);
        // 0.4 m before the side of the box, 0.5 m ahead.
        assert_eq!(free.command(1.0, 0.0, 1, [0.6, 0.0, 0.0]), -1.0);
        // Stays reversed until another level is drawn.
        assert_eq!(free.command(1.0, 0.0, 1, [0.2, 0.0, 0.0]), -1.0);
        assert_eq!(free.command(1.0, 0.0, 2, [0.2, 0.0, 0.0]), 1.0);
        assert_eq!(free.command(1.0, 0.0, 2, [0.6, 0.0, PI]), 1.0);
        assert_eq!(free.reversals(), 1);
        // In a box that is too narrow either way: 0.7^k 0.5 <= 0.2 from k = 3 on.
        let mut narrow = AvoidanceState::new(&Avoidance { lookahead: 0.5, ..Avoidance::default() }, [0.2, 2.0]);
        assert!((narrow.command(1.0, 0.0, 1, [0.0, 0.0, 0.0]) - 0.343).abs() < 1e-12);
        let mut closed = AvoidanceState::new(&Avoidance::default(), [0.0, 0.0]);
        assert_eq!(closed.command(1.0, 0.0, 1, [0.0, 0.0, 0.3]), 0.0);
    }

    #[test]
    fn a_robot_outside_of_the_box_may_come_back() {
        let mut outside = state();
        assert_eq!(outside.command(0.4, 0.0, 1, [1.3, 0.0, PI]), 0.4);
        assert_eq!(outside.command(0.4, 0.0, 2, [1.3, 0.0, 0.0]), -0.4);
    }
}

//! State of a wheeled robot.

use glam::{DQuat, DVec3};

/// Pose and velocity of `base_link` (the middle of the axle) in the world's axes, and the wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheeledState {
    /// m
    pub position: DVec3,
    /// Body to world.
    pub orientation: DQuat,
    /// m/s
    pub linear_velocity: DVec3,
    /// rad/s
    pub angular_velocity: DVec3,
    /// Left and right, positive forward, counted over whole turns, rad.
    pub wheel_angle: [f64; 2],
    /// Left and right, against the chassis, rad/s.
    pub wheel_rate: [f64; 2],
}

impl WheeledState {
    /// Of the heading, in (-pi, pi], rad.
    pub fn yaw(&self) -> f64 {
        let forward = self.orientation * DVec3::X;
        forward.y.atan2(forward.x)
    }

    /// `[forward, left]` over the floor, in the axes of the heading, m/s: with the yaw they give the position's rates exactly, however the
    /// robot pitches.
    pub fn planar_velocity(&self) -> [f64; 2] {
        let (sine, cosine) = self.yaw().sin_cos();
        let DVec3 { x, y, .. } = self.linear_velocity;
        [cosine * x + sine * y, cosine * y - sine * x]
    }

    /// Of the heading, rad/s: what pitch and roll make of it is left out, which is nothing for a robot that stands level.
    pub fn yaw_rate(&self) -> f64 {
        self.angular_velocity.z
    }

    /// Between the robot's and the world's upward direction, rad.
    pub fn tilt(&self) -> f64 {
        (self.orientation * DVec3::Z).z.clamp(-1.0, 1.0).acos()
    }

    /// Velocity of the left and the right tyre over the floor, forward, m/s: 0 when it rolls. Level robots.
    pub fn slip(&self, radius: f64, track: f64) -> [f64; 2] {
        let [forward, _] = self.planar_velocity();
        let turn = 0.5 * track * self.yaw_rate();
        [forward - turn - radius * self.wheel_rate[0], forward + turn - radius * self.wheel_rate[1]]
    }

    /// Returns true if every number is finite.
    pub fn is_finite(&self) -> bool {
        let wheels = self.wheel_angle.iter().chain(&self.wheel_rate).all(|value| value.is_finite());
        let body = self.position.is_finite() && self.orientation.is_finite();
        wheels && body && self.linear_velocity.is_finite() && self.angular_velocity.is_finite()
    }
}

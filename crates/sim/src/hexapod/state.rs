//! What moves in a hexapod.

use glam::{DQuat, DVec3};

/// The trunk's and the cranks' position and velocity: the paper's 16 states (equations (3) and (4)), in the world's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HexapodState {
    /// Of the trunk's middle, m.
    pub position: DVec3,
    /// Trunk to world.
    pub orientation: DQuat,
    /// Of the trunk's middle in the world, m/s.
    pub linear_velocity: DVec3,
    /// In the world, rad/s.
    pub angular_velocity: DVec3,
    /// Left and right, continuous, not wrapped, rad.
    pub crank_angle: [f64; 2],
    /// Left and right, rad/s.
    pub crank_rate: [f64; 2],
}

impl HexapodState {
    /// Intrinsic Z-Y'-X'' angles, rad: yaw and roll in (-pi, pi], pitch (nose down positive, z being up) in [-pi/2, pi/2].
    pub fn yaw_pitch_roll(&self) -> [f64; 3] {
        let DQuat { x, y, z, w } = self.orientation;
        let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
        let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
        let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
        [yaw, pitch, roll]
    }

    /// Velocity of the trunk's middle in the trunk's axes, m/s.
    pub fn body_linear_velocity(&self) -> DVec3 {
        self.orientation.conjugate() * self.linear_velocity
    }

    /// In the trunk's axes, rad/s.
    pub fn body_angular_velocity(&self) -> DVec3 {
        self.orientation.conjugate() * self.angular_velocity
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let cranks = self.crank_angle.iter().chain(&self.crank_rate).all(|v| v.is_finite());
        let body = self.position.is_finite() && self.orientation.is_finite();
        cranks && body && self.linear_velocity.is_finite() && self.angular_velocity.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::EulerRot;

    #[test]
    fn angles_give_the_orientation_back() {
        for (yaw, pitch, roll) in [(0.3, -0.2, 0.1), (-3.0, 1.2, 2.5), (1.5, 0.0, -3.1)] {
            let orientation = DQuat::from_euler(EulerRot::ZYX, yaw, pitch, roll);
            let state = HexapodState {
                position: DVec3::ZERO,
                orientation,
                linear_velocity: orientation * DVec3::new(1.0, 2.0, 3.0),
                angular_velocity: DVec3::ZERO,
                crank_angle: [0.0; 2],
                crank_rate: [0.0; 2],
            };
            let got = state.yaw_pitch_roll();
            assert!((got[0] - yaw).abs() + (got[1] - pitch).abs() + (got[2] - roll).abs() < 1e-12, "{got:?}");
            assert!((state.body_linear_velocity() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-14);
        }
    }
}

//! State of a hexapod.

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

    /// The same with the velocities of the instant at which the body is where it is. Semi-implicit steps have velocities that belong to the middle between two poses (a leapfrog): `self` came by the
    /// one before its pose, `after`, the state one step later, by the one behind it, and at the pose the velocity is their mean.
    pub fn with_velocities_of_its_instant(&self, after: &Self) -> Self {
        let mean = |before: f64, after: f64| 0.5 * (before + after);
        Self {
            linear_velocity: 0.5 * (self.linear_velocity + after.linear_velocity),
            angular_velocity: 0.5 * (self.angular_velocity + after.angular_velocity),
            crank_rate: [0, 1].map(|side| mean(self.crank_rate[side], after.crank_rate[side])),
            ..*self
        }
    }

    /// Rates of change of [`HexapodState::body_linear_velocity`], [`HexapodState::body_angular_velocity`] and the
    /// cranks' rates at this instant, m/s^2 and rad/s^2. They are the change over the step of `step` seconds whose
    /// middle has the pose. `after` is the state one step later.
    pub fn rates_at_its_instant(&self, after: &Self, step: f64) -> [f64; 8] {
        let now = self.with_velocities_of_its_instant(after);
        let in_body = |before: DVec3, after: DVec3| self.orientation.conjugate() * ((after - before) / step);
        // The trunk's axes turn: a velocity that stays in the world changes in them. With the angular velocity itself they do not move it.
        let turning = now.body_angular_velocity().cross(now.body_linear_velocity());
        let linear = in_body(self.linear_velocity, after.linear_velocity) - turning;
        let angular = in_body(self.angular_velocity, after.angular_velocity);
        let crank = |side: usize| (after.crank_rate[side] - self.crank_rate[side]) / step;
        [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z, crank(0), crank(1)]
    }

    /// Velocity of the trunk's middle in the trunk's axes, m/s.
    pub fn body_linear_velocity(&self) -> DVec3 {
        self.orientation.conjugate() * self.linear_velocity
    }

    /// In the trunk's axes, rad/s.
    pub fn body_angular_velocity(&self) -> DVec3 {
        self.orientation.conjugate() * self.angular_velocity
    }

    /// Returns true if every number is finite.
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

    /// A body on a circle whose rates are known at every instant, and leapfrog velocities of it: velocities and rates of the pose's instant are right to the square of the step, those of the
    /// step before it to the step alone.
    #[test]
    fn velocities_and_rates_belong_to_the_pose() {
        let (step, turn, growth) = (1e-3, 2.0, 3.0);
        // Yaw turn t + growth t^2 / 2, forward speed 0.5 + t in the body's axes, cranks with sin(5 t).
        let yaw = |t: f64| turn * t + 0.5 * growth * t * t;
        let velocity = |t: f64| DQuat::from_rotation_z(yaw(t)) * DVec3::new(0.5 + t, 0.0, 0.0);
        let state = |t: f64| HexapodState {
            position: DVec3::ZERO,
            orientation: DQuat::from_rotation_z(yaw(t)),
            linear_velocity: velocity(t - 0.5 * step),
            angular_velocity: DVec3::new(0.0, 0.0, turn + growth * (t - 0.5 * step)),
            crank_angle: [0.0; 2],
            crank_rate: [(5.0 * (t - 0.5 * step)).sin(), 1.0],
        };
        for instant in [0.1, 0.7, 1.3] {
            let (before, after) = (state(instant), state(instant + step));
            let now = before.with_velocities_of_its_instant(&after);
            let expected = DVec3::new(0.5 + instant, 0.0, 0.0);
            assert!((now.body_linear_velocity() - expected).length() < 2e-5);
            assert!((before.body_linear_velocity() - expected).length() > 4e-4);
            assert!((now.body_angular_velocity().z - turn - growth * instant).abs() < 1e-12);
            assert!((now.crank_rate[0] - (5.0 * instant).sin()).abs() < 1e-5);
            let rates = before.rates_at_its_instant(&after, step);
            let truth = [1.0, 0.0, 0.0, 0.0, 0.0, growth, 5.0 * (5.0 * instant).cos(), 0.0];
            let worst = rates.iter().zip(truth).map(|(rate, truth)| (rate - truth).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-4, "{rates:?}");
        }
    }

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

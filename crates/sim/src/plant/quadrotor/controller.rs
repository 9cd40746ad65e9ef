//! Tracking control: position, attitude, rotors.

use glam::{DMat3, DVec3, DVec4};
use serde::{Deserialize, Serialize};

use super::airframe::{Airframe, QuadrotorState};
use super::reference::Target;
use crate::parameter_error::{ParameterError, in_range};
use crate::plant::atmosphere::GRAVITY;

/// Gains of the tracking controller: geometric tracking on SE(3) after Lee, Leok and McClamroch (CDC 2010), with an
/// integral of the position error against steady wind. It knows the true state: a filter's errors are small beside the
/// wind's work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tracking {
    /// Acceleration for an error of position, 1/s^2.
    pub position_gain: f64,
    /// For an error of velocity, 1/s.
    pub velocity_gain: f64,
    /// For the integral of the position error, 1/s^3.
    pub integral_gain: f64,
    /// The most acceleration that the integral asks for, m/s^2.
    pub integral_most: f64,
    /// Angular acceleration for an error of attitude, 1/s^2.
    pub attitude_gain: f64,
    /// For an error of the angular rate, 1/s.
    pub rate_gain: f64,
    /// The same about the vertical axis, 1/s^2.
    pub yaw_gain: f64,
    /// The same about the vertical axis, 1/s.
    pub yaw_rate_gain: f64,
    /// The most inclination that it asks for, rad.
    pub tilt_most: f64,
}

impl Default for Tracking {
    fn default() -> Self {
        Self {
            position_gain: 2.5,
            velocity_gain: 2.6,
            integral_gain: 0.6,
            integral_most: 6.0,
            attitude_gain: 45.0,
            rate_gain: 10.0,
            yaw_gain: 6.0,
            yaw_rate_gain: 4.0,
            tilt_most: 0.8,
        }
    }
}

impl Tracking {
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        for (name, value) in [
            ("position_gain", self.position_gain),
            ("velocity_gain", self.velocity_gain),
            ("integral_gain", self.integral_gain),
            ("integral_most", self.integral_most),
            ("attitude_gain", self.attitude_gain),
            ("rate_gain", self.rate_gain),
            ("yaw_gain", self.yaw_gain),
            ("yaw_rate_gain", self.yaw_rate_gain),
        ] {
            in_range(name, value, 0.0, 1e4, "from 0 to 10000")?;
        }
        in_range("tilt_most", self.tilt_most, 0.01, 1.4, "from 0.01 to 1.4 rad")
    }
}

/// The controller at work.
pub(super) struct Controller<'a> {
    gains: &'a Tracking,
    airframe: &'a Airframe,
    /// Of the position error, m s.
    integral: DVec3,
    period: f64,
}

impl<'a> Controller<'a> {
    pub(super) fn new(gains: &'a Tracking, airframe: &'a Airframe, period: f64) -> Self {
        Self { gains, airframe, integral: DVec3::ZERO, period }
    }

    /// Commands to the rotors, 0 to 1, until the next period.
    pub(super) fn command(&mut self, state: &QuadrotorState, target: &Target) -> DVec4 {
        let force = self.force(state, target);
        let rotation = DMat3::from_quat(state.orientation);
        let thrust = force.dot(rotation.z_axis);
        let torque = self.torque(state, force);
        self.mix(thrust, torque)
    }

    /// The force asked of the rotors, in the world's axes, N.
    fn force(&mut self, state: &QuadrotorState, target: &Target) -> DVec3 {
        let gains = self.gains;
        let error = target.position - state.position;
        if gains.integral_gain > 0.0 {
            let most = gains.integral_most / gains.integral_gain;
            self.integral = (self.integral + error * self.period).clamp(DVec3::splat(-most), DVec3::splat(most));
        }
        let mut acceleration = target.acceleration
            + gains.position_gain * error
            + gains.velocity_gain * (target.velocity - state.velocity)
            + gains.integral_gain * self.integral
            + DVec3::new(0.0, 0.0, GRAVITY);
        acceleration.z = acceleration.z.max(0.3 * GRAVITY);
        let level = acceleration.truncate().clamp_length_max(acceleration.z * gains.tilt_most.tan());
        self.airframe.mass * level.extend(acceleration.z)
    }

    /// The torque that turns the body's z axis into the force and its x axis to the world's, in the body's axes, N m.
    fn torque(&self, state: &QuadrotorState, force: DVec3) -> DVec3 {
        let gains = self.gains;
        let up = force.normalize();
        // The inclination is limited, so that `up` is never along x.
        let left = up.cross(DVec3::X).normalize();
        let wanted = DMat3::from_cols(left.cross(up), left, up);
        let rotation = DMat3::from_quat(state.orientation);
        let skew = wanted.transpose() * rotation;
        let skew = skew - skew.transpose();
        let error = 0.5 * DVec3::new(skew.y_axis.z, skew.z_axis.x, skew.x_axis.y);
        let rate = state.angular_velocity;
        let level = -gains.attitude_gain * error - gains.rate_gain * rate;
        let yaw = -gains.yaw_gain * error.z - gains.yaw_rate_gain * rate.z;
        let inertia = DVec3::from_array(self.airframe.inertia);
        inertia * DVec3::new(level.x, level.y, yaw) + rate.cross(inertia * rate)
    }

    /// Rotor commands for a thrust and a torque. Where a rotor cannot, the torque about z gives way first, then the
    /// thrust.
    fn mix(&self, thrust: f64, torque: DVec3) -> DVec4 {
        let airframe = self.airframe;
        let most = airframe.rotor_thrust();
        let lever = 4.0 * airframe.lever();
        let turn = 4.0 * airframe.moment_coefficient / airframe.thrust_coefficient;
        let collective = (thrust / 4.0).clamp(0.1 * most, 0.9 * most);
        let yaw = (torque.z / turn).clamp(-0.1 * most, 0.1 * most);
        DVec4::from_array(Airframe::ROTORS.map(|[x, y, spin]| {
            let share = collective + y * torque.x / lever - x * torque.y / lever + spin * yaw;
            (share.clamp(0.0, most) / most).sqrt()
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rotors' forces at the speeds that a command holds are what was asked for.
    #[test]
    fn the_mixer_inverts_the_airframe() {
        let (gains, airframe) = (Tracking::default(), Airframe::default());
        let controller = Controller::new(&gains, &airframe, 0.002);
        let (thrust, torque) = (0.3, DVec3::new(4e-4, -3e-4, 2e-4));
        let mut state = QuadrotorState::at(DVec3::ZERO);
        state.rotors = controller.mix(thrust, torque) * airframe.rotor_speed;
        let loads = airframe.loads(&state, DVec3::ZERO);
        assert!((loads.thrust - thrust).abs() < 1e-14);
        assert!(loads.torque.distance(torque) < 1e-16, "{}", loads.torque);
    }

    #[test]
    fn controller_at_target_commands_hover() {
        let (gains, airframe) = (Tracking::default(), Airframe::default());
        let state = QuadrotorState::at(DVec3::new(1.0, 2.0, 3.0));
        let target = Target { position: state.position, velocity: DVec3::ZERO, acceleration: DVec3::ZERO };
        let command = Controller::new(&gains, &airframe, 0.002).command(&state, &target);
        let hover = airframe.hover_speed() / airframe.rotor_speed;
        assert!((command - DVec4::splat(hover)).abs().max_element() < 1e-14, "{command}");
    }
}

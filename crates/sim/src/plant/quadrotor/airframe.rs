//! The rigid body with four rotors.

use glam::{DQuat, DVec3, DVec4};
use serde::{Deserialize, Serialize};

use crate::parameter_error::{ParameterError, in_range, not_negative, positive};
use crate::plant::atmosphere::GRAVITY;

/// A quadrotor in X configuration, x forward, y left, z up. Rotors: front right, back right, back left, front left; the
/// first and the third turn counterclockwise seen from above.
///
/// The default is the Crazyflie 2.x: mass, inertia, arm, rotor coefficients and largest speed as in the models of
/// gym-pybullet-drones (after Landry, MIT 2015, and Förster, ETH 2015, whose rotor drag it takes), the rotors' lag as
/// published system identification from flight logs finds it (Eschmann et al. 2024). The drag areas are estimated from
/// the dimensions (92 x 92 x 29 mm, mostly open); there is no published value. Not modelled: blade flapping, gyroscopic
/// moments of the rotors, ground effect, the battery.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Airframe {
    /// kg
    pub mass: f64,
    /// About the body's axes, kg m^2.
    pub inertia: [f64; 3],
    /// From the centre to a rotor, m.
    pub arm: f64,
    /// Thrust of a rotor over its speed squared, N s^2/rad^2.
    pub thrust_coefficient: f64,
    /// Drag moment of a rotor over its speed squared, N m s^2/rad^2.
    pub moment_coefficient: f64,
    /// Drag of a rotor over its speed and the speed of the air along each axis, N s^2/(m rad).
    pub rotor_drag: [f64; 3],
    /// Drag coefficient times area of the body along each axis, m^2.
    pub drag_area: [f64; 3],
    /// Rotor speed at full command, rad/s.
    pub rotor_speed: f64,
    /// Time constant of the rotors, s.
    pub rotor_lag: f64,
    /// Density of the air, kg/m^3.
    pub air_density: f64,
}

impl Default for Airframe {
    fn default() -> Self {
        Self {
            mass: 0.027,
            inertia: [1.4e-5, 1.4e-5, 2.17e-5],
            arm: 0.0397,
            thrust_coefficient: 2.88e-8,
            moment_coefficient: 7.24e-10,
            rotor_drag: [9.18e-7, 9.18e-7, 10.31e-7],
            drag_area: [0.0028, 0.0028, 0.0060],
            rotor_speed: 2_270.0,
            rotor_lag: 0.07,
            air_density: 1.2,
        }
    }
}

/// Position and motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuadrotorState {
    /// m
    pub position: DVec3,
    /// In the world's axes, m/s.
    pub velocity: DVec3,
    /// Body to world.
    pub orientation: DQuat,
    /// In the body's axes, rad/s.
    pub angular_velocity: DVec3,
    /// rad/s
    pub rotors: DVec4,
}

/// Numbers of a [`QuadrotorState`].
pub(super) const STATES: usize = 17;

impl QuadrotorState {
    /// At rest with its rotors stopped.
    pub fn at(position: DVec3) -> Self {
        Self {
            position,
            velocity: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            angular_velocity: DVec3::ZERO,
            rotors: DVec4::ZERO,
        }
    }

    pub(super) fn to_array(self) -> [f64; STATES] {
        let mut x = [0.0; STATES];
        x[..3].copy_from_slice(&self.position.to_array());
        x[3..6].copy_from_slice(&self.velocity.to_array());
        x[6..10].copy_from_slice(&self.orientation.to_array());
        x[10..13].copy_from_slice(&self.angular_velocity.to_array());
        x[13..].copy_from_slice(&self.rotors.to_array());
        x
    }

    pub(super) fn from_array(x: &[f64; STATES]) -> Self {
        Self {
            position: DVec3::from_slice(&x[..3]),
            velocity: DVec3::from_slice(&x[3..6]),
            orientation: DQuat::from_slice(&x[6..10]),
            angular_velocity: DVec3::from_slice(&x[10..13]),
            rotors: DVec4::from_slice(&x[13..]),
        }
    }
}

/// Forces and torques on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loads {
    /// Sum of the rotors' thrusts along the body's z axis, N.
    pub thrust: f64,
    /// Force of the air on rotors and body beside the thrust, in the world's axes, N. It is f_a of the Neural-Fly model
    /// m v' = m g + R f_u + f_a.
    pub air: DVec3,
    /// In the body's axes, N m.
    pub torque: DVec3,
}

impl Airframe {
    /// Signs of a rotor's (x, y) and of the moment that its drag puts on the body about z.
    pub(super) const ROTORS: [[f64; 3]; 4] = [[1.0, -1.0, -1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]];

    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        positive("mass", self.mass)?;
        for axis in 0..3 {
            positive(&format!("inertia[{axis}]"), self.inertia[axis])?;
            not_negative(&format!("rotor_drag[{axis}]"), self.rotor_drag[axis])?;
            not_negative(&format!("drag_area[{axis}]"), self.drag_area[axis])?;
        }
        let [x, y, z] = self.inertia;
        if x + y < z || y + z < x || z + x < y {
            let allowed = "such that the sum of any two is at least the third, as for every body";
            return Err(ParameterError::new("inertia", format!("{:?}", self.inertia), allowed));
        }
        positive("arm", self.arm)?;
        positive("thrust_coefficient", self.thrust_coefficient)?;
        positive("moment_coefficient", self.moment_coefficient)?;
        positive("rotor_speed", self.rotor_speed)?;
        in_range("rotor_lag", self.rotor_lag, 0.005, 1.0, "from 0.005 to 1 s")?;
        in_range("air_density", self.air_density, 0.0, 10.0, "from 0 to 10 kg/m^3")?;
        let share = self.hover_speed() / self.rotor_speed;
        let allowed = format!("at least {:.0}: it hovers at {:.0}", self.hover_speed() / 0.9, self.hover_speed());
        if share > 0.9 { Err(ParameterError::new("rotor_speed", self.rotor_speed, allowed)) } else { Ok(()) }
    }

    /// Rotor speed at which the thrust is the weight, rad/s.
    pub fn hover_speed(&self) -> f64 {
        (self.mass * GRAVITY / (4.0 * self.thrust_coefficient)).sqrt()
    }

    /// Thrust of one rotor at full command, N.
    pub fn rotor_thrust(&self) -> f64 {
        self.thrust_coefficient * self.rotor_speed * self.rotor_speed
    }

    /// Distance of a rotor from the axes, m.
    pub(super) fn lever(&self) -> f64 {
        self.arm * std::f64::consts::FRAC_1_SQRT_2
    }

    /// Forces and torques on the body in this wind (world's axes, m/s).
    ///
    /// A rotor at r turning at w gives the thrust c w^2 along z and the moment of its drag. In air of relative speed
    /// u_r it also gives the force -w K u_r, with K diagonal (rotor drag). The body gives -rho/2 |u| A u, with A
    /// diagonal.
    pub fn loads(&self, state: &QuadrotorState, wind: DVec3) -> Loads {
        let to_body = state.orientation.conjugate();
        let airspeed = to_body * (state.velocity - wind);
        let rotor_drag = DVec3::from_array(self.rotor_drag);
        let lever = self.lever();
        let (mut thrust, mut torque) = (0.0, DVec3::ZERO);
        let mut air = -0.5 * self.air_density * airspeed.length() * DVec3::from_array(self.drag_area) * airspeed;
        for ([x, y, spin], speed) in Self::ROTORS.into_iter().zip(state.rotors.to_array()) {
            let place = DVec3::new(x * lever, y * lever, 0.0);
            let lift = self.thrust_coefficient * speed * speed;
            let drag = -speed * rotor_drag * (airspeed + state.angular_velocity.cross(place));
            thrust += lift;
            air += drag;
            torque += place.cross(drag + DVec3::new(0.0, 0.0, lift));
            torque.z += spin * self.moment_coefficient * speed * speed;
        }
        Loads { thrust, air: state.orientation * air, torque }
    }

    /// Acceleration of the centre of mass in the world's axes, m/s^2.
    pub fn acceleration(&self, state: &QuadrotorState, loads: &Loads) -> DVec3 {
        let force = state.orientation * DVec3::new(0.0, 0.0, loads.thrust) + loads.air;
        force / self.mass - DVec3::new(0.0, 0.0, GRAVITY)
    }

    /// Angular acceleration in the body's axes, rad/s^2: Euler's equations.
    pub fn angular_acceleration(&self, state: &QuadrotorState, loads: &Loads) -> DVec3 {
        let inertia = DVec3::from_array(self.inertia);
        (loads.torque - state.angular_velocity.cross(inertia * state.angular_velocity)) / inertia
    }

    /// The derivative of the state, for held commands (0 to 1, share of the full rotor speed) and wind.
    pub(super) fn derivative(&self, x: &[f64; STATES], command: DVec4, wind: DVec3) -> [f64; STATES] {
        let state = QuadrotorState::from_array(x);
        let loads = self.loads(&state, wind);
        let rate = state.angular_velocity;
        let spin = state.orientation * DQuat::from_xyzw(rate.x, rate.y, rate.z, 0.0) * 0.5;
        QuadrotorState {
            position: state.velocity,
            velocity: self.acceleration(&state, &loads),
            orientation: spin,
            angular_velocity: self.angular_acceleration(&state, &loads),
            rotors: (command * self.rotor_speed - state.rotors) / self.rotor_lag,
        }
        .to_array()
    }

    /// The state `steps` steps of length `step` (s) later, by the classical Runge-Kutta method; the quaternion is made
    /// one of length 1 after each.
    pub fn advance(
        &self,
        state: &QuadrotorState,
        command: DVec4,
        wind: DVec3,
        step: f64,
        steps: u32,
    ) -> QuadrotorState {
        let mut x = state.to_array();
        for _ in 0..steps {
            x = crate::plant::integrator::rk4_step(&x, step, |x| self.derivative(x, command, wind));
            let orientation = DQuat::from_slice(&x[6..10]).normalize();
            x[6..10].copy_from_slice(&orientation.to_array());
        }
        QuadrotorState::from_array(&x)
    }
}

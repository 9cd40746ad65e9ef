//! A hexapod with one motor and crank a side.

mod linkage;
mod mechanism;
mod parameters;
mod state;

#[cfg(test)]
mod tests;

use glam::{DQuat, DVec3};
use rapier3d_f64::prelude::{Pose, RigidBody};

pub use linkage::{LegTarget, Linkage};
pub use mechanism::JointMethod;
pub use parameters::{Hexapod, LEGS, Leg, Trunk, is_middle, side};
pub use state::HexapodState;

use crate::Supply;
use crate::rigid::Belt;
use mechanism::{Mechanism, leg_pose};

/// One side's crank: a degree of freedom of its own.
#[derive(Debug, Clone, Copy, Default)]
struct Crank {
    angle: f64,
    rate: f64,
    motor_torque: f64,
}

/// Position and rate of a leg in the trunk.
#[derive(Debug, Clone, Copy)]
struct LegMotion {
    swing: f64,
    swing_rate: f64,
    lift: f64,
    lift_rate: f64,
}

/// A hexapod on a belt.
///
/// Trunk and legs are rigid bodies; each leg slides and swings in its hip against the springs and dampers of its linkage, whose rest
/// positions follow the side's crank angle a through [`Linkage`]. The crank is a degree of freedom besides the bodies, with the gearbox's
/// inertia J: `J a'' = motor torque - friction - sum over its legs of (dswing/da * swing torque + dlift/da * lift force)`: the equations of
/// motion of the Lagrangian with the springs' potential (the rotor's own spin does not turn the trunk: a share of 1/N of the gearing's
/// torque). Springs act as equal and opposite forces on leg, trunk and crank, held over a step: what one gains the others lose, to the last bit of
/// the arithmetic. The engine's joint motors would be implicit, but tell the impulse of their last solver substep alone.
pub struct HexapodWorld {
    robot: Hexapod,
    method: JointMethod,
    mechanism: Mechanism,
    cranks: [Crank; 2],
    belt_speed: f64,
}

impl HexapodWorld {
    /// A robot of valid parameters ([`Hexapod::validate`]) at the origin, on the ground, at rest.
    pub fn new(robot: &Hexapod) -> Self {
        Self::with_joints(robot, JointMethod::default())
    }

    /// The same with a choice of how the legs are held.
    pub fn with_joints(robot: &Hexapod, method: JointMethod) -> Self {
        let mechanism = Mechanism::new(robot, method, standing_pose(robot, 0.0, 0.0, 0.0, [0.0; 2]), [0.0; 2]);
        Self { robot: robot.clone(), method, mechanism, cranks: [Crank::default(); 2], belt_speed: 0.0 }
    }

    /// The parameters.
    pub fn robot(&self) -> &Hexapod {
        &self.robot
    }

    /// Puts the robot on the ground, level and at rest, its legs unstrained: m, rad. Nothing stays of what was before but the belt's speed.
    pub fn place(&mut self, x: f64, y: f64, yaw: f64, crank_angle: [f64; 2]) {
        self.put(standing_pose(&self.robot, x, y, yaw, crank_angle), crank_angle);
    }

    /// The same anywhere, e.g. in the air.
    fn put(&mut self, pose: Pose, crank_angle: [f64; 2]) {
        self.mechanism = Mechanism::new(&self.robot, self.method, pose, crank_angle);
        self.cranks = crank_angle.map(|angle| Crank { angle, ..Crank::default() });
    }

    /// The belt runs backwards, along -x, with this speed, m/s; 0 is firm ground.
    pub fn set_belt_speed(&mut self, speed: f64) {
        self.belt_speed = speed;
    }

    /// One step of [`Hexapod::step`] seconds with these voltages at the left and right motor.
    pub fn step(&mut self, voltage: [f64; 2]) {
        self.step_with(voltage.map(Supply::Voltage));
    }

    /// One step with what the left and right motor are connected to.
    pub fn step_with(&mut self, supply: [Supply; 2]) {
        let step = self.robot.step;
        let load = self.apply_springs();
        let velocity = DVec3::new(-self.belt_speed, 0.0, 0.0);
        let belt = Belt { collider: self.mechanism.ground, velocity };
        self.mechanism.step(&belt);
        for (crank, (supply, load)) in self.cranks.iter_mut().zip(supply.into_iter().zip(load)) {
            crank.rate = self.robot.motor.advance(supply, crank.rate, load, step);
            crank.angle += step * crank.rate;
            crank.motor_torque = self.robot.motor.torque(supply, crank.rate);
        }
    }

    /// Sets the forces of all linkages on bodies and returns those on the cranks, N m.
    fn apply_springs(&mut self) -> [f64; 2] {
        let Self { robot, mechanism, cranks, .. } = self;
        let bodies = &mut mechanism.world.bodies;
        let mut load = [0.0; 2];
        let trunk = &bodies[mechanism.trunk];
        let (trunk_position, orientation) = (trunk.translation(), *trunk.rotation());
        let (axis_y, axis_z) = (orientation * DVec3::Y, orientation * DVec3::Z);
        let (mut trunk_force, mut trunk_torque) = (DVec3::ZERO, DVec3::ZERO);
        for leg in 0..LEGS {
            let crank = cranks[side(leg)];
            let target = robot.target(leg, crank.angle);
            let motion = leg_motion(robot, leg, &bodies[mechanism.trunk], &bodies[mechanism.legs[leg]]);
            let torque = robot.leg.swing_stiffness * (target.swing - motion.swing)
                + robot.leg.swing_damping * (target.swing_gain * crank.rate - motion.swing_rate);
            let force = robot.leg.lift_stiffness * (target.lift - motion.lift)
                + robot.leg.lift_damping * (target.lift_gain * crank.rate - motion.lift_rate);
            load[side(leg)] -= target.swing_gain * torque + target.lift_gain * force;
            let body = &mut bodies[mechanism.legs[leg]];
            let hip = body.translation();
            // Swinging forward is turning about -y.
            let (force, torque) = (force * axis_z, -torque * axis_y);
            body.reset_forces(false);
            body.reset_torques(false);
            body.add_force_at_point(force, hip, false);
            body.add_torque(torque, false);
            trunk_force -= force;
            trunk_torque -= torque + (hip - trunk_position).cross(force);
        }
        let trunk = &mut bodies[mechanism.trunk];
        trunk.reset_forces(false);
        trunk.reset_torques(false);
        trunk.add_force(trunk_force, false);
        trunk.add_torque(trunk_torque, false);
        load
    }

    /// Position and velocity of trunk and cranks.
    pub fn state(&self) -> HexapodState {
        let trunk = &self.mechanism.world.bodies[self.mechanism.trunk];
        HexapodState {
            position: trunk.translation(),
            orientation: *trunk.rotation(),
            linear_velocity: trunk.linvel(),
            angular_velocity: trunk.angvel(),
            crank_angle: self.cranks.map(|crank| crank.angle),
            crank_rate: self.cranks.map(|crank| crank.rate),
        }
    }

    /// Torque of the motors' currents at the left and right crank at the end of the last step, N m.
    pub fn motor_torque(&self) -> [f64; 2] {
        self.cranks.map(|crank| crank.motor_torque)
    }

    /// Kinetic energy of bodies and cranks, potential energy over the ground and in the legs' springs, J.
    ///
    /// Semi-implicit Euler steps are leapfrog steps whose velocities belong to half a step before the positions: the potential is taken
    /// there, and so free motion keeps the energy up to the square of the step.
    pub fn energy(&self) -> f64 {
        let (robot, half) = (&self.robot, 0.5 * self.robot.step);
        let bodies = &self.mechanism.world.bodies;
        let body_energy = |body: &RigidBody| {
            let height = body.center_of_mass().z - half * body.linvel().z;
            body.kinetic_energy() + body.mass() * robot.gravity * height
        };
        let trunk = &bodies[self.mechanism.trunk];
        let mut energy = body_energy(trunk);
        for leg in 0..LEGS {
            let body = &bodies[self.mechanism.legs[leg]];
            let crank = self.cranks[side(leg)];
            let target = robot.target(leg, crank.angle - half * crank.rate);
            let motion = leg_motion(robot, leg, trunk, body);
            let swing = target.swing - (motion.swing - half * motion.swing_rate);
            let lift = target.lift - (motion.lift - half * motion.lift_rate);
            energy += body_energy(body)
                + 0.5 * (robot.leg.swing_stiffness * swing * swing + robot.leg.lift_stiffness * lift * lift);
        }
        energy + self.cranks.iter().map(|crank| 0.5 * robot.motor.inertia() * crank.rate * crank.rate).sum::<f64>()
    }

    /// Feet that bore load in the last step: left fore, middle, aft, then right.
    pub fn feet_down(&self) -> [bool; 6] {
        self.foot_impulse().map(|impulse| impulse > 0.0)
    }

    /// Normal impulse on every foot in the last step, N s.
    fn foot_impulse(&self) -> [f64; 6] {
        let Mechanism { world, ground, feet, .. } = &self.mechanism;
        feet.map(|foot| {
            let pair = world.narrow_phase.contact_pair(foot, *ground);
            let manifolds = pair.map(|pair| pair.manifolds()).unwrap_or_default();
            manifolds.iter().flat_map(|manifold| &manifold.points).map(|point| point.data.impulse).sum()
        })
    }

    /// Returns true if every state is finite.
    pub fn is_finite(&self) -> bool {
        self.state().is_finite()
    }

    /// Returns true if the engine has frozen a body whose motion was not finite.
    pub fn quarantined(&self) -> bool {
        let bodies = &self.mechanism.world.bodies;
        let mut handles = std::iter::once(&self.mechanism.trunk).chain(&self.mechanism.legs);
        handles.any(|&handle| !bodies[handle].is_enabled())
    }
}

/// Level, with the lowest feet on the ground.
fn standing_pose(robot: &Hexapod, x: f64, y: f64, yaw: f64, crank_angle: [f64; 2]) -> Pose {
    let foot = DVec3::new(0.0, 0.0, robot.leg.foot_radius - robot.leg.length);
    let lowest = (0..LEGS)
        .map(|leg| (leg_pose(robot, leg, crank_angle[side(leg)]) * foot).z - robot.leg.foot_radius)
        .fold(-0.5 * robot.trunk.height, f64::min);
    Pose::from_parts(DVec3::new(x, y, -lowest), DQuat::from_rotation_z(yaw))
}

/// The coordinates of a hip, from the bodies' poses and velocities.
fn leg_motion(robot: &Hexapod, leg: usize, trunk: &RigidBody, body: &RigidBody) -> LegMotion {
    let orientation = *trunk.rotation();
    let (axis_y, axis_z) = (orientation * DVec3::Y, orientation * DVec3::Z);
    let hip = body.translation();
    let offset = orientation.conjugate() * (hip - trunk.translation());
    let relative = orientation.conjugate() * *body.rotation();
    // Either sign of the quaternion is the same rotation: take the one of at most half a turn.
    let turn = 2.0 * (relative.y * relative.w.signum()).atan2(relative.w.abs());
    LegMotion {
        swing: -turn,
        swing_rate: -(body.angvel() - trunk.angvel()).dot(axis_y),
        lift: offset.z - robot.hip(leg).z,
        lift_rate: (body.velocity_at_point(hip) - trunk.velocity_at_point(hip)).dot(axis_z),
    }
}

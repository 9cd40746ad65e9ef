//! The hexapod's bodies and joints in a rapier world.

use glam::{DQuat, DVec3};
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

use super::Hexapod;
use super::parameters::{LEGS, side};
use crate::rigid::{Belt, add_ground, physics_world, robot_groups};

/// Method that holds the legs in the trunk.
///
/// Measured with the default robot: in the air both methods give the same motion as the step goes to zero. At 0.4 V
/// both lock into the alternating tripod, at the same rate within 1 % and at speeds within 5 %. At 0.6 V the tree is 8
/// % faster. From 1 V on their free cranks settle to different leg phases. At 1 V these are the tripod for most starts,
/// against a third of a turn off it. The tree is then slower by a fifth to a third. Given the same crank motion MuJoCo,
/// whose joints are rigid, walks as far as either within 5 % up to 1 V. Beyond, paths turn too much to be compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JointMethod {
    /// Constraints between free bodies, solved iteratively with the contacts: the default because it is four times as fast. Linear momentum
    /// is kept to rounding. Hips give a little, and the few sweeps leave speeds some per cent low: 200 in place of 4 walk 13 % faster at 0.6 V.
    #[default]
    Impulse,
    /// One tree of bodies in reduced coordinates: its joints cannot come apart. Momentum is kept to the order of the step (to 1 % over 0.2 s at
    /// the default one), and motion off the ground is mirror-symmetric to rounding. Takes more sweeps to hold a standing robot by friction.
    Multibody,
}

/// Handles of the robot's bodies in the world.
pub(super) struct Mechanism {
    pub(super) world: PhysicsWorld,
    pub(super) ground: ColliderHandle,
    pub(super) trunk: RigidBodyHandle,
    pub(super) legs: [RigidBodyHandle; LEGS],
    pub(super) feet: [ColliderHandle; LEGS],
}

impl Mechanism {
    /// Builds the robot with its trunk at `pose`, its legs where the linkage wants them, everything at rest.
    pub(super) fn new(robot: &Hexapod, method: JointMethod, pose: Pose, crank_angle: [f64; 2]) -> Self {
        let mut world = physics_world(robot.step, robot.gravity, &robot.contact);
        let ground = add_ground(&mut world, robot.contact.friction);
        let trunk = add_trunk(&mut world, robot, pose);
        let mut legs = [trunk; LEGS];
        let mut feet = [ground; LEGS];
        for leg in 0..LEGS {
            let local = leg_pose(robot, leg, crank_angle[side(leg)]);
            (legs[leg], feet[leg]) = add_leg(&mut world, robot, pose * local);
            let joint = hip_joint(robot, leg);
            match method {
                JointMethod::Impulse => {
                    world.insert_impulse_joint(trunk, legs[leg], joint);
                }
                JointMethod::Multibody => {
                    world.insert_multibody_joint(trunk, legs[leg], joint);
                }
            }
        }
        // The engine would do so in its first step only.
        for handle in std::iter::once(trunk).chain(legs) {
            world.bodies[handle].recompute_mass_properties_from_colliders(&world.colliders);
        }
        let mut mechanism = Self { world, ground, trunk, legs, feet };
        if method == JointMethod::Multibody {
            // Rigid hips couple the feet's friction through the trunk. Measured: with the few sweeps that do for impulse joints a robot that stands on
            // three legs never comes to rest, at 2 cm/s.
            let solver = &mut mechanism.world.integration_parameters;
            solver.num_internal_pgs_iterations = 20;
            solver.num_internal_stabilization_iterations = 20;
            mechanism.set_joint_coordinates(robot, crank_angle);
        }
        mechanism
    }

    /// One step of the engine on the belt.
    pub(super) fn step(&mut self, belt: &Belt) {
        self.world.step_with_events(belt, &());
        self.read_tree_velocities();
    }

    /// Brings the velocities of a multibody's links up to date: the engine's own step leaves those that it began with, one step behind the poses.
    fn read_tree_velocities(&mut self) {
        let PhysicsWorld { multibody_joints, bodies, .. } = &mut self.world;
        let Some(index) = multibody_joints.rigid_body_link(self.trunk).map(|link| link.multibody) else { return };
        let Some(multibody) = multibody_joints.get_multibody(index) else { return };
        let rates = multibody.generalized_velocity();
        for (id, link) in multibody.links().enumerate() {
            let velocity = multibody.body_jacobian(id) * rates;
            let [v_x, v_y, v_z, w_x, w_y, w_z] = std::array::from_fn(|axis| velocity[axis]);
            let body = &mut bodies[link.rigid_body_handle()];
            body.set_linvel(DVec3::new(v_x, v_y, v_z), false);
            body.set_angvel(DVec3::new(w_x, w_y, w_z), false);
        }
    }

    /// Multibody joints are born at zero: brings the legs to the linkage's targets, and takes the engine's default damping away.
    fn set_joint_coordinates(&mut self, robot: &Hexapod, crank_angle: [f64; 2]) {
        let PhysicsWorld { multibody_joints, bodies, .. } = &mut self.world;
        let Some(index) = multibody_joints.rigid_body_link(self.trunk).map(|link| link.multibody) else { return };
        let first: [Option<usize>; LEGS] =
            std::array::from_fn(|leg| multibody_joints.rigid_body_link(self.legs[leg]).map(|link| link.id));
        let Some(multibody) = multibody_joints.get_multibody_mut(index) else { return };
        multibody.damping_mut().fill(0.0);
        // The free root has six coordinates, then each hip its lift and its rotation about y, in the order of insertion.
        multibody.forward_kinematics(bodies, true);
        let mut displacement = vec![0.0; multibody.ndofs()];
        for leg in 0..LEGS {
            let Some(link) = first[leg] else { continue };
            let target = robot.target(leg, crank_angle[side(leg)]);
            let start = 6 + 2 * (link - 1);
            displacement[start] = target.lift;
            displacement[start + 1] = -target.swing;
        }
        multibody.apply_displacements(&displacement);
        multibody.forward_kinematics(bodies, false);
        multibody.update_rigid_bodies(bodies, true);
    }
}

/// A leg's pose in the trunk when the linkage has its way. The leg's origin is its hip.
pub(super) fn leg_pose(robot: &Hexapod, leg: usize, crank_angle: f64) -> Pose {
    let target = robot.target(leg, crank_angle);
    let hip = robot.hip(leg) + DVec3::Z * target.lift;
    Pose::from_parts(hip, DQuat::from_rotation_y(-target.swing))
}

fn add_trunk(world: &mut PhysicsWorld, robot: &Hexapod, pose: Pose) -> RigidBodyHandle {
    let trunk = &robot.trunk;
    let half = 0.5 * DVec3::new(trunk.length, trunk.width, trunk.height);
    let squares = 4.0 * half * half;
    let inertia = trunk.mass / 12.0 * DVec3::new(squares.y + squares.z, squares.x + squares.z, squares.x + squares.y);
    let body = RigidBodyBuilder::dynamic().pose(pose).can_sleep(false).additional_mass_properties(MassProperties::new(
        DVec3::ZERO,
        trunk.mass,
        inertia,
    ));
    let collider = ColliderBuilder::cuboid(half.x, half.y, half.z)
        .density(0.0)
        .friction(robot.contact.friction)
        .collision_groups(robot_groups());
    world.insert(body, collider).0
}

fn add_leg(world: &mut PhysicsWorld, robot: &Hexapod, pose: Pose) -> (RigidBodyHandle, ColliderHandle) {
    let leg = &robot.leg;
    // A square rod, as thick as its foot.
    let across = leg.mass * (leg.length * leg.length + 4.0 * leg.foot_radius * leg.foot_radius) / 12.0;
    let along = leg.mass * 4.0 * leg.foot_radius * leg.foot_radius / 6.0;
    let middle = DVec3::new(0.0, 0.0, -0.5 * leg.length);
    let properties = MassProperties::new(middle, leg.mass, DVec3::new(across, across, along));
    let body = RigidBodyBuilder::dynamic().pose(pose).can_sleep(false).additional_mass_properties(properties);
    let collider = ColliderBuilder::ball(leg.foot_radius)
        .translation(DVec3::new(0.0, 0.0, leg.foot_radius - leg.length))
        .density(0.0)
        .friction(robot.contact.friction)
        .collision_groups(robot_groups());
    world.insert(body, collider)
}

/// Free to swing about the trunk's y and to slide along its z.
///
/// Locked axes give way like stiff, overdamped springs whose frequency follows the step (2 kHz at the default one: hips give by less than a
/// millimetre). Measured: perfectly stiff ones correct in one step what friction moved in the last, and a standing robot jitters at some mm/s; softer
/// ones keep energy that nobody counts.
fn hip_joint(robot: &Hexapod, leg: usize) -> GenericJoint {
    let free = JointAxesMask::LIN_Z | JointAxesMask::ANG_Y;
    GenericJointBuilder::new(free.complement())
        .local_anchor1(robot.hip(leg))
        .contacts_enabled(false)
        .softness(SpringCoefficients::new(0.5 / robot.step, 4.0))
        .build()
}

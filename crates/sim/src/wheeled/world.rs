//! The robot's bodies in a rapier world.

use glam::{DQuat, DVec3};
use rapier3d_f64::prelude::*;

use super::arena::THICKNESS;
use super::{Arena, WheeledRobot, WheeledState};
use crate::Supply;
use crate::rigid::{add_ground, physics_world, robot_groups};

const WALL: Group = Group::GROUP_3;
/// Degrees of freedom of the chassis, before those of the wheels.
const ROOT: usize = 6;
const SIDES: [f64; 2] = [1.0, -1.0];

/// A wheeled robot in an arena.
///
/// Chassis and wheels are one multibody, so that its joints cannot come apart and the weight on the light wheels is exact. The motors'
/// torque-speed line is a torque on the wheel, and back on the chassis, with a drag that is implicit in time; their Coulomb friction is a
/// constraint of the engine that holds a wheel or brakes it; the rotors' inertia adds to the wheels' coordinates (a rotor's own spin does not
/// turn the chassis: a share of 1/N of the gearing's torque).
pub struct WheeledWorld {
    robot: WheeledRobot,
    step: f64,
    world: PhysicsWorld,
    chassis: RigidBodyHandle,
    shell: ColliderHandle,
    wheels: [RigidBodyHandle; 2],
    walls: Vec<ColliderHandle>,
    wheel_angle: [f64; 2],
    touching: bool,
    wall_contacts: u64,
}

impl WheeledWorld {
    /// A robot that stands at `[x, y, yaw]` (m, rad), at rest. Robot and arena have passed their `validate`; gravity in m/s^2, steps of
    /// `step` seconds.
    pub fn new(robot: &WheeledRobot, arena: &Arena, gravity: f64, step: f64, [x, y, yaw]: [f64; 3]) -> Self {
        let mut world = physics_world(step, gravity, &robot.contact);
        // Three contacts share the robot's weight and its motion along the floor. With the few sweeps that do for light feet, tyres that
        // have just been set down or begun to slip would take some steps to agree, and rates would be off by per cents.
        let solver = &mut world.integration_parameters;
        solver.num_internal_pgs_iterations = 20;
        solver.num_internal_stabilization_iterations = 4;
        solver.friction_in_bias_pass = true;
        add_ground(&mut world, robot.contact.friction);
        let walls = if arena.walls { add_walls(&mut world, arena, robot.chassis.friction) } else { Vec::new() };
        let pose = Pose::from_parts(DVec3::new(x, y, robot.wheel.radius), DQuat::from_rotation_z(yaw));
        let (chassis, shell) = add_chassis(&mut world, robot, pose);
        let wheels = SIDES.map(|side| add_wheel(&mut world, robot, chassis, pose, side));
        let mut new = Self {
            robot: robot.clone(),
            step,
            world,
            chassis,
            shell,
            wheels,
            walls,
            wheel_angle: [0.0; 2],
            touching: false,
            wall_contacts: 0,
        };
        if let Some(multibody) = new.multibody_mut() {
            // The engine's own damping is not this robot's.
            multibody.damping_mut().fill(0.0);
            for wheel in ROOT..ROOT + 2 {
                multibody.armature_mut()[wheel] = robot.motor.inertia();
                multibody.frictions_mut()[wheel] = robot.motor.coulomb_friction;
            }
        }
        new
    }

    /// The parameters.
    pub fn robot(&self) -> &WheeledRobot {
        &self.robot
    }

    /// One step with these voltages at the left and the right motor; the drivers give no more than their supply.
    pub fn step(&mut self, voltage: [f64; 2]) {
        self.step_with(voltage.map(Supply::Voltage));
    }

    /// One step with what the left and the right motor are connected to.
    pub fn step_with(&mut self, supply: [Supply; 2]) {
        let drag = supply.map(|supply| self.robot.motor.drag(supply));
        if let Some(multibody) = self.multibody_mut() {
            multibody.damping_mut().rows_mut(ROOT, 2).copy_from_slice(&drag);
        }
        let torque = supply.map(|supply| self.robot.motor.torque(supply, 0.0));
        let bodies = &mut self.world.bodies;
        let axle = *bodies[self.chassis].rotation() * DVec3::Y;
        let chassis = &mut bodies[self.chassis];
        chassis.reset_torques(false);
        chassis.add_torque(-(torque[0] + torque[1]) * axle, false);
        for (wheel, torque) in self.wheels.into_iter().zip(torque) {
            let body = &mut bodies[wheel];
            body.reset_torques(false);
            body.add_torque(torque * axle, false);
        }
        self.world.step();
        let rate = self.wheel_rate();
        self.wheel_angle = [0, 1].map(|side| self.wheel_angle[side] + self.step * rate[side]);
        let touching = self.walls.iter().any(|&wall| {
            self.world.narrow_phase.contact_pair(self.shell, wall).is_some_and(|pair| {
                pair.manifolds().iter().flat_map(|manifold| &manifold.points).any(|point| point.data.impulse > 0.0)
            })
        });
        self.wall_contacts += u64::from(touching && !self.touching);
        self.touching = touching;
    }

    /// Position and velocity of chassis and wheels.
    pub fn state(&self) -> WheeledState {
        let chassis = &self.world.bodies[self.chassis];
        let orientation = *chassis.rotation();
        let axle = orientation * -centre_of_mass(&self.robot);
        // The engine brings the bodies' own velocities up to date when the next step begins; the multibody's are those of now.
        let motion = self.multibody().map(|multibody| multibody.body_jacobian(0) * multibody.generalized_velocity());
        let [v_x, v_y, v_z, w_x, w_y, w_z] =
            motion.map_or([f64::NAN; 6], |motion| std::array::from_fn(|axis| motion[axis]));
        let angular_velocity = DVec3::new(w_x, w_y, w_z);
        WheeledState {
            position: chassis.translation() + axle,
            orientation,
            linear_velocity: DVec3::new(v_x, v_y, v_z) + angular_velocity.cross(axle),
            angular_velocity,
            wheel_angle: self.wheel_angle,
            wheel_rate: self.wheel_rate(),
        }
    }

    /// Returns true if the robot's shell touched a wall in the last step.
    pub fn touching(&self) -> bool {
        self.touching
    }

    /// Number of times that the shell came to touch a wall.
    pub fn wall_contacts(&self) -> u64 {
        self.wall_contacts
    }

    /// Returns true if every state is finite and the engine has frozen no body for not being finite.
    pub fn is_sound(&self) -> bool {
        let enabled = |&body: &RigidBodyHandle| self.world.bodies[body].is_enabled();
        self.state().is_finite() && enabled(&self.chassis) && self.wheels.iter().all(enabled)
    }

    fn wheel_rate(&self) -> [f64; 2] {
        let Some(multibody) = self.multibody() else { return [f64::NAN; 2] };
        let velocity = multibody.generalized_velocity();
        [velocity[ROOT], velocity[ROOT + 1]]
    }

    fn multibody(&self) -> Option<&Multibody> {
        let joints = &self.world.multibody_joints;
        joints.get_multibody(joints.rigid_body_link(self.chassis)?.multibody)
    }

    fn multibody_mut(&mut self) -> Option<&mut Multibody> {
        let joints = &mut self.world.multibody_joints;
        let index = joints.rigid_body_link(self.chassis)?.multibody;
        joints.get_multibody_mut(index)
    }
}

fn add_walls(world: &mut PhysicsWorld, arena: &Arena, friction: f64) -> Vec<ColliderHandle> {
    let (x, y, half) = (0.5 * arena.length, 0.5 * arena.width, 0.5 * THICKNESS);
    let along_x = DVec3::new(x + THICKNESS, half, 0.5 * arena.height);
    let along_y = DVec3::new(half, y, 0.5 * arena.height);
    let body = world.insert_body(RigidBodyBuilder::fixed());
    let walls =
        [(along_x, 0.0, y + half), (along_x, 0.0, -y - half), (along_y, x + half, 0.0), (along_y, -x - half, 0.0)];
    let mut add = |(size, x, y): (DVec3, f64, f64)| {
        let groups = InteractionGroups::new(WALL, robot_groups().memberships, InteractionTestMode::And);
        let wall = ColliderBuilder::cuboid(size.x, size.y, size.z)
            .translation(DVec3::new(x, y, size.z))
            .friction(friction)
            .collision_groups(groups);
        world.insert_collider(wall, Some(body))
    };
    walls.map(&mut add).to_vec()
}

/// Of the chassis, from the middle of the axle.
fn centre_of_mass(robot: &WheeledRobot) -> DVec3 {
    let [forward, up] = robot.chassis.centre_of_mass;
    DVec3::new(forward, 0.0, up)
}

/// The chassis with its caster, its axle's middle at `pose`. Its origin is its centre of mass: the engine moves the origin of a
/// multibody's root by the velocity of its centre of mass.
fn add_chassis(world: &mut PhysicsWorld, robot: &WheeledRobot, pose: Pose) -> (RigidBodyHandle, ColliderHandle) {
    let (chassis, caster) = (&robot.chassis, &robot.caster);
    let centre = centre_of_mass(robot);
    let square = chassis.radius * chassis.radius;
    let across = chassis.mass * (3.0 * square + chassis.height * chassis.height) / 12.0;
    let inertia = DVec3::new(across, across, 0.5 * chassis.mass * square);
    let properties = MassProperties::new(DVec3::ZERO, chassis.mass, inertia);
    let body = RigidBodyBuilder::dynamic()
        .pose(pose * Pose::from_parts(centre, DQuat::IDENTITY))
        .can_sleep(false)
        .additional_mass_properties(properties);
    let middle = chassis.clearance + 0.5 * chassis.height - robot.wheel.radius;
    let groups = InteractionGroups { filter: robot_groups().filter | WALL, ..robot_groups() };
    // The engine's cylinders stand along y.
    let shell = ColliderBuilder::cylinder(0.5 * chassis.height, chassis.radius)
        .position(Pose::from_parts(
            DVec3::new(0.0, 0.0, middle) - centre,
            DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2),
        ))
        .density(0.0)
        .friction(chassis.friction)
        .collision_groups(groups);
    let (handle, shell) = world.insert(body, shell);
    let ball = ColliderBuilder::ball(caster.radius)
        .translation(DVec3::new(-caster.distance, 0.0, caster.radius - robot.wheel.radius) - centre)
        .density(0.0)
        .friction(caster.friction)
        .friction_combine_rule(CoefficientCombineRule::Min)
        .collision_groups(robot_groups());
    world.insert_collider(ball, Some(handle));
    (handle, shell)
}

/// A wheel on the left (side 1) or the right (-1).
fn add_wheel(
    world: &mut PhysicsWorld,
    robot: &WheeledRobot,
    chassis: RigidBodyHandle,
    pose: Pose,
    side: f64,
) -> RigidBodyHandle {
    let wheel = &robot.wheel;
    let middle = DVec3::new(0.0, 0.5 * side * wheel.track, 0.0);
    let square = wheel.radius * wheel.radius;
    let across = wheel.mass * (3.0 * square + wheel.width * wheel.width) / 12.0;
    let inertia = DVec3::new(across, 0.5 * wheel.mass * square, across);
    let body = RigidBodyBuilder::dynamic()
        .pose(pose * Pose::from_parts(middle, DQuat::IDENTITY))
        .can_sleep(false)
        .additional_mass_properties(MassProperties::new(DVec3::ZERO, wheel.mass, inertia));
    // A ball in place of a crowned tyre: one point of contact, under the middle.
    let tyre = ColliderBuilder::ball(wheel.radius)
        .density(0.0)
        .friction(robot.contact.friction)
        .collision_groups(robot_groups());
    let (handle, _) = world.insert(body, tyre);
    let joint =
        RevoluteJointBuilder::new(DVec3::Y).local_anchor1(middle - centre_of_mass(robot)).contacts_enabled(false);
    world.insert_multibody_joint(chassis, handle, joint);
    handle
}

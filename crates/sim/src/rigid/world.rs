//! The world of a small robot.

use glam::DVec3;
use rapier3d_f64::prelude::*;

use super::Contact;

const GROUND: Group = Group::GROUP_1;
const ROBOT: Group = Group::GROUP_2;

/// Collision groups of a robot's colliders: contacts with the ground, never with each other.
pub fn robot_groups() -> InteractionGroups {
    InteractionGroups::new(ROBOT, GROUND, InteractionTestMode::And)
}

/// An empty world with gravity (m/s^2) along -z and steps of `step` seconds.
///
/// There is one solver substep a step: forces that are set once a step act on positions and velocities of the same
/// step. The motion of smooth systems is then that of the semi-implicit Euler method, which is symplectic (Hairer,
/// Lubich, Wanner, *Geometric Numerical Integration*, theorem VI.3.3). The solver's own substeps would hold such forces
/// over all of them and so pump energy into stiff springs. Features that depend on wall time, history or scale are off:
/// continuous collision detection, contacts recycled from earlier steps.
pub fn physics_world(step: f64, gravity: f64, contact: &Contact) -> PhysicsWorld {
    let softness = SpringCoefficients::new(contact.natural_frequency, contact.damping_ratio);
    let integration_parameters = IntegrationParameters {
        dt: step,
        // Robots of a decimetre, where the engine's defaults think of metres.
        length_unit: 0.1,
        // 1 mm: what a foot at 1 m/s goes in a millisecond.
        normalized_prediction_distance: 0.01,
        contact_softness: softness,
        static_contact_softness: softness,
        num_solver_iterations: 1,
        num_internal_pgs_iterations: 4,
        num_internal_stabilization_iterations: 1,
        max_ccd_substeps: 0,
        contact_recycling: false,
        contact_clustering: false,
        // Else feet move before friction holds them: measured, the hexapod then walks 7 % too fast at 0.25 ms, and converges slowly.
        friction_in_bias_pass: true,
        warmstart_joints: true,
        friction_model: FrictionModel::Coulomb,
        ..IntegrationParameters::default()
    };
    PhysicsWorld { gravity: DVec3::new(0.0, 0.0, -gravity), integration_parameters, ..PhysicsWorld::new() }
}

/// Adds the half-space z < 0 with the given Coulomb coefficient, ready to be a [`Belt`](super::Belt).
pub fn add_ground(world: &mut PhysicsWorld, friction: f64) -> ColliderHandle {
    let collider = ColliderBuilder::halfspace(nalgebra::Unit::new_unchecked(DVec3::Z))
        .friction(friction)
        .collision_groups(InteractionGroups::new(GROUND, ROBOT, InteractionTestMode::And))
        .active_hooks(ActiveHooks::MODIFY_SOLVER_CONTACTS);
    world.insert(RigidBodyBuilder::fixed(), collider).1
}

//! The engine's contacts at the scale of small robots, held against closed forms.

use glam::DVec3;
use rapier3d_f64::prelude::*;

use super::{Belt, Contact, add_ground, physics_world, robot_groups};

const STEP: f64 = 2.5e-4;
const GRAVITY: f64 = 9.81;

/// A world with a belt, and a body of 30 g with this collider on it.
struct Bench {
    world: PhysicsWorld,
    belt: Belt,
    body: RigidBodyHandle,
}

impl Bench {
    fn new(collider: ColliderBuilder, pose: Pose, friction: f64, ground_first: bool) -> Self {
        let contact = Contact { friction, ..Contact::default() };
        let mut world = physics_world(STEP, GRAVITY, &contact);
        let build = |world: &mut PhysicsWorld| {
            let body = RigidBodyBuilder::dynamic().pose(pose).can_sleep(false);
            world.insert(body, collider.clone().mass(0.03).friction(friction).collision_groups(robot_groups())).0
        };
        let (ground, body) = if ground_first {
            let ground = add_ground(&mut world, friction);
            (ground, build(&mut world))
        } else {
            let body = build(&mut world);
            (add_ground(&mut world, friction), body)
        };
        Self { world, belt: Belt { collider: ground, velocity: DVec3::ZERO }, body }
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP).round() as usize {
            self.world.step_with_events(&self.belt, &());
        }
    }

    fn body(&mut self) -> &mut RigidBody {
        &mut self.world.bodies[self.body]
    }
}

/// A block of 5 cm x 3 cm x 1 cm lying on the ground, which cannot tip or turn.
///
/// The engine's friction at a point is as large as Coulomb's, but along the slip weighted with the point's effective mass: exactly against the
/// slip only where that is the same in all directions, as it is here.
fn block(friction: f64, ground_first: bool) -> Bench {
    let pose = Pose::from_translation(DVec3::new(0.0, 0.0, 0.005));
    let mut bench = Bench::new(ColliderBuilder::cuboid(0.025, 0.015, 0.005), pose, friction, ground_first);
    bench.body().lock_rotations(true, true);
    bench
}

#[test]
fn falling_body_matches_semi_implicit_euler() {
    let height = Pose::from_translation(DVec3::new(0.0, 0.0, 10.0));
    let mut bench = Bench::new(ColliderBuilder::ball(0.01), height, 0.5, true);
    bench.run(1.0);
    let n = (1.0 / STEP).round();
    // x_n = x_0 - g h^2 n (n + 1) / 2, and g t^2 / 2 up to the step's order.
    let fallen = 10.0 - bench.body().translation().z;
    assert!((fallen - GRAVITY * STEP * STEP * n * (n + 1.0) / 2.0).abs() < 1e-11, "{fallen}");
    assert!((fallen - GRAVITY / 2.0).abs() < GRAVITY * STEP);
    assert!((bench.body().linvel().z + GRAVITY).abs() < 1e-11);
}

#[test]
fn belt_drags_a_block_until_it_rides() {
    for ground_first in [true, false] {
        let friction = 0.4;
        let mut bench = block(friction, ground_first);
        bench.run(0.05);
        let start = bench.body().translation().x;
        bench.belt.velocity = DVec3::new(-0.3, 0.0, 0.0);
        bench.run(0.05);
        // mu g is 3.924 m/s^2: it still slips. The normal force may lag by a step.
        let speed = bench.body().linvel().x;
        assert!((speed + friction * GRAVITY * 0.05).abs() < 2.0 * friction * GRAVITY * STEP, "{ground_first} {speed}");
        bench.run(0.15);
        let (speed, way) = (bench.body().linvel().x, bench.body().translation().x - start);
        assert!((speed + 0.3).abs() < 1e-6, "{ground_first}: it must ride, at {speed}");
        // Slipping for v / (mu g), it falls behind the belt by v^2 / (2 mu g).
        let expected = -0.3 * 0.2 + 0.3 * 0.3 / (2.0 * friction * GRAVITY);
        assert!((way - expected).abs() < 2.0 * 0.3 * STEP, "{ground_first}: {way} not {expected}");
        assert!(bench.body().translation().y.abs() < 1e-6 && bench.body().angvel().length() < 1e-4);
    }
}

#[test]
fn sliding_block_stops_by_coulomb_friction() {
    let mut bench = block(0.3, true);
    bench.run(0.05);
    let start = bench.body().translation();
    bench.body().set_linvel(DVec3::new(0.3, 0.4, 0.0), true);
    bench.run(0.3);
    // v^2 / (2 mu g) along the velocity, though no axis of friction lies there.
    let way = bench.body().translation() - start;
    let expected = 0.25 / (2.0 * 0.3 * GRAVITY);
    assert!((way.truncate().length() / expected - 1.0).abs() < 0.01, "{} not {expected}", way.truncate().length());
    assert!((way.y / way.x - 4.0 / 3.0).abs() < 0.01);
    assert!(bench.body().linvel().length() < 1e-7);
}

/// A wheel on the incline that tilted gravity makes: its speed and its spin after some time.
fn roll(friction: f64, incline: f64, seconds: f64) -> (f64, f64) {
    let pose = Pose::from_translation(DVec3::new(0.0, 0.0, 0.02));
    // A cylinder's axis is its y, which lies across the incline.
    let mut bench = Bench::new(ColliderBuilder::cylinder(0.01, 0.02), pose, friction, true);
    bench.run(0.05);
    bench.world.gravity = GRAVITY * DVec3::new(incline.sin(), 0.0, -incline.cos());
    bench.run(seconds);
    (bench.body().linvel().x, bench.body().angvel().y)
}

#[test]
fn rolling_wheel_has_two_thirds_acceleration() {
    let incline = 0.2_f64;
    let (speed, spin) = roll(0.5, incline, 0.3);
    let expected = 2.0 / 3.0 * GRAVITY * incline.sin() * 0.3;
    assert!((speed / expected - 1.0).abs() < 5e-3, "{speed} not {expected}");
    assert!((spin * 0.02 / speed - 1.0).abs() < 5e-3, "no slip: {}", spin * 0.02);
}

#[test]
fn wheel_slips_at_low_friction() {
    // tan(0.5) / 3 = 0.182 is the least coefficient that rolls.
    let (incline, friction) = (0.5_f64, 0.1);
    let (speed, spin) = roll(friction, incline, 0.2);
    let expected = GRAVITY * (incline.sin() - friction * incline.cos()) * 0.2;
    assert!((speed / expected - 1.0).abs() < 0.01, "{speed} not {expected}");
    // I w' = mu m g cos(incline) r with I = m r^2 / 2.
    let turning = 2.0 * friction * GRAVITY * incline.cos() / 0.02 * 0.2;
    assert!((spin / turning - 1.0).abs() < 0.01, "{spin} not {turning}");
    let (speed, spin) = roll(0.25, incline, 0.2);
    assert!((spin * 0.02 / speed - 1.0).abs() < 5e-3, "above the limit it rolls");
}

#[test]
fn block_rests_below_friction_angle() {
    let mut bench = block(0.5, true);
    bench.world.gravity = GRAVITY * DVec3::new(0.3_f64.sin(), 0.0, -0.3_f64.cos());
    bench.run(0.1);
    let start = bench.body().translation();
    bench.run(0.5);
    let creep = (bench.body().translation() - start).length() / 0.5;
    assert!(creep < 1e-7, "creeps at {creep} m/s");
}

#[test]
fn block_brakes_by_coulomb_friction() {
    let mut bench = block(0.3, true);
    bench.body().lock_rotations(false, true);
    bench.run(0.05);
    bench.body().set_linvel(DVec3::new(0.5, 0.0, 0.0), true);
    bench.run(0.1);
    // The corners' effective mass turns their friction by 20 degrees, left and right alike.
    let share = (0.5 - bench.body().linvel().x) / (0.3 * GRAVITY * 0.1);
    assert!((0.92..=1.001).contains(&share), "{share}");
}

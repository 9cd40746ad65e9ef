//! Physics against closed forms, and runs.

use super::*;
use crate::DcMotor;

const GRAVITY: f64 = 9.81;
/// The default.
const STEP: f64 = 2e-3;

fn steps(seconds: f64) -> usize {
    (seconds / STEP).round() as usize
}

fn open_floor() -> Arena {
    Arena { walls: false, ..Arena::default() }
}

/// On an open floor, settled on its wheels.
fn standing(robot: &WheeledRobot) -> WheeledWorld {
    robot.validate().unwrap();
    let mut world = WheeledWorld::new(robot, &open_floor(), GRAVITY, STEP, [0.0; 3]);
    (0..steps(0.3)).for_each(|_| world.step([0.0; 2]));
    world
}

/// No friction but that of the tyres.
fn frictionless() -> WheeledRobot {
    let mut robot = WheeledRobot::default();
    robot.motor = DcMotor { viscous_friction: 0.0, coulomb_friction: 0.0, ..robot.motor };
    robot.caster.friction = 0.0;
    robot
}

#[test]
fn resting_robot_stays_in_place() {
    let mut world = standing(&WheeledRobot::default());
    let before = world.state();
    let mut fastest = 0.0f64;
    for _ in 0..steps(2.0) {
        world.step([0.0; 2]);
        fastest = fastest.max(world.state().linear_velocity.length());
    }
    let after = world.state();
    assert!(fastest < 1e-4, "{fastest}");
    assert!((after.position - before.position).length() < 1e-5, "{}", after.position - before.position);
    assert!((after.position.z - 0.035).abs() < 1e-4 && after.tilt() < 2e-3, "{} {}", after.position.z, after.tilt());
}

#[test]
fn straight_path_equals_wheel_turns() {
    let robot = WheeledRobot::default();
    let mut world = standing(&robot);
    let start = world.state();
    // Slowly up to speed: at a tenth of the stall torque no tyre slips.
    for k in 0..steps(4.0) {
        world.step([(k as f64 * STEP).min(3.0); 2]);
    }
    let end = world.state();
    let way = end.position.x - start.position.x;
    for side in 0..2 {
        let turned = end.wheel_angle[side] - start.wheel_angle[side];
        assert!((way / (robot.wheel.radius * turned) - 1.0).abs() < 1e-3, "{way} {turned}");
    }
    assert!(way > 1.0 && end.position.y.abs() < 1e-3 && end.yaw().abs() < 1e-3, "{}", end.position);
}

#[test]
fn vehicle_accelerates_with_reflected_mass() {
    let robot = frictionless();
    let mut world = standing(&robot);
    let voltage = 1.5;
    let constant = robot.motor.gear_ratio * robot.motor.torque_constant;
    let drag = constant * constant / robot.motor.resistance;
    let reflected = 0.5 * robot.mass() * robot.wheel.radius.powi(2);
    let time_constant = (robot.wheel_inertia() + reflected) / drag;
    let final_rate = voltage / constant;
    for k in 1..=steps(1.5) {
        world.step([voltage; 2]);
        let expected = final_rate * (1.0 - (-(k as f64) * STEP / time_constant).exp());
        for rate in world.state().wheel_rate {
            assert!((rate - expected).abs() < 0.01 * final_rate, "{k}: {rate} {expected}");
        }
        // The tyres stick: what they drive moves as fast as they do.
        let slip = world.state().slip(robot.wheel.radius, robot.wheel.track);
        assert!(slip.iter().all(|slip| slip.abs() < 1e-4), "{k}: {slip:?}");
    }
    assert!((0.15..0.3).contains(&time_constant), "{time_constant}");
}

#[test]
fn slow_turns_have_the_radius_of_the_kinematics() {
    let robot = WheeledRobot::default();
    let drive = Wheeled::default().drive();
    for [left, right] in [[0.6, 1.2], [1.0, 0.4], [-0.8, 0.8], [-0.4, -0.9]] {
        let mut world = standing(&robot);
        (0..steps(1.5)).for_each(|_| world.step([left, right]));
        let (mut rates, mut way, mut turn) = ([0.0; 2], 0.0, 0.0);
        for _ in 0..steps(1.0) {
            world.step([left, right]);
            let state = world.state();
            rates = [0, 1].map(|side| rates[side] + STEP * state.wheel_rate[side]);
            way += STEP * state.planar_velocity()[0];
            turn += STEP * state.yaw_rate();
        }
        let [expected_way, expected_turn] = drive.velocity(rates);
        assert!((turn / expected_turn - 1.0).abs() < 0.01, "{left} {right}: {turn} {expected_turn}");
        assert!((way - expected_way).abs() < 0.01 * (rates[0].abs() + rates[1].abs()) * 0.035, "{way} {expected_way}");
    }
}

#[test]
fn on_ice_the_wheels_spin_and_friction_alone_drives() {
    let mut robot = frictionless();
    robot.contact.friction = 0.05;
    let mut world = standing(&robot);
    (0..steps(0.5)).for_each(|_| world.step([6.0; 2]));
    let (first, [spin, _]) = (world.state().planar_velocity()[0], world.state().wheel_rate);
    (0..steps(1.0)).for_each(|_| world.step([6.0; 2]));
    let acceleration = world.state().planar_velocity()[0] - first;
    // Balance of moments about the centre of mass, b behind the axle, c before the caster and h above the floor:
    // N_caster c = N_wheels (b + mu h).
    let share = robot.chassis.mass / robot.mass();
    let b = -robot.chassis.centre_of_mass[0] * share;
    let h = robot.wheel.radius + robot.chassis.centre_of_mass[1] * share;
    let c = robot.caster.distance - b;
    let expected = 0.05 * GRAVITY * c / (c + b + 0.05 * h);
    assert!((acceleration / expected - 1.0).abs() < 0.02, "{acceleration} {expected}");
    assert!(spin * robot.wheel.radius > 5.0 * first, "{spin} {first}");
    let slip = world.state().slip(robot.wheel.radius, robot.wheel.track);
    assert!(slip.iter().all(|&slip| slip < -0.5), "{slip:?}");
}

#[test]
fn gearboxes_stop_a_coasting_robot() {
    let mut robot = frictionless();
    robot.motor.coulomb_friction = 8e-3;
    let mut world = standing(&robot);
    (0..steps(2.0)).for_each(|_| world.step([2.0; 2]));
    let speed = world.state().planar_velocity()[0];
    let inertia = robot.mass() + 2.0 * robot.wheel_inertia() / robot.wheel.radius.powi(2);
    let deceleration = 2.0 * robot.motor.coulomb_friction / robot.wheel.radius / inertia;
    let mut count = 0;
    while world.state().planar_velocity()[0] > 1e-4 && count < 10_000 {
        world.step_with([crate::Supply::Open; 2]);
        count += 1;
    }
    let expected = speed / deceleration;
    assert!((f64::from(count) * STEP / expected - 1.0).abs() < 0.01, "{count} {expected}");
    let stopped = world.state().position;
    (0..steps(0.5)).for_each(|_| world.step_with([crate::Supply::Open; 2]));
    assert!((world.state().position - stopped).length() < 1e-4);
}

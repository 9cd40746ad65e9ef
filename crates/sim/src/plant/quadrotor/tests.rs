//! The quadrotor against closed forms, and its flights.

use glam::{DQuat, DVec3, DVec4};

use super::*;
use crate::plant::atmosphere::GRAVITY;
use crate::plant::wind::Wind;
use crate::{End, Reading, Run, Scenario, Sink, SinkError, Stamps};

/// A state in which everything moves.
fn tumbling() -> QuadrotorState {
    QuadrotorState {
        position: DVec3::new(0.3, -0.2, 1.0),
        velocity: DVec3::new(1.0, 0.5, -0.4),
        orientation: DQuat::from_euler(glam::EulerRot::ZYX, 0.7, 0.2, -0.3),
        angular_velocity: DVec3::new(1.5, -2.0, 0.8),
        rotors: DVec4::new(1400.0, 1500.0, 1600.0, 1550.0),
    }
}

#[test]
fn quadrotor_hovers_at_hover_speed() {
    let airframe = Airframe::default();
    let speed = airframe.hover_speed();
    // 4 c w^2 = m g
    assert!((4.0 * airframe.thrust_coefficient * speed * speed / (0.027 * GRAVITY) - 1.0).abs() < 1e-14);
    let mut state = QuadrotorState { rotors: DVec4::splat(speed), ..QuadrotorState::at(DVec3::Z) };
    let command = DVec4::splat(speed / airframe.rotor_speed);
    state = airframe.advance(&state, command, DVec3::ZERO, 0.002, 1_000);
    assert!(state.position.distance(DVec3::Z) < 1e-10, "{}", state.position);
    assert!(state.angular_velocity.length() < 1e-10);
}

/// With the rotors stopped, m v' = m g - k v^2: v = v_t tanh(g t / v_t), v_t = sqrt(2 m g / (rho A)).
#[test]
fn quadrotor_falls_at_terminal_velocity() {
    let airframe = Airframe::default();
    let terminal = (2.0 * airframe.mass * GRAVITY / (airframe.air_density * airframe.drag_area[2])).sqrt();
    let mut state = QuadrotorState::at(DVec3::ZERO);
    for second in 1..=8 {
        state = airframe.advance(&state, DVec4::ZERO, DVec3::ZERO, 0.002, 500);
        let time = f64::from(second);
        let expected = -terminal * (GRAVITY * time / terminal).tanh();
        assert!((state.velocity.z - expected).abs() < 1e-9, "{second} s: {} {expected}", state.velocity.z);
        let depth = -terminal * terminal / GRAVITY * (GRAVITY * time / terminal).cosh().ln();
        assert!((state.position.z - depth).abs() < 1e-8);
    }
    assert!((state.velocity.z / terminal + 1.0).abs() < 0.01);
    // Without air it would go on.
    let vacuum = Airframe { air_density: 0.0, ..Airframe::default() };
    let falling = vacuum.advance(&QuadrotorState::at(DVec3::ZERO), DVec4::ZERO, DVec3::ZERO, 0.002, 500);
    assert!((falling.velocity.z + GRAVITY).abs() < 1e-12);
}

/// A drifting stone ends up at the wind's speed; still air at the speed of the body is the same as wind on a body at
/// rest.
#[test]
fn drag_depends_on_airspeed() {
    let airframe = Airframe::default();
    let wind = DVec3::new(3.0, -1.0, 0.5);
    let still = tumbling();
    let blown = QuadrotorState { velocity: still.velocity + wind, ..still };
    let (a, b) = (airframe.loads(&still, DVec3::ZERO), airframe.loads(&blown, wind));
    assert!(a.air.distance(b.air) < 1e-15 && a.torque.distance(b.torque) < 1e-17);
    // The force is against the speed through the air.
    assert!(a.air.dot(still.velocity) < 0.0);
}

#[test]
fn rotors_answer_with_their_time_constant() {
    let airframe = Airframe::default();
    let start = QuadrotorState::at(DVec3::ZERO);
    let step = airframe.rotor_lag / 50.0;
    let state = airframe.advance(&start, DVec4::splat(0.5), DVec3::ZERO, step, 50);
    let expected = 0.5 * airframe.rotor_speed * (1.0 - (-1.0f64).exp());
    assert!((state.rotors - DVec4::splat(expected)).abs().max_element() < 1e-4 * expected);
}

/// The world has no preferred heading: turned about the vertical, a flight is the same flight turned.
#[test]
fn turning_the_world_turns_the_flight() {
    let airframe = Airframe::default();
    let (wind, command) = (DVec3::new(2.0, 1.0, 0.3), DVec4::new(0.66, 0.68, 0.7, 0.67));
    let turn = DQuat::from_rotation_z(2.1);
    let state = tumbling();
    let turned = QuadrotorState {
        position: turn * state.position,
        velocity: turn * state.velocity,
        orientation: turn * state.orientation,
        ..state
    };
    let a = airframe.advance(&state, command, wind, 0.002, 300);
    let b = airframe.advance(&turned, command, turn * wind, 0.002, 300);
    assert!((turn * a.position).distance(b.position) < 1e-11);
    assert!((turn * a.velocity).distance(b.velocity) < 1e-11);
    assert!((turn * a.orientation).dot(b.orientation).abs() > 1.0 - 1e-12);
    assert!(a.angular_velocity.distance(b.angular_velocity) < 1e-10);
    assert!(a.position.distance(b.position) > 0.5);
}

/// Rotors stopped and no air: angular momentum in the world's axes and the energy of rotation stay.
#[test]
fn angular_momentum_and_energy_are_conserved() {
    let airframe = Airframe { air_density: 0.0, inertia: [1.4e-5, 1.9e-5, 2.5e-5], ..Airframe::default() };
    let inertia = DVec3::from_array(airframe.inertia);
    let start = QuadrotorState { rotors: DVec4::ZERO, ..tumbling() };
    let end = airframe.advance(&start, DVec4::ZERO, DVec3::ZERO, 0.002, 2_000);
    let momentum = |s: &QuadrotorState| s.orientation * (inertia * s.angular_velocity);
    let energy = |s: &QuadrotorState| s.angular_velocity.dot(inertia * s.angular_velocity);
    assert!(momentum(&end).distance(momentum(&start)) < 1e-8 * momentum(&start).length());
    assert!((energy(&end) / energy(&start) - 1.0).abs() < 1e-9);
    assert!((end.orientation.length() - 1.0).abs() < 1e-14);
    assert!(end.angular_velocity.distance(start.angular_velocity) > 0.5);
}

#[test]
fn halving_the_step_divides_the_error_by_sixteen() {
    let airframe = Airframe::default();
    let at = |steps: u32| {
        let command = DVec4::new(0.66, 0.68, 0.7, 0.67);
        airframe.advance(&tumbling(), command, DVec3::X, 0.6 / f64::from(steps), steps)
    };
    let reference = at(6_000);
    let error = |steps: u32| at(steps).position.distance(reference.position);
    let order = (error(30) / error(60)).log2();
    assert!((3.6..4.6).contains(&order), "{order}");
    // The default step.
    assert!(error(300) < 1e-8, "{:e}", error(300));
}

#[derive(Default)]
struct Kept {
    rows: Vec<Vec<f64>>,
    log: Vec<i64>,
    counts: [usize; 9],
    commands: Vec<[f64; 4]>,
    true_commands: Vec<[f64; 4]>,
}

impl Sink for Kept {
    fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        self.log.push(stamps.log);
        self.counts[topic] += 1;
        match (topic, reading) {
            (2, Reading::Numbers(command)) => self.commands.push(command.try_into()?),
            (8, Reading::Numbers(command)) => self.true_commands.push(command.try_into()?),
            _ => {}
        }
        Ok(())
    }

    fn row(&mut self, _stamp: i64, values: &[f64]) -> Result<(), SinkError> {
        self.rows.push(values.to_vec());
        Ok(())
    }
}

fn fly(parameters: &QuadrotorFlight, seconds: f64, seed: u64) -> (Kept, End) {
    let mut kept = Kept::default();
    let end = QuadrotorScenario::new(parameters).unwrap().run(Run { seconds, seed }, &mut kept).unwrap();
    (kept, end)
}

fn column(name: &str) -> usize {
    let scenario = QuadrotorScenario::new(&QuadrotorFlight::default()).unwrap();
    scenario.columns().iter().position(|column| column.name == name).unwrap()
}

/// Root mean square distance from the trajectory after the first 3 s, m.
fn tracking_error(kept: &Kept) -> f64 {
    let (x, target) = (column("x"), column("target_x"));
    let place = |row: &Vec<f64>, at: usize| DVec3::from_slice(&row[at..at + 3]);
    let rows = &kept.rows[1_500..];
    (rows.iter().map(|row| place(row, x).distance_squared(place(row, target))).sum::<f64>() / rows.len() as f64).sqrt()
}

#[test]
fn quadrotor_tracks_trajectory_in_wind() {
    let eight = Reference::FigureEight { centre: [0.0, 0.0, 1.5], amplitude: [1.2, 0.6, 0.2], period: 6.0 };
    for reference in [Reference::default(), eight, Reference::Hover { position: [0.0, 0.0, 1.0] }] {
        let parameters = QuadrotorFlight { reference, ..QuadrotorFlight::default() };
        let (kept, end) = fly(&parameters, 30.0, 2);
        assert_eq!((end, kept.rows.len()), (End::Complete, 15_000));
        let error = tracking_error(&kept);
        println!("{:?}: {error}", parameters.reference);
        assert!(error < 0.4, "{:?}: {error} m", parameters.reference);
        assert!((13..=16).map(|i| i - 1).all(|rotor| kept.rows.iter().all(|row| row[rotor] > 300.0)));
    }
}

/// Rows are consistent: m a = m g + R f_u + f_a, and differences of the states are the derivatives.
#[test]
fn rows_obey_the_equations() {
    let (kept, _) = fly(&QuadrotorFlight::default(), 4.0, 3);
    let [v, a, w, wd, q, thrust, fa] = ["vx", "ax", "wx", "wx_dot", "qx", "thrust", "fa_x"].map(column);
    let three = |row: &[f64], at: usize| DVec3::from_slice(&row[at..at + 3]);
    let mass = Airframe::default().mass;
    for pair in kept.rows.windows(2) {
        let row = &pair[0];
        let up = DQuat::from_slice(&row[q..q + 4]) * DVec3::Z;
        let force = up * row[thrust] + three(row, fa) - mass * GRAVITY * DVec3::Z;
        assert!(force.distance(mass * three(row, a)) < 1e-14);
        let difference = (three(&pair[1], v) - three(row, v)) / 0.002;
        // Largest change of an acceleration in a step: rotors at 2270 / 0.07 rad/s^2 at most.
        assert!(difference.distance(three(row, a)) < 0.5);
        let difference = (three(&pair[1], w) - three(row, w)) / 0.002;
        assert!(difference.distance(three(row, wd)) < 15.0);
    }
}

#[test]
fn messages_come_in_order_at_their_rates() {
    let (kept, _) = fly(&QuadrotorFlight::default(), 2.0, 5);
    assert!(kept.log.is_sorted());
    assert_eq!(kept.counts[..3], [1_000, 200, 1_000]);
    assert!((150..=200).contains(&kept.counts[3]));
    assert_eq!(kept.counts[4..], [1_000; 5]);
    let u = column("u_1");
    for commands in [&kept.commands, &kept.true_commands] {
        assert!(kept.rows.iter().zip(commands).all(|(row, command)| row[u..u + 4] == command[..]));
    }
}

#[test]
fn flights_repeat_and_sensors_leave_them_alone() {
    let parameters = QuadrotorFlight::default();
    let (a, b) = (fly(&parameters, 2.0, 11).0, fly(&parameters, 2.0, 11).0);
    assert!(a.rows == b.rows && a.log == b.log);
    assert_ne!(a.rows, fly(&parameters, 2.0, 12).0.rows);
    let mut slower = parameters.clone();
    slower.imu.period = 0.01;
    slower.mocap.faults.dropout_rate = 0.0;
    assert_eq!(a.rows, fly(&slower, 2.0, 11).0.rows);
    // The wind too has its own numbers: in a calm the commands are shaken alike, and the flight is another one.
    let calm = QuadrotorFlight { wind: Wind::calm(), ..parameters };
    assert_ne!(a.rows, fly(&calm, 2.0, 11).0.rows);
}

#[test]
fn storm_and_bad_parameters_are_faults() {
    let mut storm = QuadrotorFlight::default();
    storm.wind.mean = [40.0, 0.0, 0.0];
    let (kept, end) = fly(&storm, 20.0, 1);
    assert!(matches!(&end, End::Fault { seconds, .. } if (*seconds - kept.rows.len() as f64 * 0.002).abs() < 1e-9));
    let refused = |change: fn(&mut QuadrotorFlight)| {
        let mut parameters = QuadrotorFlight::default();
        change(&mut parameters);
        QuadrotorScenario::new(&parameters).unwrap_err().to_string()
    };
    assert!(refused(|p| p.imu.period = 0.003).starts_with("imu.period = 0.003: must be a multiple of row_period"));
    assert!(refused(|p| p.airframe.mass = 0.2).starts_with("airframe.rotor_speed = 2270"));
    assert!(refused(|p| p.airframe.inertia[2] = 1.0).starts_with("airframe.inertia"));
    assert!(refused(|p| p.wind.gust_correlation = 0.0).starts_with("wind.gust_correlation = 0"));
    let text = toml::to_string(&QuadrotorFlight::default()).unwrap();
    assert_eq!(toml::from_str::<QuadrotorFlight>(&text).unwrap(), QuadrotorFlight::default());
    let some: QuadrotorFlight = toml::from_str("[imu]\nposition = [0.01, 0.0, 0.0]").unwrap();
    assert_eq!(some.imu.period, 0.002);
    let text = "[reference]\nkind = \"hover\"\npositon = [0.0, 0.0, 1.0]";
    assert!(toml::from_str::<QuadrotorFlight>(text).is_err());
}

//! Whole runs.

use super::*;
use crate::excitation::{Axis, Excitation, Histogram, InverseSampling, RandomSteps, RandomWalk};
use crate::{End, Reading, Run, Scenario, Sink, SinkError, Stamps};

#[derive(Default)]
struct Record {
    rows: Vec<Vec<f64>>,
    stamps: Vec<i64>,
    messages: Vec<(usize, Stamps, String)>,
}

impl Sink for Record {
    fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        self.messages.push((topic, stamps, format!("{reading:?}")));
        Ok(())
    }

    fn row(&mut self, stamp: i64, values: &[f64]) -> Result<(), SinkError> {
        self.stamps.push(stamp);
        self.rows.push(values.to_vec());
        Ok(())
    }
}

/// Returns true if the sweeps have their full size (`make test-all`).
fn full() -> bool {
    std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full")
}

fn record(robot: &Wheeled, seconds: f64, seed: u64) -> (Record, End) {
    robot.validate().unwrap();
    let mut record = Record::default();
    let end = robot.run(Run { seconds, seed }, &mut record).unwrap();
    (record, end)
}

impl Record {
    fn column(&self, robot: &Wheeled, name: &str) -> Vec<f64> {
        let index = robot.columns().iter().position(|column| column.name == name).unwrap();
        self.rows.iter().map(|row| row[index]).collect()
    }
}

/// Largest distance of the robot's shell from the middle of the arena, m along either axis.
fn reach(record: &Record, robot: &Wheeled) -> f64 {
    let coordinates = [record.column(robot, "x"), record.column(robot, "y")].concat();
    coordinates.into_iter().fold(0.0, |most: f64, x| most.max(x.abs())) + robot.robot.chassis.radius
}

#[test]
fn five_minutes_by_default_without_touching_a_wall() {
    let robot = Wheeled::default();
    let (record, end) = record(&robot, 300.0, 1);
    assert_eq!((end, record.rows.len()), (End::Complete, 30_000));
    assert_eq!(record.column(&robot, "wall_contact").iter().sum::<f64>(), 0.0);
    let reach = reach(&record, &robot);
    assert!((1.7..2.0).contains(&reach), "{reach}");
    // It has been driven, in both directions and all over its range, and has slipped now and then.
    let (v, slip) = (record.column(&robot, "v"), record.column(&robot, "left_slip"));
    let share = |holds: &dyn Fn(usize) -> bool| (0..v.len()).filter(|&k| holds(k)).count() as f64 / v.len() as f64;
    assert!(share(&|k| v[k] > 0.4) > 0.15 && share(&|k| v[k] < -0.4) > 0.15);
    let slipping = share(&|k| slip[k].abs() > 0.03);
    assert!((0.01..0.3).contains(&slipping), "{slipping}");
}

#[test]
fn walls_stop_the_robot_and_the_bumper_reports() {
    let mut robot = Wheeled::default();
    robot.avoidance.enabled = false;
    robot.arena = Arena { scatter: 0.0, length: 1.2, width: 1.2, ..robot.arena };
    robot.commands.v = Excitation::Sine(crate::excitation::Sine { offset: 0.5, amplitude: 0.0, ..Default::default() });
    robot.commands.w = Excitation::None;
    let (record, end) = record(&robot, 5.0, 1);
    assert_eq!(end, End::Complete);
    let reach = reach(&record, &robot);
    assert!((0.599..0.602).contains(&reach), "{reach}");
    let contact = record.column(&robot, "wall_contact");
    // It is there after a second, and keeps pushing.
    assert!(contact[..50].iter().all(|&contact| contact == 0.0));
    assert!(contact[200..].iter().sum::<f64>() > 200.0);
    let bumps = record.messages.iter().filter(|(topic, _, _)| *topic == 5).collect::<Vec<_>>();
    assert_eq!((bumps[0].2.as_str(), bumps[1].2.as_str()), ("Flag(false)", "Flag(true)"));
    // Odometry counts wheels that spin at the wall as a way.
    assert!(record.column(&robot, "left_rate")[300..].iter().sum::<f64>() * 0.01 * 0.035 > 0.2);
}

#[test]
fn the_seed_decides_every_bit() {
    let robot = Wheeled::default();
    let runs = [3, 3, 4].map(|seed| record(&robot, 4.0, seed).0);
    assert_eq!(runs[0].rows, runs[1].rows);
    assert_eq!(runs[0].messages, runs[1].messages);
    assert_ne!(runs[0].rows, runs[2].rows);
    // A sensor's noise moves neither the physics nor the others'.
    let mut other = robot.clone();
    other.imu.gyroscope.noise = 0.1;
    let (other, _) = record(&other, 4.0, 3);
    assert_eq!(other.rows, runs[0].rows);
    let without_imu =
        |record: &Record| record.messages.iter().filter(|message| message.0 != 1).cloned().collect::<Vec<_>>();
    assert_eq!(without_imu(&other), without_imu(&runs[0]));
    assert_ne!(other.messages, runs[0].messages);
}

#[test]
fn messages_come_in_order_and_at_their_rates() {
    let robot = Wheeled::default();
    let (record, _) = record(&robot, 3.0, 5);
    assert!(record.messages.is_sorted_by(|a, b| a.1.log <= b.1.log));
    let count = |topic: usize| record.messages.iter().filter(|message| message.0 == topic).count();
    assert_eq!([0, 1, 2, 3, 4, 6, 7, 8, 9].map(count), [300, 300, 300, 60, 300, 300, 300, 300, 300]);
    assert_eq!(record.stamps[0], 1_735_689_600_000_000_000);
    assert!(record.stamps.windows(2).all(|pair| pair[1] - pair[0] == 10_000_000));
    assert!(record.rows.iter().all(|row| row.len() == robot.columns().len()));
}

#[test]
fn positions_are_the_integral_of_the_velocities() {
    let mut robot = Wheeled::default();
    robot.row_period = robot.step;
    let (record, _) = record(&robot, 5.0, 2);
    let [x, y, yaw, v, vy, w] = ["x", "y", "yaw", "v", "vy", "w"].map(|name| record.column(&robot, name));
    for k in 1..x.len() {
        let (sine, cosine) = yaw[k].sin_cos();
        // The engine's steps are semi-implicit: positions move by the velocities at the step's end. One step earlier, at 5 m/s^2 and
        // 30 rad/s^2, they would be off by 2e-5 and 1e-4.
        let step = [v[k] * cosine - vy[k] * sine, v[k] * sine + vy[k] * cosine, w[k]].map(|rate| rate * robot.step);
        let turned = (yaw[k] - yaw[k - 1] + 3.0).rem_euclid(std::f64::consts::TAU) - 3.0;
        let errors = [x[k] - x[k - 1] - step[0], y[k] - y[k - 1] - step[1], turned - step[2]];
        assert!(errors.iter().all(|error| error.abs() < 1e-5), "{k}: {errors:?}");
    }
}

#[test]
fn a_top_heavy_robot_tips_over_and_the_run_ends() {
    let mut robot = Wheeled::default();
    robot.robot.chassis.centre_of_mass = [-0.002, 0.6];
    robot.commands.v = Excitation::Prbs(crate::excitation::Prbs { amplitude: 0.9, ..Default::default() });
    let (record, end) = record(&robot, 20.0, 1);
    let End::Fault { seconds, reason } = end else { panic!("{end:?}") };
    assert!(reason.starts_with("tipped over") && (0.05..20.0).contains(&seconds), "{seconds}: {reason}");
    assert_eq!(record.rows.len(), (seconds / robot.row_period).ceil() as usize);
}

#[test]
fn inverse_sampling_visits_speeds_more_uniformly_than_random_references() {
    let mean = |commands: Excitation| {
        let mut robot = Wheeled { step: 5e-3, ..Wheeled::default() };
        robot.arena.walls = false;
        robot.commands.v_limit = 2.0;
        robot.commands.v = commands;
        let seconds = if full() { 200.0 } else { 70.0 };
        let seeds = [0, 1].map(|seed| {
            let (record, _) = record(&robot, seconds, seed);
            let mut visits = Histogram::new([Axis { low: -1.0, high: 1.0, bins: 20 }]);
            record.column(&robot, "v").into_iter().for_each(|v| visits.add(&[v]));
            visits.nonuniformity()
        });
        0.5 * (seeds[0] + seeds[1])
    };
    let (shortest, longest) = (0.4, 1.2);
    let inverse = InverseSampling { shortest, longest, resampling: 1.0, ..InverseSampling::default() };
    let inverse = mean(Excitation::InverseSampling(inverse));
    let steps = mean(Excitation::RandomSteps(RandomSteps { shortest, longest, ..RandomSteps::default() }));
    let walk = mean(Excitation::RandomWalk(RandomWalk::default()));
    assert!(inverse < 0.8 * steps && inverse < 0.8 * walk, "{inverse} {steps} {walk}");
}

#[test]
fn a_world_file_may_hold_a_part_of_a_table() {
    let robot: Wheeled = toml::from_str("[robot.motor]\nsupply_voltage = 3.0\n[imu]\nperiod = 0.002\n").unwrap();
    assert_eq!(robot.robot.motor.gear_ratio, Wheeled::default().robot.motor.gear_ratio);
    assert_eq!((robot.robot.motor.supply_voltage, robot.imu.period), (3.0, 0.002));
    let text = toml::to_string(&Wheeled::default()).unwrap();
    assert_eq!(toml::from_str::<Wheeled>(&text).unwrap(), Wheeled::default());
    let error = toml::from_str::<Wheeled>("[robot.motor]\nvoltage = 3.0\n").unwrap_err().to_string();
    assert!(error.contains("voltage"), "{error}");
    let bad = Wheeled { row_period: 0.011, ..Wheeled::default() };
    assert!(bad.validate().unwrap_err().to_string().contains("row_period = 0.011"));
    let mut bad = Wheeled::default();
    bad.commands.w = Excitation::Sine(crate::excitation::Sine { frequency: 30.0, ..Default::default() });
    assert!(bad.validate().unwrap_err().to_string().starts_with("commands.w.frequency = 30"));
}

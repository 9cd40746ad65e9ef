//! Runs of the experiment, and their independence of irrelevant settings.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use super::layout;
use super::recorder::wrapped;
use super::*;
use crate::excitation::Sine;
use crate::{End, Excitation, Kind, Reading, Run, Scenario, Sink, SinkError, Stamps};

/// Columns of a row.
const PHASES: [usize; 2] = [6, 7];
const RATES: [usize; 2] = [14, 15];
const INPUTS: [usize; 2] = [16, 17];
const BELT: usize = 18;

#[derive(Default)]
struct Log {
    rows: Vec<(i64, Vec<f64>)>,
    /// Topic, stamps, and the numbers of a reading.
    messages: Vec<(usize, Stamps, Vec<f64>)>,
}

impl Sink for Log {
    fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        let values = match reading {
            Reading::Twist { linear, angular } => vec![linear.x, angular.z],
            Reading::Joints { position, velocity, effort } => [position, velocity, effort].concat(),
            Reading::Numbers(numbers) => numbers.to_vec(),
            Reading::Imu { angular_velocity, linear_acceleration } => {
                [angular_velocity.to_array(), linear_acceleration.to_array()].concat()
            }
            Reading::Pose { position, .. } => position.to_array().to_vec(),
            Reading::Odometry { position, linear_velocity, .. } => {
                [position.to_array(), linear_velocity.to_array()].concat()
            }
            Reading::Light(light) => vec![light],
            other => panic!("no topic carries {other:?}"),
        };
        self.messages.push((topic, stamps, values));
        Ok(())
    }

    fn row(&mut self, stamp: i64, values: &[f64]) -> Result<(), SinkError> {
        self.rows.push((stamp, values.to_vec()));
        Ok(())
    }
}

fn run(scenario: &HexapodTreadmill, seconds: f64, seed: u64) -> (Log, End) {
    scenario.validate().unwrap();
    let mut log = Log::default();
    let end = scenario.run(Run { seconds, seed }, &mut log).unwrap();
    (log, end)
}

fn short() -> HexapodTreadmill {
    let mut scenario = HexapodTreadmill { settle: 0.5, ..HexapodTreadmill::default() };
    scenario.belt.speed = 0.15;
    scenario.belt.ramp = 0.3;
    scenario
}

fn of_topic(log: &Log, topic: usize) -> Vec<&(usize, Stamps, Vec<f64>)> {
    log.messages.iter().filter(|message| message.0 == topic).collect()
}

#[test]
fn seed_decides_every_bit() {
    let scenario = short();
    let (once, end) = run(&scenario, 0.4, 1);
    assert_eq!(end, End::Complete);
    assert_eq!(once.rows.len(), 400);
    assert!(once.rows.iter().all(|(_, row)| row.len() == layout::WIDTH && row.iter().all(|v| v.is_finite())));
    let (again, _) = run(&scenario, 0.4, 1);
    assert_eq!(once.rows, again.rows);
    assert_eq!(once.messages, again.messages);
    assert_ne!(once.rows, run(&scenario, 0.4, 2).0.rows);
    // Sensors that only the log reads do not change the run; sensors of the controller do.
    let mut deaf = scenario.clone();
    deaf.imu.gyroscope.noise *= 3.0;
    deaf.telemetry_latency.mean *= 2.0;
    deaf.clocks.robot.skew = 0.0;
    let (other, _) = run(&deaf, 0.4, 1);
    assert_eq!(once.rows, other.rows);
    assert_ne!(once.messages, other.messages);
    let mut blurred = scenario.clone();
    blurred.mocap.orientation_noise *= 10.0;
    assert_ne!(once.rows, run(&blurred, 0.4, 1).0.rows);
}

#[test]
fn topics_keep_rates_and_stamp_order() {
    let (mut scenario, seconds) = (short(), 0.5);
    scenario.mocap.faults.dropout_rate = 0.0;
    let (log, _) = run(&scenario, seconds, 3);
    assert!(log.messages.is_sorted_by_key(|message| message.1.log));
    let topics = scenario.topics();
    for (index, topic) in topics.iter().enumerate() {
        let messages = of_topic(&log, index);
        let slow = topic.name.starts_with("/mocap") || topic.name == "/cmd_vel";
        // The wave begins after half a second.
        let expected = if topic.name == "/controller/sync" {
            0
        } else if slow {
            50
        } else {
            500
        };
        assert_eq!(messages.len(), expected, "{}", topic.name);
        if messages.is_empty() {
            continue;
        }
        let mut headers: Vec<i64> = messages.iter().map(|message| message.1.header).collect();
        headers.sort_unstable();
        assert!(headers.is_sorted_by(|a, b| a < b), "{}: stamps repeat", topic.name);
        let width = match &topic.kind {
            Kind::Joints(names) if topic.name == "/truth/cranks" => 3 * names.len(),
            Kind::Joints(names) => 2 * names.len(),
            Kind::Numbers(names) => names.len(),
            _ => messages[0].2.len(),
        };
        assert!(messages.iter().all(|message| message.2.len() == width), "{}", topic.name);
    }
    // The truth's messages are the rows.
    for ((stamp, row), message) in log.rows.iter().zip(of_topic(&log, layout::TRUTH_COMMAND)) {
        assert_eq!((message.1.header, &message.2[..]), (*stamp, &row[INPUTS[0]..=INPUTS[1]]));
    }
    let columns: Vec<String> = scenario.columns().into_iter().map(|column| column.name).collect();
    assert_eq!(columns[scenario.regressors().states..][..scenario.regressors().inputs], ["u_v", "u_w"]);
}

/// The truth that no sensor tells: rates are the change of the velocities between rows, of a robot whose feet do not hit the ground meanwhile; flags are those of the poses that are far off; the gyroscope says
/// the rate with the bias.
#[test]
fn rates_biases_and_flags_are_true() {
    let mut scenario = short();
    scenario.mocap.faults.outlier_rate = 10.0;
    scenario.mocap.faults.dropout_rate = 5.0;
    (scenario.clocks.mocap.jitter, scenario.clocks.robot.jitter) = (0.0, 0.0);
    scenario.clocks.robot.skew = 0.0;
    let (log, _) = run(&scenario, 1.0, 4);
    let columns: Vec<String> = scenario.columns().into_iter().map(|column| column.name).collect();
    let column = |name: &str| columns.iter().position(|known| known == name).unwrap();
    // Impacts last shorter than a row, so that some rows differ: half of them lie close.
    for (velocity, rate) in [("wx", "wx_dot"), ("vz", "vz_dot"), ("alpha_l_rate", "alpha_l_rate_dot")] {
        let (velocity, rate) = (column(velocity), column(rate));
        let size = log.rows.iter().map(|(_, row)| row[rate].abs()).sum::<f64>() / log.rows.len() as f64;
        let mut errors: Vec<f64> = log
            .rows
            .windows(3)
            .map(|rows| ((rows[2].1[velocity] - rows[0].1[velocity]) / 0.002 - rows[1].1[rate]).abs())
            .collect();
        errors.sort_by(f64::total_cmp);
        assert!(errors[errors.len() / 2] < 0.1 * size, "{} of {size}", errors[errors.len() / 2]);
    }
    let poses = of_topic(&log, layout::MOCAP_POSE);
    let by_time: BTreeMap<i64, &Vec<f64>> = log.rows.iter().map(|(stamp, row)| (*stamp, row)).collect();
    let start = log.rows[0].0;
    let mut outliers = 0;
    for (_, stamps, position) in &poses {
        // The motion capture's clock to true time, to the next row.
        let shown = stamps.header - start + 40_000_000;
        let row = by_time[&(start + (shown as f64 / (1.0 - 10e-6) / 1e7).round() as i64 * 10_000_000)];
        let off = (0..3).map(|axis| (position[axis] - row[axis]).powi(2)).sum::<f64>().sqrt();
        assert_eq!(off > 0.1, row[column("mocap_outlier")] == 1.0, "{off}");
        outliers += usize::from(off > 0.1);
    }
    assert!(outliers > 2 && poses.len() < 100, "{outliers} of {}", poses.len());
    let missing = log.rows.iter().filter(|(_, row)| row[column("mocap_missing")] == 1.0).count();
    assert_eq!(missing, 100 - poses.len());
    let (bias, rate) = (column("gyro_bias_x"), column("wx"));
    let readings = of_topic(&log, layout::IMU);
    let errors = readings.iter().zip(&log.rows).map(|(reading, (_, row))| reading.2[0] - row[rate] - row[bias]);
    let variance = errors.map(|error| error * error).sum::<f64>() / readings.len() as f64;
    let expected = scenario.imu.gyroscope.noise.powi(2) + (scenario.imu.gyroscope.range / 32_768.0).powi(2) / 12.0;
    assert!((variance / expected - 1.0).abs() < 5.0 * (2.0 / readings.len() as f64).sqrt(), "{variance} {expected}");
}

/// Between the two stamps of a switch the lamp was switched, by the controller's clock.
#[test]
fn controller_records_lamp_switches() {
    let scenario = short();
    let (log, _) = run(&scenario, 2.2, 1);
    let switches = of_topic(&log, layout::CONTROLLER_SYNC);
    assert_eq!(switches.len(), 8);
    for (index, pair) in (0..).zip(switches.chunks(2)) {
        let moment = log.rows[0].0 + 500_381_966 + index * 503_618_034;
        let [before, after] = [pair[0].1.header, pair[1].1.header];
        assert!(before < moment && moment < after && after - before < 400_000, "{before} {moment} {after}");
        let lit = f64::from(u8::from(index % 2 == 0));
        assert_eq!([pair[0].2[0], pair[1].2[0]], [1.0 - lit, lit]);
    }
}

#[test]
fn recorded_input_equals_applied_command() {
    let mut scenario = short();
    scenario.command_latency = 0.004;
    scenario.clocks.controller.jitter = 0.0;
    scenario.mocap.faults.dropout_rate = 0.0;
    // A command that changes at every sample.
    scenario.excitation.velocity = Excitation::Sine(Sine { amplitude: 0.05, frequency: 7.0, ..Sine::default() });
    let (log, _) = run(&scenario, 0.3, 5);
    let sent: Vec<(i64, Vec<f64>)> =
        of_topic(&log, layout::COMMAND).iter().map(|message| (message.1.header, message.2.clone())).collect();
    let mut changes = 0;
    for (stamp, row) in &log.rows {
        let Some((_, held)) = sent.iter().rev().find(|(at, _)| at + 4_000_000 <= *stamp) else { continue };
        assert_eq!(held[..], row[INPUTS[0]..=INPUTS[1]], "at {stamp}");
        changes += usize::from(sent.iter().any(|(at, _)| at + 4_000_000 == *stamp));
    }
    assert!(changes > 25, "{changes}");
}

#[test]
fn slow_robot_ends_the_log() {
    let mut scenario = short();
    scenario.belt.speed = 3.0;
    scenario.belt.ramp = 0.6;
    let (log, end) = run(&scenario, 10.0, 1);
    let End::Fault { seconds, reason } = end else { panic!("{end:?}") };
    assert!(reason.contains("belt over its rear end") || reason.contains("fell over"), "{reason}");
    assert!(seconds < 2.0 && log.rows.len() == (seconds * 1000.0).round() as usize, "{seconds} {}", log.rows.len());
    assert!(of_topic(&log, layout::TRUTH_ODOMETRY).len() == log.rows.len(), "what was sent is delivered");
}

#[test]
fn failing_starts_are_retried_a_limited_number_of_times() {
    let mut scenario = short();
    scenario.belt.speed = 3.0;
    scenario.start.retries = 2;
    scenario.settle = 5.0;
    let (log, end) = run(&scenario, 1.0, 1);
    let End::Fault { seconds, reason } = end else { panic!("{end:?}") };
    assert!(seconds == 0.0 && reason.starts_with("before the log began, the robot"), "{reason}");
    assert!(log.rows.is_empty() && log.messages.is_empty());
}

/// Mean and length of the phase's resultant, stride frequency, and the speed over the belt against equation (2)'s for the cranks as they turned.
struct Gait {
    phase: f64,
    gathered: f64,
    frequency: f64,
    against_no_slip: f64,
}

fn gait(speed: f64, seed: u64) -> Gait {
    let mut scenario = HexapodTreadmill::default();
    scenario.belt.speed = speed;
    let (log, end) = run(&scenario, 4.0, seed);
    assert_eq!(end, End::Complete, "{speed} m/s");
    let rows = log.rows.len() as f64;
    let mean = |f: &dyn Fn(&[f64]) -> f64| log.rows.iter().map(|(_, row)| f(row)).sum::<f64>() / rows;
    let phase = |row: &[f64]| wrapped(row[PHASES[0]] - row[PHASES[1]] + PI);
    let (cosine, sine) = (mean(&|row| phase(row).cos()), mean(&|row| phase(row).sin()));
    let no_slip = mean(&|row| scenario.drive().velocity([row[RATES[0]], row[RATES[1]]])[0]);
    Gait {
        phase: sine.atan2(cosine),
        gathered: cosine.hypot(sine),
        frequency: mean(&|row| 0.5 * (row[RATES[0]] + row[RATES[1]])) / TAU,
        against_no_slip: mean(&|row| row[BELT]) / no_slip,
    }
}

#[test]
fn the_gait_is_real() {
    let [slow, middle, fast] = [0.1, 0.25, 0.4].map(|speed| gait(speed, 1));
    // Fig. 5: free cranks find the alternating tripod at the paper's most stable speed.
    assert!(middle.gathered > 0.8 && middle.phase.abs() < 0.3, "{} at {}", middle.gathered, middle.phase);
    assert!(
        1.5 * slow.frequency < middle.frequency && 1.2 * middle.frequency < fast.frequency,
        "{} {} {}",
        slow.frequency,
        middle.frequency,
        fast.frequency
    );
    assert!((3.5..6.5).contains(&middle.frequency), "about 5 Hz at 0.25 m/s (III-A): {}", middle.frequency);
    assert!((0.7..0.99).contains(&middle.against_no_slip), "slower than without slip: {}", middle.against_no_slip);
}

#[test]
fn world_files_hold_every_parameter_and_errors_name_theirs() {
    let scenario = HexapodTreadmill::default();
    scenario.validate().unwrap();
    let text = toml::to_string(&scenario).unwrap();
    assert_eq!(toml::from_str::<HexapodTreadmill>(&text).unwrap(), scenario);
    let some: HexapodTreadmill = toml::from_str("[belt]\nspeed = 0.4\n[crank]\nproportional = 0.1\n").unwrap();
    assert_eq!((some.belt.speed, some.belt.length), (0.4, scenario.belt.length));
    assert_eq!(some.crank.feedforward, scenario.crank.feedforward);
    assert!(toml::from_str::<HexapodTreadmill>("[belt]\nsped = 0.4\n").is_err());
    let some: HexapodTreadmill = toml::from_str("[hexapod.linkage]\narc_radius = 0.02\n").unwrap();
    assert_eq!(some.hexapod.linkage.swing_amplitude, scenario.hexapod.linkage.swing_amplitude);
    assert_eq!(some.hexapod.linkage.arc_radius, 0.02);
    let refused = |change: &dyn Fn(&mut HexapodTreadmill)| {
        let mut scenario = HexapodTreadmill::default();
        change(&mut scenario);
        scenario.validate().unwrap_err().to_string()
    };
    assert!(refused(&|s| s.belt.length = 0.0).starts_with("belt.length = 0: must be"));
    assert!(refused(&|s| s.controller.period = 0.0001).starts_with("controller.period = 0.0001: must be a multiple"));
    assert!(refused(&|s| s.crank.integral = f64::NAN).starts_with("crank.integral = NaN"));
    // A lamp that blinks once a second does not tell 0.6 s ahead from 0.4 s behind.
    assert!(
        refused(&|s| s.clocks.robot.offset = 0.6)
            .starts_with("clocks.robot.offset = 0.6: must be less than 0.503618034 s")
    );
    assert!(refused(&|s| s.mocap.period = f64::NAN).starts_with("mocap.period = NaN"));
    assert!(refused(&|s| s.hexapod.trunk.mass = -1.0).starts_with("hexapod.trunk.mass = -1"));
    assert!(
        refused(&|s| s.excitation.velocity = Excitation::Sine(Sine { frequency: 60.0, ..Sine::default() }))
            .starts_with("excitation.velocity.frequency = 60")
    );
}

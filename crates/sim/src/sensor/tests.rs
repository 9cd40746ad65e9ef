//! Sensors together: information in a log of two computers about their clocks, and independence of the sensors.

use glam::{DQuat, DVec3};

use super::*;
use crate::{Reading, Sink, SinkError, Stamps};

const MILLISECOND: i64 = 1_000_000;

/// Topics of the log below.
const ROBOT_SYNC: usize = 0;
const MOCAP_SYNC: usize = 1;
const IMU: usize = 2;
const JOINTS: usize = 3;
const MOCAP: usize = 4;

/// Messages received on each topic: stamps and numbers.
#[derive(Debug, Default, Clone, PartialEq)]
struct Log {
    topics: [Vec<(Stamps, Vec<f64>)>; 5],
    last: Option<i64>,
}

impl Sink for Log {
    fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        assert!(self.last.is_none_or(|last| last <= stamps.log));
        self.last = Some(stamps.log);
        let numbers = match reading {
            Reading::Light(light) => vec![light],
            Reading::Imu { angular_velocity, linear_acceleration } => {
                [angular_velocity.to_array(), linear_acceleration.to_array()].concat()
            }
            Reading::Joints { position, velocity, .. } => [position, velocity].concat(),
            Reading::Pose { position, orientation } => {
                [position.to_array().as_slice(), &orientation.to_array()].concat()
            }
            other => panic!("{other:?}"),
        };
        self.topics[topic].push((stamps, numbers));
        Ok(())
    }
}

/// A body that swings about the upright axis, logged for some milliseconds without the topics that are switched `off`.
fn record(parameters: &ClocksParameters, milliseconds: i64, seed: u64, off: &[usize]) -> Log {
    parameters.validate().unwrap();
    let clocks = parameters.clocks();
    let wave = SyncWave::new(&SyncWaveParameters::default(), clocks.controller);
    let mut robot = clocks.robot.stamper(seed, "robot");
    let mut camera = clocks.mocap.stamper(seed, "mocap");
    let mut link = Latency::new(&LatencyParameters { minimum: 0.0005, mean: 0.001, maximum: 0.004 }, seed, "robot");
    let mut imu = Imu::new(&ImuParameters::default(), 9.81, seed, "imu");
    let mut encoder = Encoder::new(&EncoderParameters::default(), seed, "left_crank");
    let mut mocap = Mocap::new(&MocapParameters::default(), seed, "mocap");
    let (mut outbox, mut log) = (Outbox::new(), Log::default());
    for millisecond in 0..milliseconds {
        let time = millisecond * MILLISECOND;
        outbox.flush_until(clocks.controller.read(time), &mut log).unwrap();
        let mut send = |topic, stamps, reading: Reading<'_>| {
            if !off.contains(&topic) {
                outbox.push(topic, stamps, reading);
            }
        };
        let seconds = time as f64 * 1e-9;
        let orientation = DQuat::from_rotation_z(0.2 * seconds.sin());
        let stamps = Stamps { header: robot.stamp(time), log: clocks.controller.read(link.arrival(time)) };
        send(ROBOT_SYNC, stamps, wave.reading(time));
        if !off.contains(&IMU) {
            let angular_velocity = DVec3::new(0.0, 0.0, 0.2 * seconds.cos());
            let motion = BodyMotion { orientation, linear_velocity: DVec3::ZERO, angular_velocity };
            send(IMU, stamps, imu.sample(motion).reading());
        }
        if !off.contains(&JOINTS) {
            let crank = encoder.sample(30.0 * seconds);
            send(JOINTS, stamps, Reading::Joints { position: &[crank.angle], velocity: &[crank.rate], effort: &[] });
        }
        if millisecond % 10 == 0 {
            let frame = mocap.sample(time, DVec3::new(0.0, 0.0, 0.02), orientation);
            let stamps = Stamps { header: camera.stamp(time), log: clocks.controller.read(frame.arrival) };
            if let Some(pose) = frame.pose {
                send(MOCAP, stamps, pose.reading());
            }
            send(MOCAP_SYNC, stamps, wave.reading(time));
        }
    }
    outbox.finish(&mut log).unwrap();
    log
}

/// Offset (s, at the run's beginning) and skew of a clock against the wave's, by least squares over the edges: an edge lies between the last
/// stamp before it and the first after it.
fn align(messages: &[(Stamps, Vec<f64>)], epoch: i64) -> (f64, f64) {
    let SyncWaveParameters { period, delay, .. } = SyncWaveParameters::default();
    let (half, delay) = (0.5e9 * period, 1e9 * delay);
    let edges: Vec<(f64, f64)> = messages
        .windows(2)
        .filter(|pair| pair[0].1[0] != pair[1].1[0])
        .map(|pair| {
            let seen = (pair[0].0.header + pair[1].0.header) / 2 - epoch;
            let driven = delay + ((seen as f64 - delay) / half).round() * half;
            (driven * 1e-9, (seen as f64 - driven) * 1e-9)
        })
        .collect();
    let count = edges.len() as f64;
    let mean = edges.iter().fold((0.0, 0.0), |sum, edge| (sum.0 + edge.0 / count, sum.1 + edge.1 / count));
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in edges {
        xx += (x - mean.0).powi(2);
        xy += (x - mean.0) * (y - mean.1);
    }
    (mean.1 - xy / xx * mean.0, xy / xx)
}

#[test]
fn the_square_wave_aligns_the_clocks() {
    let parameters = ClocksParameters::default();
    let seconds = 120;
    let log = record(&parameters, seconds * 1000, 11, &[IMU, JOINTS, MOCAP]);
    let epoch = parameters.epoch * 1_000_000_000;
    for (topic, clock, period) in [(ROBOT_SYNC, &parameters.robot, 0.001), (MOCAP_SYNC, &parameters.mocap, 0.01)] {
        let (offset, skew) = align(&log.topics[topic], epoch);
        // An edge is known to half a sample either way, and where edges fall in the sampling differs: five deviations of a line at its beginning and of its slope.
        let deviation = (period / 12.0_f64.sqrt()).hypot(clock.jitter) / (2.0 * seconds as f64).sqrt();
        assert!((offset - clock.offset).abs() < 10.0 * deviation, "{offset} {clock:?}");
        let bound = 5.0 * deviation * 12.0_f64.sqrt() / seconds as f64 * 1e6;
        assert!((skew * 1e6 - clock.skew).abs() < bound, "{} {clock:?}", skew * 1e6);
    }
}

#[test]
fn logs_repeat_and_seeds_differ() {
    let parameters = ClocksParameters::default();
    let log = record(&parameters, 2000, 5, &[]);
    assert_eq!(log, record(&parameters, 2000, 5, &[]));
    assert_eq!(log.topics.each_ref().map(|messages| messages.len() >= 190), [true; 5]);
    let other = record(&parameters, 2000, 6, &[]);
    for (a, b) in log.topics[IMU..].iter().zip(&other.topics[IMU..]) {
        assert!(a.iter().zip(b).filter(|(a, b)| a.1 == b.1).count() < a.len() / 50);
    }
}

#[test]
fn disabled_sensor_leaves_others_unchanged() {
    let parameters = ClocksParameters::default();
    let whole = record(&parameters, 2000, 5, &[]);
    for off in [IMU, JOINTS, MOCAP] {
        let without = record(&parameters, 2000, 5, &[off]);
        assert!(without.topics[off].is_empty());
        for topic in (0..5).filter(|&topic| topic != off) {
            assert_eq!(whole.topics[topic], without.topics[topic], "{topic} without {off}");
        }
    }
}

#[test]
fn headers_increase_strictly_on_every_topic() {
    let log = record(&ClocksParameters::default(), 5000, 8, &[]);
    for messages in &log.topics {
        assert!(messages.is_sorted_by(|a, b| a.0.header < b.0.header));
    }
}

#[test]
fn partial_clock_table_keeps_defaults() {
    let clocks: ClocksParameters =
        toml::from_str("epoch = 0\n[robot]\noffset = 0.5\n[mocap]\nskew = 3.0\n[controller]\nskew = 1.0").unwrap();
    let default = ClocksParameters::default();
    assert_eq!(clocks.robot, ClockParameters { offset: 0.5, ..default.robot.clone() });
    assert_eq!(clocks.controller, ClockParameters { skew: 1.0, ..ClockParameters::default() });
    assert_eq!(clocks.mocap, ClockParameters { skew: 3.0, ..default.mocap.clone() });
    assert!(toml::from_str::<ClocksParameters>("[robot]\noffst = 0.5").unwrap_err().to_string().contains("offst"));
    let written = toml::to_string(&default).unwrap();
    assert_eq!(toml::from_str::<ClocksParameters>(&written).unwrap(), default);
    let error = ClocksParameters { epoch: -1, ..default.clone() }.validate().unwrap_err();
    assert_eq!((error.name.as_str(), error.value.as_str()), ("epoch", "-1"));
    let mut wrong = default;
    wrong.mocap.jitter = -1.0;
    assert_eq!(wrong.validate().unwrap_err().name, "mocap.jitter");
}

#[test]
fn parameters_are_toml_both_ways() {
    fn round<T: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug + Default>() {
        let written = toml::to_string(&T::default()).unwrap();
        assert_eq!(toml::from_str::<T>(&written).unwrap(), T::default());
        assert!(toml::from_str::<T>("no_such_parameter = 1").is_err());
    }
    round::<ImuParameters>();
    round::<EncoderParameters>();
    round::<MocapParameters>();
    round::<SyncWaveParameters>();
    round::<LatencyParameters>();
    let imu: ImuParameters = toml::from_str("[accelerometer]\nbits = 13").unwrap();
    let expected = AccelerometerParameters { bits: 13, ..AccelerometerParameters::default() };
    assert_eq!((imu.accelerometer, imu.gyroscope), (expected, GyroscopeParameters::default()));
}

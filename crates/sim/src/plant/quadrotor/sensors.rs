//! Measurements of a flight that are logged.

use glam::{DQuat, DVec3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::instant::Instant;
use super::parameters::{Odometry, QuadrotorFlight};
use crate::sensor::{BodyMotion, Clocks, Imu, Latency, Mocap, Outbox, Stamper, stream};
use crate::{Kind, Reading, Sink, SinkError, Stamps, Topic};

const IMU: usize = 0;
const ODOMETRY: usize = 1;
const COMMAND: usize = 2;
const MOCAP: usize = 3;
const TRUE_ODOMETRY: usize = 4;
const TRUE_ROTORS: usize = 5;
const TRUE_WIND: usize = 6;
const TRUE_AIR_FORCE: usize = 7;
const TRUE_COMMAND: usize = 8;

/// One way from a sensor to the log.
struct Line {
    stamper: Stamper,
    latency: Latency,
}

pub(super) struct Sensors {
    clocks: Clocks,
    outbox: Outbox,
    imu: (u64, Imu, Line),
    odometry: (u64, Odometry, Pcg64, Line),
    command: Line,
    mocap: (u64, Mocap, Stamper),
}

impl Sensors {
    pub(super) fn topics(parameters: &QuadrotorFlight) -> Vec<Topic> {
        let topic = |name: &str, kind, frame: &str| Topic { name: name.to_owned(), kind, frame: frame.to_owned() };
        let labels = |name: &str| (1..=4).map(|i| format!("{name}_{i}")).collect();
        let odometry = || Kind::Odometry { child_frame: "base_link".to_owned() };
        vec![
            topic("/imu/data", parameters.imu.kind(), "imu_link"),
            topic("/odom", odometry(), "odom"),
            topic("/motor/command", Kind::Numbers(labels("u")), ""),
            topic("/mocap/pose", Kind::Pose, "map"),
            topic("/truth/odometry", odometry(), "map"),
            topic("/truth/rotors", Kind::Numbers(labels("rotor")), ""),
            topic("/truth/wind", Kind::Vector, "map"),
            topic("/truth/air_force", Kind::Vector, "map"),
            topic("/truth/command", Kind::Numbers(labels("u")), ""),
        ]
    }

    pub(super) fn new(parameters: &QuadrotorFlight, seed: u64) -> Self {
        let clocks = parameters.clocks.clocks();
        let line = |name: &str| Line {
            stamper: clocks.robot.stamper(seed, name),
            latency: Latency::new(&parameters.link, seed, name),
        };
        // Multiples, as `validate` has made sure of.
        let rows = |period: f64| (period / parameters.row_period).round() as u64;
        let gravity = crate::plant::atmosphere::GRAVITY;
        Self {
            imu: (rows(parameters.imu.period), Imu::new(&parameters.imu, gravity, seed, "imu"), line("imu")),
            odometry: (
                rows(parameters.odometry.period),
                parameters.odometry.clone(),
                stream(seed, "odometry/noise"),
                line("odometry"),
            ),
            command: line("command"),
            mocap: (
                rows(parameters.mocap.period),
                Mocap::new(&parameters.mocap, seed, "mocap"),
                clocks.mocap.stamper(seed, "mocap"),
            ),
            outbox: Outbox::new(),
            clocks,
        }
    }

    /// The stamp of the truth at a true time in ns since the run's beginning.
    pub(super) fn true_stamp(&self, time: i64) -> i64 {
        self.clocks.truth.read(time)
    }

    /// Measures at row `index`, true time `time` (ns), and logs what has arrived by then.
    pub(super) fn sense(&mut self, index: u64, time: i64, now: &Instant, sink: &mut dyn Sink) -> Result<(), SinkError> {
        self.outbox.flush_until(self.clocks.controller.read(time), sink)?;
        let state = &now.state;
        let rate = state.orientation * state.angular_velocity;
        if index.is_multiple_of(self.imu.0) {
            let sample = self.imu.1.sample(BodyMotion {
                orientation: state.orientation,
                linear_velocity: state.velocity,
                angular_velocity: rate,
            });
            send(&mut self.outbox, &self.clocks, &mut self.imu.2, IMU, time, sample.reading());
        }
        if index.is_multiple_of(self.odometry.0) {
            let reading = estimate(&self.odometry.1, &mut self.odometry.2, now);
            send(&mut self.outbox, &self.clocks, &mut self.odometry.3, ODOMETRY, time, reading);
        }
        let command = now.command.to_array();
        send(&mut self.outbox, &self.clocks, &mut self.command, COMMAND, time, Reading::Numbers(&command));
        if index.is_multiple_of(self.mocap.0) {
            // A stamp for every sample, lost or not, so that dropouts move no other's.
            let header = self.mocap.2.stamp(time);
            let frame = self.mocap.1.sample(time, state.position, state.orientation);
            if let Some(pose) = frame.pose {
                let stamps = Stamps { header, log: self.clocks.controller.read(frame.arrival) };
                self.outbox.push(MOCAP, stamps, pose.reading());
            }
        }
        self.tell_truth(time, now);
        Ok(())
    }

    fn tell_truth(&mut self, time: i64, now: &Instant) {
        let state = &now.state;
        let stamps = Stamps { header: self.true_stamp(time), log: self.clocks.controller.read(time) };
        let motion = Reading::Odometry {
            position: state.position,
            orientation: state.orientation,
            linear_velocity: state.orientation.conjugate() * state.velocity,
            angular_velocity: state.angular_velocity,
        };
        self.outbox.push(TRUE_ODOMETRY, stamps, motion);
        self.outbox.push(TRUE_ROTORS, stamps, Reading::Numbers(&state.rotors.to_array()));
        self.outbox.push(TRUE_WIND, stamps, Reading::Vector(now.wind));
        self.outbox.push(TRUE_AIR_FORCE, stamps, Reading::Vector(now.loads.air));
        self.outbox.push(TRUE_COMMAND, stamps, Reading::Numbers(&now.command.to_array()));
    }

    /// Logs what is still on its way.
    pub(super) fn finish(self, sink: &mut dyn Sink) -> Result<(), SinkError> {
        self.outbox.finish(sink)
    }
}

fn send(outbox: &mut Outbox, clocks: &Clocks, line: &mut Line, topic: usize, time: i64, reading: Reading<'_>) {
    let log = clocks.controller.read(line.latency.arrival(time));
    outbox.push(topic, Stamps { header: line.stamper.stamp(time), log }, reading);
}

fn estimate(odometry: &Odometry, random: &mut Pcg64, now: &Instant) -> Reading<'static> {
    let state = &now.state;
    let mut noise =
        |deviation: f64| deviation * DVec3::from_array(std::array::from_fn(|_| StandardNormal.sample(random)));
    let turned = DQuat::from_scaled_axis(noise(odometry.orientation_noise));
    Reading::Odometry {
        position: state.position + noise(odometry.position_noise),
        orientation: state.orientation * turned,
        linear_velocity: state.orientation.conjugate() * state.velocity + noise(odometry.velocity_noise),
        angular_velocity: state.angular_velocity + noise(odometry.rate_noise),
    }
}

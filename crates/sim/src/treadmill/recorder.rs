//! Recording of events as messages and rows.

use glam::DVec3;

use super::layout;
use super::parameters::HexapodTreadmill;
use crate::sensor::{self, BodyMotion, Clocks, Imu, Latency, MocapFrame, Outbox, Stamper, SyncWave};
use crate::{HexapodState, Reading, Sink, SinkError, Stamps};

/// True values at an instant.
pub(super) struct Instant {
    /// True time, ns.
    pub(super) now: i64,
    pub(super) state: HexapodState,
    /// The command that the robot follows, m/s and rad/s.
    pub(super) command: [f64; 2],
    pub(super) belt_speed: f64,
    /// Travel of the belt since the log began, m.
    pub(super) belt_way: f64,
    pub(super) voltage: [f64; 2],
    pub(super) torque: [f64; 2],
    pub(super) feet: [bool; 6],
    /// Rates of change of the states' velocities: [`HexapodState::rates_at_its_instant`].
    pub(super) rates: [f64; 8],
    /// Of the motion capture's sample of this instant: whether it is wrong, and whether there is none.
    pub(super) mocap: [bool; 2],
}

/// Sensors that only the log hears, stamps, and messages on their way.
pub(super) struct Recorder {
    clocks: Clocks,
    imu: Imu,
    sync: SyncWave,
    telemetry: Latency,
    stampers: Stampers,
    outbox: Outbox,
    /// Of gyroscope and accelerometer in the last sample, rad/s and m/s^2.
    biases: [DVec3; 2],
}

/// One a computer's task.
struct Stampers {
    imu: Stamper,
    encoders: Stamper,
    robot_sync: Stamper,
    command: Stamper,
    mocap: Stamper,
    controller_sync: Stamper,
}

impl Recorder {
    pub(super) fn new(scenario: &HexapodTreadmill, seed: u64) -> Self {
        let clocks = scenario.clocks.clocks();
        Self {
            imu: Imu::new(&scenario.imu, scenario.hexapod.gravity, seed, "imu"),
            sync: SyncWave::new(&scenario.sync, clocks.controller),
            telemetry: Latency::new(&scenario.telemetry_latency, seed, "telemetry"),
            stampers: Stampers {
                imu: clocks.robot.stamper(seed, "imu"),
                encoders: clocks.robot.stamper(seed, "encoders"),
                robot_sync: clocks.robot.stamper(seed, "robot_sync"),
                command: clocks.controller.stamper(seed, "command"),
                mocap: clocks.mocap.stamper(seed, "mocap"),
                controller_sync: clocks.controller.stamper(seed, "controller_sync"),
            },
            outbox: Outbox::new(),
            biases: [DVec3::ZERO; 2],
            clocks,
        }
    }

    /// The inertial unit's sample; logged unless the log has not begun.
    pub(super) fn imu(&mut self, now: i64, state: &HexapodState) {
        self.biases = self.imu.biases().into();
        let sample = self.imu.sample(BodyMotion {
            orientation: state.orientation,
            linear_velocity: state.linear_velocity,
            angular_velocity: state.angular_velocity,
        });
        if now >= 0 {
            let header = self.stampers.imu.stamp(now);
            let stamps = self.telemetry(now, header);
            self.outbox.push(layout::IMU, stamps, sample.reading());
        }
    }

    /// Records the robot computer's readings of cranks and lamp, and its voltages for the motors.
    pub(super) fn robot(&mut self, now: i64, seen: &[sensor::EncoderSample; 2], voltage: [f64; 2]) {
        let header = self.stampers.encoders.stamp(now);
        let stamps = self.telemetry(now, header);
        let joints = Reading::Joints {
            position: &seen.map(|sample| sample.angle),
            velocity: &seen.map(|sample| sample.rate),
            effort: &[],
        };
        self.outbox.push(layout::JOINT_STATES, stamps, joints);
        self.outbox.push(layout::VOLTAGE, stamps, Reading::Numbers(&voltage));
        let stamps = Stamps { header: self.stampers.robot_sync.stamp(now), log: stamps.log };
        self.outbox.push(layout::ROBOT_SYNC, stamps, self.sync.reading(now));
    }

    /// A frame of the motion capture. The lamp is seen whether or not the body is.
    pub(super) fn mocap(&mut self, now: i64, frame: &MocapFrame) {
        let stamps = Stamps { header: self.stampers.mocap.stamp(now), log: self.clocks.controller.read(frame.arrival) };
        self.outbox.push(layout::MOCAP_SYNC, stamps, self.sync.reading(now));
        if let Some(pose) = &frame.pose {
            self.outbox.push(layout::MOCAP_POSE, stamps, pose.reading());
        }
    }

    /// The controller's program, which drives the lamp, looks at its clock before and after it switches it.
    pub(super) fn lamp(&mut self, before: i64, now: i64) {
        let Some((level, moment)) = self.sync.switched(before, now) else { return };
        let [earlier, later] = self.stampers.controller_sync.around(moment);
        let log = self.clocks.controller.read(now);
        for (header, light) in [(earlier, self.sync.level(before)), (later, level)] {
            self.outbox.push(layout::CONTROLLER_SYNC, Stamps { header, log }, Reading::Light(light));
        }
    }

    /// The controller sends a command.
    pub(super) fn command(&mut self, now: i64, command: [f64; 2]) {
        let header = self.stampers.command.stamp(now);
        let stamps = Stamps { header, log: self.clocks.controller.read(now) };
        self.outbox.push(layout::COMMAND, stamps, Reading::planar_twist(command));
    }

    fn telemetry(&mut self, now: i64, header: i64) -> Stamps {
        Stamps { header, log: self.clocks.controller.read(self.telemetry.arrival(now)) }
    }

    /// The truth, as messages and as a row.
    pub(super) fn truth(&mut self, at: &Instant, sink: &mut dyn Sink) -> Result<(), SinkError> {
        let (now, state) = (at.now, &at.state);
        let stamps = Stamps { header: self.clocks.truth.read(now), log: self.clocks.controller.read(now) };
        let (linear, angular) = (state.body_linear_velocity(), state.body_angular_velocity());
        let cranks = state.crank_angle.map(wrapped);
        let flag = |is: bool| f64::from(u8::from(is));
        let (feet, mocap) = (at.feet.map(flag), at.mocap.map(flag));
        let (outbox, [rate_bias, force_bias]) = (&mut self.outbox, self.biases);
        let odometry = Reading::Odometry {
            position: state.position,
            orientation: state.orientation,
            linear_velocity: linear,
            angular_velocity: angular,
        };
        outbox.push(layout::TRUTH_ODOMETRY, stamps, odometry);
        let joints = Reading::Joints { position: &cranks, velocity: &state.crank_rate, effort: &at.torque };
        outbox.push(layout::TRUTH_CRANKS, stamps, joints);
        outbox.push(layout::TRUTH_COMMAND, stamps, Reading::planar_twist(at.command));
        let belt = Reading::Joints { position: &[at.belt_way], velocity: &[at.belt_speed], effort: &[] };
        outbox.push(layout::TRUTH_BELT, stamps, belt);
        outbox.push(layout::TRUTH_FEET, stamps, Reading::Numbers(&feet));
        outbox.push(layout::TRUTH_RATES, stamps, Reading::Numbers(&at.rates));
        let biases = Reading::Imu { angular_velocity: rate_bias, linear_acceleration: force_bias };
        outbox.push(layout::TRUTH_IMU_BIAS, stamps, biases);
        outbox.push(layout::TRUTH_MOCAP, stamps, Reading::Numbers(&mocap));
        let mut row = [0.0; layout::WIDTH];
        row[0..3].copy_from_slice(&state.position.to_array());
        row[3..6].copy_from_slice(&state.yaw_pitch_roll());
        row[6..8].copy_from_slice(&cranks);
        row[8..11].copy_from_slice(&linear.to_array());
        row[11..14].copy_from_slice(&angular.to_array());
        row[14..16].copy_from_slice(&state.crank_rate);
        row[16..18].copy_from_slice(&at.command);
        row[18] = at.belt_speed;
        row[19..21].copy_from_slice(&at.voltage);
        row[21..23].copy_from_slice(&at.torque);
        row[23..29].copy_from_slice(&feet);
        row[29..37].copy_from_slice(&at.rates);
        row[37..40].copy_from_slice(&rate_bias.to_array());
        row[40..43].copy_from_slice(&force_bias.to_array());
        row[43..45].copy_from_slice(&mocap);
        sink.row(stamps.header, &row)
    }

    /// Delivers what is logged before now.
    pub(super) fn flush(&mut self, now: i64, sink: &mut dyn Sink) -> Result<(), SinkError> {
        self.outbox.flush_until(self.clocks.controller.read(now), sink)
    }

    /// Delivers what is still on its way.
    pub(super) fn finish(self, sink: &mut dyn Sink) -> Result<(), SinkError> {
        self.outbox.finish(sink)
    }
}

/// The same angle in [-pi, pi).
pub(super) fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    // A remainder that rounds up to a whole turn.
    if turned < PI { turned } else { -PI }
}

//! One run of the wheeled robot.

use std::f64::consts::PI;

use fleetfoot_control::controller::PidState;
use glam::{DQuat, DVec3};
use rand::RngExt;

use super::avoidance::AvoidanceState;
use super::parameters::{COMMANDS, SHOWN};
use super::topics::{
    BUMPER, COMMAND, IMU, JOINTS, ODOMETRY, TRUE_COMMAND, TRUE_ODOMETRY, TRUE_VOLTAGE, TRUE_WHEELS, VOLTAGE,
};
use super::{Inputs, WheelOdometry, Wheeled, WheeledState, WheeledWorld};
use crate::excitation::Signal;
use crate::regulated::Regulated;
use crate::sensor::{BodyMotion, Clock, Encoder, Imu, Latency, Outbox, Stamper, stream};
use crate::{End, Reading, Sink, SinkError, Stamps};

/// A run: the world, the robot's programs, and its log.
pub(super) struct WheeledRun<'a> {
    parameters: &'a Wheeled,
    world: WheeledWorld,
    signals: [Signal; 2],
    avoidance: AvoidanceState,
    regulator: Option<Regulated>,
    /// Of the wheels, as the encoders say, rad/s.
    rates: [f64; 2],
    encoders: [Encoder; 2],
    controllers: [PidState; 2],
    odometry: WheelOdometry,
    imu: Imu,
    log: Log,
    /// Forward velocity, m/s, and yaw rate, rad/s.
    command: [f64; 2],
    /// Left and right, V.
    voltage: [f64; 2],
    touching: bool,
}

/// Messages on their way, stamped.
struct Log {
    outbox: Outbox,
    truth: Clock,
    clock: Clock,
    /// Of the topics that the robot makes, in their order.
    links: Vec<(Stamper, Latency)>,
}

impl Log {
    fn new(parameters: &Wheeled, seed: u64) -> Self {
        let epoch = parameters.epoch * 1_000_000_000;
        let clock = Clock::new(&parameters.clock, epoch);
        let link = |name: &&str| (clock.stamper(seed, name), Latency::new(&parameters.latency, seed, name));
        let links = ["odometry", "imu", "joints", "command", "voltage", "bumper"].iter().map(link).collect();
        Self { outbox: Outbox::new(), truth: Clock::perfect(epoch), clock, links }
    }

    /// Sends what was made at a true time, ns.
    fn send(&mut self, topic: usize, time: i64, reading: Reading<'_>) {
        let stamps = match self.links.get_mut(topic) {
            Some((stamper, latency)) => {
                Stamps { header: stamper.stamp(time), log: self.clock.read(latency.arrival(time)) }
            }
            None => Stamps { header: self.truth.read(time), log: self.clock.read(time) },
        };
        self.outbox.push(topic, stamps, reading);
    }
}

impl<'a> WheeledRun<'a> {
    /// The robot stands where its run begins. The parameters have passed [`Wheeled::validate`].
    pub(super) fn new(parameters: &'a Wheeled, seed: u64) -> Self {
        let Wheeled { robot, arena, commands, encoder, imu, .. } = parameters;
        let mut world = WheeledWorld::new(robot, arena, parameters.gravity, parameters.step, start(parameters, seed));
        for _ in 0..(parameters.settle / parameters.step).round() as u64 {
            world.step([0.0; 2]);
        }
        let distance = robot.chassis.radius + parameters.avoidance.margin;
        let half = if arena.walls { arena.free(distance) } else { [f64::INFINITY; 2] };
        Self {
            parameters,
            world,
            signals: [("v", &commands.v), ("w", &commands.w)]
                .map(|(name, signal)| Signal::new(signal, commands.period, stream(seed, &format!("commands/{name}")))),
            avoidance: AvoidanceState::new(&parameters.avoidance, half),
            regulator: parameters.regulator.as_ref().map(|law| Regulated::new(law, &SHOWN, &COMMANDS)),
            rates: [0.0; 2],
            encoders: ["left_encoder", "right_encoder"].map(|name| Encoder::new(encoder, seed, name)),
            controllers: [PidState::default(); 2],
            odometry: WheelOdometry::new(parameters.drive()),
            imu: Imu::new(imu, parameters.gravity, seed, "imu"),
            log: Log::new(parameters, seed),
            command: [0.0; 2],
            voltage: [0.0; 2],
            touching: false,
        }
    }

    /// Runs for `seconds`: rows from time 0 on, the last before the end.
    pub(super) fn run(mut self, seconds: f64, sink: &mut dyn Sink) -> Result<End, SinkError> {
        let parameters = self.parameters;
        let every = |period: f64| parameters.steps(period);
        let (encoder, imu) = (every(parameters.encoder.period), every(parameters.imu.period));
        let (row, command) = (every(parameters.row_period), every(parameters.commands.period));
        let count = (seconds / parameters.step).round() as u64;
        for k in 0..count {
            let time = (k as f64 * parameters.step * 1e9).round() as i64;
            let state = self.world.state();
            if k.is_multiple_of(encoder) {
                self.measure(&state, time);
            }
            if k.is_multiple_of(command) {
                self.refer(&state, time);
            }
            if k.is_multiple_of(encoder) {
                self.control(time);
            }
            if k.is_multiple_of(imu) {
                self.feel(&state, time);
            }
            self.bump(k == 0, time);
            if k.is_multiple_of(row) {
                self.tell(&state, time, sink)?;
            }
            self.log.outbox.flush_until(self.log.clock.read(time), sink)?;
            self.world.step(self.voltage);
            if let Some(reason) = self.fault() {
                self.log.outbox.finish(sink)?;
                return Ok(End::Fault { seconds: (k + 1) as f64 * parameters.step, reason });
            }
        }
        self.log.outbox.finish(sink)?;
        Ok(End::Complete)
    }

    /// Encoders, and what the robot makes of them.
    fn measure(&mut self, state: &WheeledState, time: i64) {
        let samples = [0, 1].map(|side| self.encoders[side].sample(state.wheel_angle[side]));
        let (turned, rate) = (samples.map(|sample| sample.turned), samples.map(|sample| sample.rate));
        self.odometry.update(turned, rate);
        self.rates = rate;
        let [x, y, yaw] = self.odometry.pose();
        let [v, w] = self.odometry.velocity();
        let odometry = Reading::Odometry {
            position: DVec3::new(x, y, 0.0),
            orientation: DQuat::from_rotation_z(yaw),
            linear_velocity: DVec3::new(v, 0.0, 0.0),
            angular_velocity: DVec3::new(0.0, 0.0, w),
        };
        self.log.send(ODOMETRY, time, odometry);
        self.log.send(JOINTS, time, Reading::Joints { position: &turned, velocity: &rate, effort: &[] });
    }

    /// The next references, by the pose that a localisation without error would know.
    fn refer(&mut self, state: &WheeledState, time: i64) {
        let commands = &self.parameters.commands;
        let [v, w] = self.odometry.velocity();
        let [forward, turning] = &mut self.signals;
        let turn = turning.next(w).clamp(-commands.w_limit, commands.w_limit);
        let velocity = forward.next(v).clamp(-commands.v_limit, commands.v_limit);
        let pose @ [x, y, yaw] = [state.position.x, state.position.y, state.yaw()];
        self.command = match &mut self.regulator {
            Some(regulator) => {
                let (mut command, [left, right]) = (self.command, self.rates);
                regulator.command(time as f64 * 1e-9, &[x, y, yaw, v, w, left, right], &mut command);
                let [v, w] = command;
                [v.clamp(-commands.v_limit, commands.v_limit), w.clamp(-commands.w_limit, commands.w_limit)]
            }
            None => [self.avoidance.command(velocity, turn, forward.levels(), pose), turn],
        };
        self.log.send(COMMAND, time, Reading::planar_twist(self.command));
    }

    /// The wheels' controllers.
    fn control(&mut self, time: i64) {
        let parameters = self.parameters;
        let [v, w] = self.command;
        let [speed, turn] = self.odometry.velocity();
        let (wanted, measured) = (parameters.drive().rates(v, w), parameters.drive().rates(speed, turn));
        let period = parameters.encoder.period;
        self.voltage = [0, 1].map(|side| {
            let voltage = self.controllers[side].update(&parameters.controller, wanted[side], measured[side], period);
            parameters.robot.motor.limited(voltage)
        });
        self.log.send(VOLTAGE, time, Reading::Numbers(&self.voltage));
    }

    fn feel(&mut self, state: &WheeledState, time: i64) {
        let WheeledState { orientation, linear_velocity, angular_velocity, .. } = *state;
        let sample = self.imu.sample(BodyMotion { orientation, linear_velocity, angular_velocity });
        self.log.send(IMU, time, sample.reading());
    }

    fn bump(&mut self, first: bool, time: i64) {
        let touching = self.world.touching();
        if first || touching != self.touching {
            self.log.send(BUMPER, time, Reading::Flag(touching));
        }
        self.touching = touching;
    }

    /// The truth, as messages and as a row.
    fn tell(&mut self, state: &WheeledState, time: i64, sink: &mut dyn Sink) -> Result<(), SinkError> {
        let truth = Reading::Odometry {
            position: state.position,
            orientation: state.orientation,
            linear_velocity: state.orientation.conjugate() * state.linear_velocity,
            angular_velocity: state.orientation.conjugate() * state.angular_velocity,
        };
        self.log.send(TRUE_ODOMETRY, time, truth);
        let wheels = Reading::Joints { position: &state.wheel_angle, velocity: &state.wheel_rate, effort: &[] };
        self.log.send(TRUE_WHEELS, time, wheels);
        self.log.send(TRUE_COMMAND, time, Reading::planar_twist(self.command));
        self.log.send(TRUE_VOLTAGE, time, Reading::Numbers(&self.voltage));
        let [v, vy] = state.planar_velocity();
        let ([left, right], wheel) = (state.wheel_rate, &self.parameters.robot.wheel);
        let slip = state.slip(wheel.radius, wheel.track);
        let (first, second) = match self.parameters.inputs {
            Inputs::Velocity => (self.command, self.voltage),
            Inputs::Voltage => (self.voltage, self.command),
        };
        let touching = f64::from(u8::from(self.touching));
        let row = [
            state.position.x,
            state.position.y,
            state.yaw(),
            v,
            vy,
            state.yaw_rate(),
            left,
            right,
            first[0],
            first[1],
            second[0],
            second[1],
            slip[0],
            slip[1],
            touching,
        ];
        sink.row(self.log.truth.read(time), &row)
    }

    fn fault(&self) -> Option<String> {
        if !self.world.is_sound() {
            return Some("the physics has diverged; a smaller step may help".to_owned());
        }
        let tilt = self.world.state().tilt();
        (tilt > self.parameters.tilt_limit).then(|| format!("tipped over: leans {tilt:.2} rad"))
    }
}

/// Pose at the beginning of a run, by its seed: `[x, y, yaw]`.
fn start(parameters: &Wheeled, seed: u64) -> [f64; 3] {
    let mut random = stream(seed, "start");
    let mut uniform = || 2.0 * random.random::<f64>() - 1.0;
    let arena = &parameters.arena;
    let [x, y] = arena.free(parameters.robot.chassis.radius + parameters.avoidance.margin);
    [x, y, PI].map(|most| arena.scatter * most * uniform())
}

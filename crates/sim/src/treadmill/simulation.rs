//! One run of the experiment.

use fleetfoot_data::Column;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};

use super::belt::Belt;
use super::desk::Desk;
use super::layout;
use super::onboard::Onboard;
use super::parameters::HexapodTreadmill;
use super::recorder::{Instant, Recorder};
use crate::sensor::{self, Mocap, nanoseconds};
use crate::{End, HexapodState, HexapodWorld, Regressors, Run, Scenario, Sink, SinkError, Topic};

impl Scenario for HexapodTreadmill {
    fn topics(&self) -> Vec<Topic> {
        layout::topics(self)
    }

    fn columns(&self) -> Vec<Column> {
        layout::columns()
    }

    fn regressors(&self) -> Regressors {
        layout::REGRESSORS
    }

    fn row_period(&self) -> f64 {
        self.row_period
    }

    fn run(&self, run: Run, sink: &mut dyn Sink) -> Result<End, SinkError> {
        let mut retries = (0..self.start.retries).map(|retry| {
            let purpose = format!("start/retry/{retry}");
            sensor::stream(run.seed, &purpose).next_u64()
        });
        let mut seed = run.seed;
        loop {
            let mut simulation = Simulation::new(self, seed);
            match (simulation.settle(sink)?, retries.next()) {
                (None, _) => return simulation.log(run.seconds, sink),
                // The experimenter puts the robot on the belt again.
                (Some(_), Some(next)) => seed = next,
                (Some(reason), None) => {
                    return Ok(End::Fault { seconds: 0.0, reason: format!("before the log began, {reason}") });
                }
            }
        }
    }
}

/// Physics steps between what happens now and then.
struct Every {
    row: i64,
    command: i64,
    crank: i64,
    imu: i64,
    encoder: i64,
    mocap: i64,
}

struct Simulation<'a> {
    scenario: &'a HexapodTreadmill,
    world: HexapodWorld,
    belt: Belt,
    mocap: Mocap,
    desk: Desk,
    robot: Onboard,
    recorder: Recorder,
    every: Every,
    /// Length of a physics step, ns.
    step: i64,
    /// Physics steps before the log begins.
    settle: i64,
    voltage: [f64; 2],
    belt_speed: f64,
    belt_way: f64,
}

impl<'a> Simulation<'a> {
    fn new(scenario: &'a HexapodTreadmill, seed: u64) -> Self {
        let mut world = HexapodWorld::new(&scenario.hexapod);
        let mut random = sensor::stream(seed, "start");
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let [x, y] = [scenario.start.place * normal(), scenario.start.place * normal()];
        let yaw = scenario.start.yaw * normal();
        let turn = || Uniform::new(-std::f64::consts::PI, std::f64::consts::PI).ok();
        let crank_angle = [0, 1].map(|_| turn().map_or(0.0, |turn| turn.sample(&mut random)));
        world.place(x, y, yaw, crank_angle);
        let every = Every {
            row: scenario.steps(scenario.row_period),
            command: scenario.steps(scenario.controller.period),
            crank: scenario.steps(scenario.crank.period),
            imu: scenario.steps(scenario.imu.period),
            encoder: scenario.steps(scenario.encoder.period),
            mocap: scenario.steps(scenario.mocap.period),
        };
        Self {
            belt: Belt::new(&scenario.belt, scenario.crank.period, sensor::stream(seed, "belt")),
            mocap: Mocap::new(&scenario.mocap, seed, "mocap"),
            desk: Desk::new(scenario, seed),
            robot: Onboard::new(scenario, seed),
            recorder: Recorder::new(scenario, seed),
            step: nanoseconds(scenario.hexapod.step),
            settle: scenario.steps_before_the_log(),
            voltage: [0.0; 2],
            belt_speed: 0.0,
            belt_way: 0.0,
            every,
            world,
            scenario,
        }
    }

    /// The robot runs for a while before the log begins, at time 0. Gives why it cannot go on, if it cannot.
    fn settle(&mut self, sink: &mut dyn Sink) -> Result<Option<String>, SinkError> {
        for index in -self.settle..0 {
            if let Some(reason) = self.advance(index, sink)? {
                return Ok(Some(reason));
            }
        }
        Ok(None)
    }

    /// Runs for as long as the log is to be.
    fn log(mut self, seconds: f64, sink: &mut dyn Sink) -> Result<End, SinkError> {
        let mut end = End::Complete;
        for index in 0..nanoseconds(seconds.max(0.0)) / self.step {
            if let Some(reason) = self.advance(index, sink)? {
                end = End::Fault { seconds: (index * self.step) as f64 * 1e-9, reason };
                break;
            }
        }
        self.recorder.finish(sink)?;
        Ok(end)
    }

    /// One physics step with all that happens at its beginning; or why there is none.
    fn advance(&mut self, index: i64, sink: &mut dyn Sink) -> Result<Option<String>, SinkError> {
        let now = index * self.step;
        let state = self.world.state();
        if index % self.every.crank == 0
            && let Some(reason) = self.fault(&state)
        {
            return Ok(Some(reason));
        }
        let mocap = self.think(index, now, &state);
        let is_row = now >= 0 && index % self.every.row == 0;
        let at = is_row.then(|| self.instant(now, state, mocap));
        self.world.step(self.voltage);
        // Velocities of this instant are known once the step behind it is done.
        let after = self.world.state();
        let moving = state.with_velocities_of_its_instant(&after);
        if index % self.every.imu == 0 {
            self.recorder.imu(now, &moving);
        }
        if let Some(at) = at {
            let rates = state.rates_at_its_instant(&after, self.scenario.hexapod.step);
            self.recorder.truth(&Instant { state: moving, rates, ..at }, sink)?;
            self.recorder.flush(now, sink)?;
        }
        if now >= 0 {
            self.belt_way += self.belt_speed * self.scenario.hexapod.step;
        }
        Ok(None)
    }

    /// Everything that decides at this instant, from the sensors to the voltages. What the motion capture's sample is: wrong, missing.
    fn think(&mut self, index: i64, now: i64, state: &HexapodState) -> [bool; 2] {
        let since_start = (index + self.settle) as f64 * self.scenario.hexapod.step;
        let (due, logged) = (|every: i64| index % every == 0, now >= 0);
        let mut faults = [false; 2];
        if due(self.every.mocap) {
            let frame = self.mocap.sample(now, state.position, state.orientation);
            self.desk.send(&frame);
            if logged {
                self.recorder.mocap(now, &frame);
            }
            faults = [frame.pose.is_some_and(|pose| pose.outlier), frame.pose.is_none()];
        }
        if logged {
            self.recorder.lamp(now - self.step, now);
        }
        if due(self.every.command) {
            let motion = [state.body_linear_velocity().x, state.body_angular_velocity().z];
            let command = self.desk.command(now, self.belt.commanded(since_start), motion);
            self.robot.send(now, command);
            if logged {
                self.recorder.command(now, command);
            }
        }
        self.robot.receive(now);
        let looked = due(self.every.encoder);
        if looked {
            self.robot.look(state.crank_angle);
        }
        if due(self.every.crank) {
            self.voltage = self.robot.voltages();
            self.belt_speed = self.belt.next(since_start);
            self.world.set_belt_speed(self.belt_speed);
        }
        if looked && logged {
            self.recorder.robot(now, &self.robot.seen, self.voltage);
        }
        faults
    }

    /// True values now, but for the velocities of this instant.
    fn instant(&self, now: i64, state: HexapodState, mocap: [bool; 2]) -> Instant {
        Instant {
            now,
            state,
            command: self.robot.command,
            belt_speed: self.belt_speed,
            belt_way: self.belt_way,
            voltage: self.voltage,
            torque: self.world.motor_torque(),
            feet: self.world.feet_down(),
            rates: [0.0; 8],
            mocap,
        }
    }

    /// Why the run cannot go on.
    fn fault(&self, state: &HexapodState) -> Option<String> {
        let belt = &self.scenario.belt;
        let (x, y) = (state.position.x, state.position.y);
        if !state.is_finite() || self.world.quarantined() {
            return Some("the physics diverged, as the motion of a body is not finite: try a smaller step".to_owned());
        }
        if x.abs() > 0.5 * belt.length {
            let end = if x > 0.0 { "front" } else { "rear" };
            return Some(format!("the robot left the belt over its {end} end, at x = {x:.3} m"));
        }
        if y.abs() > 0.5 * belt.width {
            let side = if y > 0.0 { "left" } else { "right" };
            return Some(format!("the robot left the belt over its {side} side, at y = {y:.3} m"));
        }
        let up = (state.orientation * glam::DVec3::Z).z;
        let tilt = up.clamp(-1.0, 1.0).acos();
        (tilt > self.scenario.greatest_tilt).then(|| format!("the robot fell over: it leans by {tilt:.2} rad"))
    }
}

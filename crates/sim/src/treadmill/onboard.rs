//! The robot's computer: from a velocity command to the motors' voltages.

use std::collections::VecDeque;

use fleetfoot_control::controller::{DifferentialDrive, Pid, PidState};

use super::crank_control::CrankControl;
use super::parameters::HexapodTreadmill;
use crate::excitation::Signal;
use crate::sensor::{self, Encoder, EncoderSample, nanoseconds};

/// The robot's computer.
pub(super) struct Onboard {
    control: CrankControl,
    pid: Pid,
    drive: DifferentialDrive,
    /// Commands on their way: arrival in ns, velocity and yaw rate.
    coming: VecDeque<(i64, [f64; 2])>,
    latency: i64,
    pub(super) command: [f64; 2],
    encoders: [Encoder; 2],
    pub(super) seen: [EncoderSample; 2],
    states: [PidState; 2],
    /// Angles that the commands add up to, once there is a first.
    references: Option<[f64; 2]>,
    excitation: [Signal; 2],
}

impl Onboard {
    pub(super) fn new(scenario: &HexapodTreadmill, seed: u64) -> Self {
        let excitation = &scenario.excitation;
        let signal = |excitation: &crate::Excitation, purpose: &str| {
            excitation.signal(scenario.crank.period, sensor::stream(seed, purpose))
        };
        Self {
            control: scenario.crank.clone(),
            pid: scenario.crank.pid(scenario.hexapod.motor.supply_voltage),
            drive: scenario.drive(),
            coming: VecDeque::new(),
            latency: nanoseconds(scenario.command_latency),
            command: [0.0; 2],
            encoders: ["encoder/left", "encoder/right"].map(|name| Encoder::new(&scenario.encoder, seed, name)),
            seen: [EncoderSample { code: 0, angle: 0.0, turned: 0.0, rate: 0.0 }; 2],
            states: [PidState::default(); 2],
            references: None,
            excitation: [
                signal(&excitation.left_crank, "excitation/left_crank"),
                signal(&excitation.right_crank, "excitation/right_crank"),
            ],
        }
    }

    /// A command leaves the controller.
    pub(super) fn send(&mut self, now: i64, command: [f64; 2]) {
        self.coming.push_back((now + self.latency, command));
    }

    /// Takes the last command that has arrived by `now`.
    pub(super) fn receive(&mut self, now: i64) {
        while self.coming.front().is_some_and(|(arrival, _)| *arrival <= now) {
            if let Some((_, command)) = self.coming.pop_front() {
                self.command = command;
            }
        }
    }

    /// The encoders look.
    pub(super) fn look(&mut self, crank_angle: [f64; 2]) {
        self.seen = [0, 1].map(|side| self.encoders[side].sample(crank_angle[side]));
    }

    /// The voltages until the next call.
    pub(super) fn voltages(&mut self) -> [f64; 2] {
        let rates = self.drive.rates(self.command[0], self.command[1]);
        let seen = self.seen;
        let references = self.references.get_or_insert_with(|| seen.map(|sample| sample.turned));
        let mut voltages = [0.0; 2];
        for side in 0..2 {
            let rate = rates[side] + self.excitation[side].next(seen[side].rate);
            let lag = references[side] - seen[side].turned;
            let wanted = self.control.position.mul_add(lag, rate);
            voltages[side] = self.states[side].update(&self.pid, wanted, seen[side].rate, self.control.period);
            references[side] += rate * self.control.period;
        }
        voltages
    }
}

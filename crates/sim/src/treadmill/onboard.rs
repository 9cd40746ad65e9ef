//! The robot's own computer: from a velocity command to the motors' voltages.

use std::collections::VecDeque;

use fleetfoot_dynamics::controller::{DifferentialDrive, Pid, PidState};
use serde::{Deserialize, Serialize};

use super::parameters::HexapodTreadmill;
use crate::excitation::Signal;
use crate::parameter_error::{not_negative, positive};
use crate::sensor::{self, Encoder, EncoderSample, nanoseconds};
use crate::{DcMotor, ParameterError};

/// Control of a crank's position and velocity, II-C: a [`Pid`] on the rate, whose reference may be pulled towards the angle that the commands
/// so far add up to.
///
/// A position gain, or an integral, ties each crank to its command's sum, and so the phase between the cranks to the steering: the more of it,
/// the less the legs find a gait of their own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CrankControl {
    /// Seconds between outputs.
    pub period: f64,
    /// Rate asked for a radian of lag behind the commands' sum, 1/s; 0: velocity alone is controlled.
    pub position: f64,
    /// Of the rate's error, V s/rad.
    pub proportional: f64,
    /// Of the rate's error, V/rad.
    pub integral: f64,
    /// Of the measured rate's derivative, V s^2/rad.
    pub derivative: f64,
    /// Of the rate that is asked for, V s/rad.
    pub feedforward: f64,
    /// Time constant of the derivative's filter, s; 0: none.
    pub derivative_filter: f64,
}

impl Default for CrankControl {
    /// 1 kHz as in II-B; the feedforward is the default motor's back-EMF. The gain is low: a stiff loop would keep the phase between the cranks that
    /// steering gives them.
    fn default() -> Self {
        let motor = DcMotor::default();
        Self {
            period: 1e-3,
            position: 0.0,
            proportional: 0.005,
            integral: 0.0,
            derivative: 0.0,
            feedforward: motor.gear_ratio * motor.torque_constant,
            derivative_filter: 0.0,
        }
    }
}

impl CrankControl {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        positive("period", self.period)?;
        not_negative("position", self.position)?;
        self.pid(f64::MAX).validate()
    }

    /// From rates in rad/s to a voltage that the supply can give.
    fn pid(&self, supply_voltage: f64) -> Pid {
        Pid {
            proportional: self.proportional,
            integral: self.integral,
            derivative: self.derivative,
            feedforward: self.feedforward,
            derivative_filter: self.derivative_filter,
            lowest: -supply_voltage,
            highest: supply_voltage,
        }
    }
}

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

    /// What has arrived by now is the command.
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

//! The wheeled robot's world file.

use fleetfoot_control::controller::{DifferentialDrive, Pid, Regulator};
use serde::{Deserialize, Serialize};

use super::defaults::{self, default_encoder, default_imu, default_latency, default_pid};
use super::{Arena, Avoidance, WheeledRobot};
use crate::ParameterError;
use crate::excitation::{Excitation, RandomSteps};
use crate::parameter_error::{in_range, positive};
use crate::regulated;
use crate::sensor::{ClockParameters, EncoderParameters, ImuParameters, LatencyParameters};

/// Readings of a regulator: the pose of a localisation without error, and the values of odometry and encoders.
pub(super) const SHOWN: [&str; 7] = ["x", "y", "yaw", "v", "w", "left_rate", "right_rate"];
/// Commands that a regulator may drive.
pub(super) const COMMANDS: [&str; 2] = ["v_command", "w_command"];

/// A differential-drive robot that follows velocity references in a walled arena: a [`Scenario`](crate::Scenario).
///
/// References come from excitation signals through collision avoidance. Wheel-rate controllers follow them once an
/// encoder sample, and motors turn the wheels. Friction moves the robot. One computer makes, stamps and logs all
/// messages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Wheeled {
    /// m/s^2
    pub gravity: f64,
    /// Of the physics, s.
    pub step: f64,
    /// Between rows of truth, s; whole physics steps.
    pub row_period: f64,
    /// Time that the robot stands before a run begins, s.
    pub settle: f64,
    /// Commands that are the inputs of a model: the rows hold all of them.
    pub inputs: Inputs,
    /// The robot has tipped over, and the run ends, when it leans more than this, rad.
    pub tilt_limit: f64,
    /// When a run begins, s since 1970. Default: 2025-01-01 00:00:00 UTC.
    pub epoch: i64,
    /// The bodies and motors.
    pub robot: WheeledRobot,
    /// Floor and walls.
    pub arena: Arena,
    /// Reference velocities.
    pub commands: Commands,
    /// A law in the place of the references, made from a model of the robot. It reads x, y, yaw, v, w, left_rate and
    /// right_rate and drives v_command and w_command.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub regulator: Option<Regulator>,
    /// Collision avoidance at the walls.
    pub avoidance: Avoidance,
    /// Of each wheel's rate: from rad/s to V, once an encoder sample. Its limits are also the drivers'.
    #[serde(deserialize_with = "defaults::pid")]
    pub controller: Pid,
    /// On each wheel. Its period, whole physics steps, is the controllers'.
    #[serde(deserialize_with = "defaults::encoder")]
    pub encoder: EncoderParameters,
    /// On the chassis. Its period: whole physics steps.
    #[serde(deserialize_with = "defaults::imu")]
    pub imu: ImuParameters,
    /// The computer's.
    pub clock: ClockParameters,
    /// From a program to the log.
    #[serde(deserialize_with = "defaults::latency")]
    pub latency: LatencyParameters,
}

/// Velocity references.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Commands {
    /// Between two, s; whole physics steps.
    pub period: f64,
    /// The forward velocity is kept within plus and minus this, m/s.
    pub v_limit: f64,
    /// The yaw rate is kept within plus and minus this, rad/s.
    pub w_limit: f64,
    /// Of the forward velocity, m/s; its state is what the odometry says.
    pub v: Excitation,
    /// Of the yaw rate, rad/s; its state is what the odometry says.
    pub w: Excitation,
}

/// Commands that a model of the robot takes as its inputs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Inputs {
    /// The commanded forward velocity and yaw rate. The controllers' integrals are then hidden states of the model.
    #[default]
    Velocity,
    /// The wheels' voltages.
    Voltage,
}

impl Default for Wheeled {
    fn default() -> Self {
        Self {
            gravity: 9.81,
            step: 2e-3,
            row_period: 0.01,
            settle: 0.3,
            inputs: Inputs::default(),
            tilt_limit: 0.5,
            epoch: 1_735_689_600,
            robot: WheeledRobot::default(),
            arena: Arena::default(),
            commands: Commands::default(),
            regulator: None,
            avoidance: Avoidance::default(),
            controller: default_pid(),
            encoder: default_encoder(),
            imu: default_imu(),
            clock: ClockParameters::default(),
            latency: default_latency(),
        }
    }
}

impl Default for Commands {
    /// The random references of *Towards Sim-to-Real via Real-to-Sim* (uniform, its Fig. 6.1) for a robot of this size.
    fn default() -> Self {
        let steps = |most: f64| RandomSteps { low: -most, high: most, ..RandomSteps::default() };
        Self {
            period: 0.05,
            v_limit: 1.0,
            w_limit: 4.0,
            v: Excitation::RandomSteps(steps(0.8)),
            w: Excitation::RandomSteps(steps(2.5)),
        }
    }
}

impl Wheeled {
    /// Checks every value.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        positive("gravity", self.gravity)?;
        in_range("step", self.step, 1e-5, 5e-3, "from 0.00001 to 0.005 s")?;
        self.whole_steps("row_period", self.row_period)?;
        in_range("settle", self.settle, 0.0, 60.0, "from 0 to 60 s")?;
        in_range("tilt_limit", self.tilt_limit, 0.01, 3.0, "from 0.01 to 3 rad")?;
        // The header's stamp of ROS 2 has 32-bit seconds: the upper end leaves years for offsets and runs.
        in_range("epoch", self.epoch as f64, 0.0, 2e9, "from 0 to 2000000000")?;
        self.robot.validate().map_err(|error| error.within("robot"))?;
        self.arena.validate(self.robot.chassis.radius).map_err(|error| error.within("arena"))?;
        self.validate_commands().map_err(|error| error.within("commands"))?;
        if let Some(regulator) = &self.regulator {
            regulated::check(regulator, &SHOWN, &COMMANDS).map_err(|error| error.within("regulator"))?;
        }
        self.avoidance.validate().map_err(|error| error.within("avoidance"))?;
        self.controller.validate().map_err(|error| error.within("controller"))?;
        self.encoder.validate().map_err(|error| error.within("encoder"))?;
        self.whole_steps("period", self.encoder.period).map_err(|error| error.within("encoder"))?;
        self.imu.validate().map_err(|error| error.within("imu"))?;
        self.whole_steps("period", self.imu.period).map_err(|error| error.within("imu"))?;
        self.clock.validate().map_err(|error| error.within("clock"))?;
        self.latency.validate().map_err(|error| error.within("latency"))
    }

    fn validate_commands(&self) -> Result<(), ParameterError> {
        let Commands { period, v_limit, w_limit, ref v, ref w } = self.commands;
        self.whole_steps("period", period)?;
        positive("v_limit", v_limit)?;
        positive("w_limit", w_limit)?;
        v.validate(period).map_err(|error| error.within("v"))?;
        w.validate(period).map_err(|error| error.within("w"))
    }

    fn whole_steps(&self, name: &str, period: f64) -> Result<(), ParameterError> {
        let steps = period / self.step;
        let whole = steps.is_finite() && steps.round() >= 1.0 && (steps - steps.round()).abs() < 1e-6;
        let words = || format!("a multiple of the physics step, {} s", self.step);
        if whole { Ok(()) } else { Err(ParameterError::new(name, period, words())) }
    }

    /// Physics steps in a period that [`Wheeled::validate`] has passed.
    pub(super) fn steps(&self, period: f64) -> u64 {
        ((period / self.step).round() as u64).max(1)
    }

    /// Geometry that the robot's programs assume: the true one.
    pub fn drive(&self) -> DifferentialDrive {
        DifferentialDrive { radius: self.robot.wheel.radius, width: self.robot.wheel.track }
    }
}

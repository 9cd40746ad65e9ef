//! Physical parameters of the experiment.

use fleetfoot_control::controller::{DifferentialDrive, Regulator, Treadmill};
use serde::{Deserialize, Serialize};

use super::{BeltParameters, CrankControl};
use crate::parameter_error::{in_range, not_negative, positive};
use crate::regulated;
use crate::sensor::{
    ClocksParameters, EncoderParameters, ImuParameters, LatencyParameters, MocapParameters, SyncWaveParameters,
    nanoseconds,
};
use crate::{Excitation, Hexapod, ParameterError};

/// Readings of a regulator: the last pose, and the belt's speed.
pub(super) const SHOWN: [&str; 4] = ["x", "y", "yaw", "belt_speed"];
/// Commands that a regulator may drive.
pub(super) const COMMANDS: [&str; 2] = ["u_v", "u_w"];

/// A hexapod that runs on a treadmill, kept there by a controller that sees it through a motion capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HexapodTreadmill {
    /// Seconds between rows of truth.
    pub row_period: f64,
    /// Seconds that the robot runs before the log begins: the paper clips the first strides of its runs (II-D).
    pub settle: f64,
    /// From the controller to the robot, s; beside the latency of the motion capture.
    pub command_latency: f64,
    /// The trunk's up axis may lean this far before the robot counts as fallen, rad.
    pub greatest_tilt: f64,
    /// Placement of the robot on the belt.
    pub start: StartParameters,
    /// The belt.
    pub belt: BeltParameters,
    /// Equation (1), on the controller.
    pub controller: Treadmill,
    /// A law in the place of equation (1), made from a model of the robot. It reads x, y, yaw and belt_speed and drives
    /// u_v and u_w, whose limits stay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub regulator: Option<Regulator>,
    /// Equation (2), on the robot.
    pub drive: DriveParameters,
    /// The cranks' controllers, on the robot.
    pub crank: CrankControl,
    /// Signals that are added to commands.
    pub excitation: TreadmillExcitation,
    /// The robot.
    pub hexapod: Hexapod,
    /// On the robot.
    pub imu: ImuParameters,
    /// On each crank.
    pub encoder: EncoderParameters,
    /// Above the belt.
    pub mocap: MocapParameters,
    /// From the robot's sensors to the log.
    pub telemetry_latency: LatencyParameters,
    /// The computers' clocks.
    pub clocks: ClocksParameters,
    /// The lamp that both sides see.
    pub sync: SyncWaveParameters,
}

/// The radius and width that the robot's program believes in, equation (2).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DriveParameters {
    /// Effective radius of a leg mechanism, m; 0: that of the hexapod's legs when no foot slips and no leg bends.
    pub radius: f64,
    /// Between left and right feet, m; 0: the hexapod's.
    pub width: f64,
}

/// Placement of the robot on the belt: level and at rest, the cranks at any angle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StartParameters {
    /// Standard deviation of its place from the middle, along and across, m.
    pub place: f64,
    /// Standard deviation of its yaw, rad.
    pub yaw: f64,
    /// Number of new placements on the belt when the robot leaves it or falls before the log begins.
    pub retries: u32,
}

impl Default for StartParameters {
    fn default() -> Self {
        Self { place: 0.01, yaw: 0.05, retries: 20 }
    }
}

/// Signals that are added to commands. In a world file: `excitation.velocity = { kind = "prbs", ... }`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TreadmillExcitation {
    /// To the forward velocity of equation (1), m/s.
    pub velocity: Excitation,
    /// To the yaw rate of equation (1), rad/s.
    pub yaw_rate: Excitation,
    /// To the left crank's rate, rad/s.
    pub left_crank: Excitation,
    /// To the right crank's rate, rad/s.
    pub right_crank: Excitation,
}

impl Default for HexapodTreadmill {
    fn default() -> Self {
        Self {
            row_period: 1e-3,
            settle: 6.0,
            command_latency: 1e-3,
            greatest_tilt: 1.2,
            start: StartParameters::default(),
            belt: BeltParameters::default(),
            controller: Treadmill::default(),
            regulator: None,
            drive: DriveParameters::default(),
            crank: CrankControl::default(),
            excitation: TreadmillExcitation::default(),
            hexapod: Hexapod::default(),
            imu: ImuParameters::default(),
            encoder: EncoderParameters::default(),
            mocap: MocapParameters::default(),
            telemetry_latency: LatencyParameters::default(),
            clocks: ClocksParameters::default(),
            sync: SyncWaveParameters::default(),
        }
    }
}

impl HexapodTreadmill {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range, by its path in the world file.
    pub fn validate(&self) -> Result<(), ParameterError> {
        in_range("settle", self.settle, 0.0, 3600.0, "from 0 to 3600 s")?;
        in_range("command_latency", self.command_latency, 0.0, 10.0, "from 0 to 10 s")?;
        in_range("greatest_tilt", self.greatest_tilt, 0.01, std::f64::consts::PI, "from 0.01 rad to pi")?;
        not_negative("place", self.start.place).map_err(|error| error.within("start"))?;
        not_negative("yaw", self.start.yaw).map_err(|error| error.within("start"))?;
        self.belt.validate().map_err(|error| error.within("belt"))?;
        self.controller.validate().map_err(|error| error.within("controller"))?;
        if let Some(regulator) = &self.regulator {
            regulated::check(regulator, &SHOWN, &COMMANDS).map_err(|error| error.within("regulator"))?;
        }
        not_negative("radius", self.drive.radius).map_err(|error| error.within("drive"))?;
        not_negative("width", self.drive.width).map_err(|error| error.within("drive"))?;
        self.crank.validate().map_err(|error| error.within("crank"))?;
        self.hexapod.validate().map_err(|error| error.within("hexapod"))?;
        self.imu.validate().map_err(|error| error.within("imu"))?;
        self.encoder.validate().map_err(|error| error.within("encoder"))?;
        self.mocap.validate().map_err(|error| error.within("mocap"))?;
        self.telemetry_latency.validate().map_err(|error| error.within("telemetry_latency"))?;
        self.clocks.validate().map_err(|error| error.within("clocks"))?;
        self.sync.validate().map_err(|error| error.within("sync"))?;
        self.clocks.validate_alignment(&self.sync)?;
        self.check_excitation()?;
        self.check_periods()
    }

    fn check_excitation(&self) -> Result<(), ParameterError> {
        let excitation = &self.excitation;
        for (name, signal, period) in [
            ("excitation.velocity", &excitation.velocity, self.controller.period),
            ("excitation.yaw_rate", &excitation.yaw_rate, self.controller.period),
            ("excitation.left_crank", &excitation.left_crank, self.crank.period),
            ("excitation.right_crank", &excitation.right_crank, self.crank.period),
        ] {
            signal.validate(period).map_err(|error| error.within(name))?;
        }
        Ok(())
    }

    /// Everything that happens now and then happens at a physics step.
    fn check_periods(&self) -> Result<(), ParameterError> {
        let step = nanoseconds(self.hexapod.step);
        let allowed = format!("a multiple of the physics step, {} s", self.hexapod.step);
        let whole = step as f64 * 1e-9;
        in_range("hexapod.step", self.hexapod.step, whole - 1e-15, whole + 1e-15, "a whole number of nanoseconds")?;
        for (name, period) in [
            ("row_period", self.row_period),
            ("controller.period", self.controller.period),
            ("crank.period", self.crank.period),
            ("imu.period", self.imu.period),
            ("encoder.period", self.encoder.period),
            ("mocap.period", self.mocap.period),
        ] {
            positive(name, period)?;
            if nanoseconds(period) < step || nanoseconds(period) % step != 0 {
                return Err(ParameterError::new(name, period, allowed));
            }
        }
        Ok(())
    }

    /// Equation (2) as the robot's program has it.
    pub fn drive(&self) -> DifferentialDrive {
        let or = |given: f64, default: f64| if given > 0.0 { given } else { default };
        DifferentialDrive {
            radius: or(self.drive.radius, self.hexapod.effective_radius()),
            width: or(self.drive.width, self.hexapod.track_width()),
        }
    }

    /// Physics steps that the robot runs before the log begins.
    pub(super) fn steps_before_the_log(&self) -> i64 {
        nanoseconds(self.settle) / nanoseconds(self.hexapod.step)
    }

    /// Physics steps in a period.
    pub(super) fn steps(&self, period: f64) -> i64 {
        (nanoseconds(period) / nanoseconds(self.hexapod.step)).max(1)
    }
}

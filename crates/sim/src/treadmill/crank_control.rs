//! Control of a crank.

use fleetfoot_control::controller::Pid;
use serde::{Deserialize, Serialize};

use crate::parameter_error::{not_negative, positive};
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
    pub(super) fn pid(&self, supply_voltage: f64) -> Pid {
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

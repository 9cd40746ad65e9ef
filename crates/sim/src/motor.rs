//! Brushed DC motors with a gearbox.

use serde::{Deserialize, Serialize};

use crate::parameter_error::{ParameterError, not_negative, positive};

/// A coreless brushed DC motor and its gearbox, seen at the gearbox's output (a crank or a wheel).
///
/// Torque-speed line: `torque = N k (V - N k rate) / R` less friction, with gear ratio N, torque constant k, resistance R. The winding's
/// inductance is neglected (its time constant is tens of microseconds in motors of this size).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DcMotor {
    /// Of the winding and the driver, ohm.
    pub resistance: f64,
    /// N m/A, which is V s/rad.
    pub torque_constant: f64,
    /// Rotor turns per turn of the output, 1.
    pub gear_ratio: f64,
    /// Of the rotor about its own axis, kg m^2.
    pub rotor_inertia: f64,
    /// At the output, N m s/rad.
    pub viscous_friction: f64,
    /// At the output, the same standing and moving, N m.
    pub coulomb_friction: f64,
    /// The driver gives no more than this, either way, V.
    pub supply_voltage: f64,
}

impl Default for DcMotor {
    /// A coreless motor of 7 mm on one lithium cell, with a gearbox of 21:1: stalls at 20 mN m, runs free at 200 rad/s, mechanical time constant 8.5 ms.
    fn default() -> Self {
        Self {
            resistance: 3.3,
            torque_constant: 8.8e-4,
            gear_ratio: 21.0,
            rotor_inertia: 2e-9,
            viscous_friction: 2e-6,
            coulomb_friction: 2e-4,
            supply_voltage: 3.7,
        }
    }
}

/// Connection of the motor's terminals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Supply {
    /// A driver that holds this voltage, V. 0 brakes: the terminals are shorted.
    Voltage(f64),
    /// Nothing: no current, no torque but friction.
    Open,
}

impl DcMotor {
    /// Checks every value.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        positive("resistance", self.resistance)?;
        positive("torque_constant", self.torque_constant)?;
        positive("gear_ratio", self.gear_ratio)?;
        positive("rotor_inertia", self.rotor_inertia)?;
        not_negative("viscous_friction", self.viscous_friction)?;
        not_negative("coulomb_friction", self.coulomb_friction)?;
        positive("supply_voltage", self.supply_voltage)
    }

    /// Torque of the current at the output, before friction, N m; `rate` of the output in rad/s.
    pub fn torque(&self, supply: Supply, rate: f64) -> f64 {
        let constant = self.gear_ratio * self.torque_constant;
        match supply {
            Supply::Voltage(voltage) => constant * (self.limited(voltage) - constant * rate) / self.resistance,
            Supply::Open => 0.0,
        }
    }

    /// The voltage that the driver can give.
    pub fn limited(&self, voltage: f64) -> f64 {
        voltage.clamp(-self.supply_voltage, self.supply_voltage)
    }

    /// Of the rotor, at the output: N^2 times its own, kg m^2.
    pub fn inertia(&self) -> f64 {
        self.gear_ratio * self.gear_ratio * self.rotor_inertia
    }

    /// Torque lost per rate: viscous friction, and the back-EMF while current can flow, N m s/rad.
    pub fn drag(&self, supply: Supply) -> f64 {
        let constant = self.gear_ratio * self.torque_constant;
        match supply {
            Supply::Voltage(_) => self.viscous_friction + constant * constant / self.resistance,
            Supply::Open => self.viscous_friction,
        }
    }

    /// Of the free motor's run-up, s.
    pub fn time_constant(&self) -> f64 {
        self.inertia() / self.drag(Supply::Voltage(0.0))
    }

    /// The output's rate one step later (rad/s), with a load (N m, positive drives the output forward) that stays over the step.
    ///
    /// Exact for constant load and no Coulomb friction: drag is linear, so the rate decays exponentially to its limit. Coulomb friction takes away what is left
    /// of its impulse after that, at most all of the motion: it holds the output where it can, and never reverses it.
    pub fn advance(&self, supply: Supply, rate: f64, load: f64, step: f64) -> f64 {
        let inertia = self.inertia();
        let rest = self.torque(supply, 0.0) + load;
        let exponent = self.drag(supply) * step / inertia;
        // (1 - exp(-x)) / x, which is 1 where there is no drag.
        let share = if exponent > 0.0 { -(-exponent).exp_m1() / exponent } else { 1.0 };
        let free = rate * (-exponent).exp() + rest * step / inertia * share;
        let friction = self.coulomb_friction * step / inertia;
        if free.abs() <= friction { 0.0 } else { free - friction.copysign(free) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frictionless() -> DcMotor {
        DcMotor { coulomb_friction: 0.0, viscous_friction: 0.0, ..DcMotor::default() }
    }

    #[test]
    fn motor_accelerates_with_its_time_constant() {
        let motor = frictionless();
        let constant = motor.gear_ratio * motor.torque_constant;
        // J R / (N k)^2.
        let time_constant = motor.inertia() * motor.resistance / (constant * constant);
        assert!((motor.time_constant() / time_constant - 1.0).abs() < 1e-12);
        for steps in [1, 10, 100] {
            let mut rate = 0.0;
            for _ in 0..steps {
                rate = motor.advance(Supply::Voltage(2.0), rate, 0.0, time_constant / steps as f64);
            }
            let expected = 2.0 / constant * (1.0 - (-1.0_f64).exp());
            assert!((rate / expected - 1.0).abs() < 1e-12, "{steps} steps: {rate} not {expected}");
        }
    }

    #[test]
    fn torque_falls_linearly_with_speed() {
        let motor = frictionless();
        let constant = motor.gear_ratio * motor.torque_constant;
        let supply = Supply::Voltage(1.5);
        assert!((motor.torque(supply, 0.0) - constant * 1.5 / motor.resistance).abs() < 1e-15);
        assert!(motor.torque(supply, 1.5 / constant).abs() < 1e-15);
        assert_eq!(motor.torque(Supply::Voltage(99.0), 0.0), motor.torque(Supply::Voltage(3.7), 0.0));
        assert_eq!(motor.torque(Supply::Open, 50.0), 0.0);
    }

    #[test]
    fn friction_holds_and_stops_the_output() {
        let motor = DcMotor { viscous_friction: 0.0, coulomb_friction: 1e-3, ..DcMotor::default() };
        assert_eq!(motor.advance(Supply::Open, 0.0, 0.9e-3, 1e-3), 0.0);
        assert!(motor.advance(Supply::Open, 0.0, 1.1e-3, 1e-3) > 0.0);
        let (mut rate, mut time) = (20.0, 0.0);
        while rate > 0.0 {
            rate = motor.advance(Supply::Open, rate, 0.0, 1e-5);
            time += 1e-5;
        }
        assert_eq!(rate, 0.0);
        assert!((time - 20.0 * motor.inertia() / 1e-3).abs() < 2e-5, "{time}");
    }

    #[test]
    fn bad_parameters_are_named() {
        let error = DcMotor { resistance: -1.0, ..DcMotor::default() }.validate().unwrap_err();
        assert_eq!((error.name.as_str(), error.value.as_str()), ("resistance", "-1"));
        assert!(DcMotor { rotor_inertia: f64::NAN, ..DcMotor::default() }.validate().is_err());
        assert!(DcMotor::default().validate().is_ok());
    }
}

//! The planar differential drive: a robot's velocity from its two sides' rates, and back.

use serde::{Deserialize, Serialize};

use super::{ParameterError, check};

/// Equation (2) of Buchan, Haldane, Fearing: no slip, the same effective radius on both sides.
///
/// With z up and yaw to the left positive, the right side is the faster one in a left turn: `left = (v - d/2 w) / r`
/// and `right = (v + d/2 w) / r`. (The paper's signs are for yaw to the right.)
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DifferentialDrive {
    /// Effective radius r of a leg mechanism or a wheel, m: the way over the ground of a radian of its crank.
    pub radius: f64,
    /// Width d of the robot between its sides, m.
    pub width: f64,
}

impl Default for DifferentialDrive {
    /// A stride of 5 cm (0.25 m/s at 5 Hz, III-A) and feet 6 cm apart.
    fn default() -> Self {
        Self { radius: 0.008, width: 0.06 }
    }
}

impl DifferentialDrive {
    /// Checks the parameters.
    ///
    /// # Errors
    /// A radius or a width that is not positive.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check("radius", self.radius, self.radius > 0.0, "a positive length in m")?;
        check("width", self.width, self.width > 0.0, "a positive length in m")
    }

    /// Rates of the left and the right side, rad/s, for a forward velocity (m/s) and a yaw rate (rad/s).
    pub fn rates(&self, velocity: f64, yaw_rate: f64) -> [f64; 2] {
        let turn = 0.5 * self.width * yaw_rate;
        [(velocity - turn) / self.radius, (velocity + turn) / self.radius]
    }

    /// Forward velocity (m/s) and yaw rate (rad/s) that the rates of the left and the right side (rad/s) give without slip.
    pub fn velocity(&self, rates: [f64; 2]) -> [f64; 2] {
        [0.5 * self.radius * (rates[0] + rates[1]), self.radius * (rates[1] - rates[0]) / self.width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wheel_rates_and_velocity_are_inverse() {
        let drive = DifferentialDrive { radius: 0.02, width: 0.1 };
        let rates = drive.rates(0.3, 2.0);
        assert!((rates[0] - 10.0).abs() < 1e-12 && (rates[1] - 20.0).abs() < 1e-12, "{rates:?}");
        let [v, w] = drive.velocity(rates);
        assert!((v - 0.3).abs() < 1e-15 && (w - 2.0).abs() < 1e-14);
        let error = DifferentialDrive { radius: 0.0, width: 0.1 }.validate().unwrap_err().to_string();
        assert_eq!(error, "radius = 0: must be a positive length in m");
    }
}

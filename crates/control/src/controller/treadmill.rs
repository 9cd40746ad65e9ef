//! The law that keeps a robot on a treadmill.

use serde::{Deserialize, Serialize};

use super::{ParameterError, check};

/// Equation (1) of Buchan, Haldane, Fearing: forward velocity `(v_t - k_x x) / cos(yaw)` and yaw rate `-k_yaw yaw`, within limits.
///
/// x is the robot's place along the belt (m, forward), v_t the belt's speed (m/s, backward), yaw its heading against
/// the belt (rad). The paper's law does not read the place y across the belt (m, to the left), so that errors of
/// heading add up in it. With a gain `k_y` the robot heads for the middle line, `-k_yaw (yaw + k_y y)`. The paper's law
/// has `k_y = 0`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Treadmill {
    /// Gain k_x of the place along the belt, 1/s.
    pub k_x: f64,
    /// Gain k_yaw of the heading, 1/s.
    pub k_yaw: f64,
    /// Heading towards the middle line a metre off it, rad/m; no more than a radian whatever the distance.
    pub k_y: f64,
    /// The cosine of the yaw is taken as this much at least: across the belt no forward velocity keeps the place.
    pub least_cosine: f64,
    /// Lowest forward velocity, m/s.
    pub lowest_velocity: f64,
    /// Highest forward velocity, m/s.
    pub highest_velocity: f64,
    /// Highest yaw rate to either side, rad/s.
    pub highest_yaw_rate: f64,
    /// Seconds between commands.
    pub period: f64,
}

impl Default for Treadmill {
    /// 100 Hz as in II-B. The gains are tuned by hand, as the paper's were: they keep the simulated hexapod on its belt.
    fn default() -> Self {
        Self {
            k_x: 2.0,
            k_yaw: 10.0,
            k_y: 2.0,
            least_cosine: 0.5,
            lowest_velocity: 0.0,
            highest_velocity: 1.0,
            highest_yaw_rate: 1.5,
            period: 0.01,
        }
    }
}

impl Treadmill {
    /// Checks the parameters.
    ///
    /// # Errors
    /// A period that is not positive, limits in the wrong order, gains that are no numbers.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check("k_x", self.k_x, true, "a finite number, 1/s")?;
        check("k_yaw", self.k_yaw, true, "a finite number, 1/s")?;
        check("k_y", self.k_y, true, "a finite number, rad/m")?;
        let cosine = self.least_cosine;
        check("least_cosine", cosine, cosine > 0.0 && cosine <= 1.0, "above 0 and at most 1")?;
        check("lowest_velocity", self.lowest_velocity, true, "a finite number, m/s")?;
        let highest = self.highest_velocity;
        check("highest_velocity", highest, highest >= self.lowest_velocity, "a velocity not below `lowest_velocity`")?;
        check("highest_yaw_rate", self.highest_yaw_rate, self.highest_yaw_rate >= 0.0, "0 or a rate in rad/s")?;
        check("period", self.period, self.period > 0.0, "a positive time in s")
    }

    /// Forward velocity (m/s) and yaw rate (rad/s) for a place x, y (m) and a yaw (rad) on a belt of this speed (m/s).
    pub fn command(&self, belt_speed: f64, [x, y, yaw]: [f64; 3]) -> [f64; 2] {
        let velocity = (belt_speed - self.k_x * x) / yaw.cos().max(self.least_cosine);
        self.limited(velocity, -self.k_yaw * (yaw + (self.k_y * y).clamp(-1.0, 1.0)))
    }

    /// Forward velocity (m/s) and yaw rate (rad/s) within their limits.
    pub fn limited(&self, velocity: f64, yaw_rate: f64) -> [f64; 2] {
        let limit = self.highest_yaw_rate;
        [velocity.max(self.lowest_velocity).min(self.highest_velocity), yaw_rate.max(-limit).min(limit)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equation_one_and_its_limits() {
        let law = Treadmill {
            k_x: 2.0,
            k_yaw: 5.0,
            k_y: 0.0,
            highest_velocity: 0.9,
            highest_yaw_rate: 3.0,
            ..Treadmill::default()
        };
        law.validate().unwrap();
        let [v, w] = law.command(0.3, [0.05, 9.0, 0.2]);
        assert!((v - 0.2 / 0.2f64.cos()).abs() < 1e-15 && w == -1.0);
        assert_eq!(law.command(0.3, [0.5, 0.0, -0.9]), [0.0, 3.0], "no walking backwards, the turn is limited");
        assert_eq!(law.command(0.4, [0.0, 0.0, 1.5]), [0.8, -3.0], "cosines below one half count as one half");
        assert_eq!(law.command(0.5, [0.0, 0.0, 2.0])[0], 0.9, "a robot that looks away does not run");
        let middle = Treadmill { k_y: 2.0, ..law };
        assert_eq!(middle.command(0.3, [0.0, 0.1, 0.0])[1], -1.0, "left of the middle it turns right");
        assert_eq!(Treadmill { highest_yaw_rate: 9.0, ..middle }.command(0.3, [0.0, 4.0, 0.0])[1], -5.0);
        let error = Treadmill { least_cosine: 0.0, ..law }.validate().unwrap_err().to_string();
        assert_eq!(error, "least_cosine = 0: must be above 0 and at most 1");
        assert!(Treadmill { period: 0.0, ..law }.validate().is_err());
    }
}

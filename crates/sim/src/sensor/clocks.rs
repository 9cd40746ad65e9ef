//! The three computers of a motion-captured robot.

use serde::{Deserialize, Serialize};

use super::{Clock, ClockParameters, SyncWaveParameters, check};
use crate::ParameterError;
use crate::partial_table::partial_table;

/// The clocks of a robot on its own computer, a controller that also logs, and a motion-capture system: see II-B of *Automatic
/// Identification of Dynamic Piecewise Affine Models for a Running Robot* (Buchan, Haldane, Fearing), where a square wave on both sides
/// aligns them. The paper gives no offsets: these are what a boot and two quartzes make of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClocksParameters {
    /// When a run begins, s since 1970 of true time: no simulation asks what time it is. Default: 2025-01-01 00:00:00 UTC.
    pub epoch: i64,
    /// The computer that commands the robot and logs all: log stamps are its.
    pub controller: ClockParameters,
    /// The robot's computer: stamps of its own sensors. Default: 0.125 s ahead, 25 ppm fast.
    #[serde(deserialize_with = "robot")]
    pub robot: ClockParameters,
    /// The motion capture's computer. Default: 0.04 s behind, 10 ppm slow, stamping within 100 us.
    #[serde(deserialize_with = "mocap")]
    pub mocap: ClockParameters,
}

const ROBOT: ClockParameters = ClockParameters { offset: 0.125, skew: 25.0, jitter: 20e-6 };
const MOCAP: ClockParameters = ClockParameters { offset: -0.04, skew: -10.0, jitter: 100e-6 };

impl Default for ClocksParameters {
    fn default() -> Self {
        Self { epoch: 1_735_689_600, controller: ClockParameters::default(), robot: ROBOT, mocap: MOCAP }
    }
}

impl ClocksParameters {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        // The header's stamp of ROS 2 has 32-bit seconds: the upper end leaves years for offsets and runs.
        check::within("epoch", self.epoch as f64, 0.0..=2e9)?;
        self.controller.validate().map_err(|error| error.within("controller"))?;
        self.robot.validate().map_err(|error| error.within("robot"))?;
        self.mocap.validate().map_err(|error| error.within("mocap"))
    }

    /// Checks that a square wave, table `sync` beside a table `clocks`, can align the clocks: that any two of them differ by less than
    /// half its period when a run begins.
    ///
    /// # Errors
    /// The first clock that is too far from another, by its path in the world file.
    pub fn validate_alignment(&self, sync: &SyncWaveParameters) -> Result<(), ParameterError> {
        let offsets =
            [("controller", self.controller.offset), ("robot", self.robot.offset), ("mocap", self.mocap.offset)];
        for (index, (name, offset)) in offsets.iter().enumerate() {
            for (other, reference) in &offsets[..index] {
                let difference = (offset - reference).abs();
                if difference.is_nan() || difference >= 0.5 * sync.period {
                    let half = 0.5 * sync.period;
                    let allowed = format!(
                        "less than {half} s (half of sync.period, or edges are mistaken for others) from clocks.{other}.offset = {reference}"
                    );
                    return Err(ParameterError::new(&format!("clocks.{name}.offset"), offset, allowed));
                }
            }
        }
        Ok(())
    }

    /// The clocks of a run. The parameters have passed [`ClocksParameters::validate`].
    pub fn clocks(&self) -> Clocks {
        let epoch = self.epoch * 1_000_000_000;
        Clocks {
            truth: Clock::perfect(epoch),
            controller: Clock::new(&self.controller, epoch),
            robot: Clock::new(&self.robot, epoch),
            mocap: Clock::new(&self.mocap, epoch),
        }
    }
}

/// The clocks of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clocks {
    /// True time: stamps of the ground truth.
    pub truth: Clock,
    /// See [`ClocksParameters::controller`].
    pub controller: Clock,
    /// See [`ClocksParameters::robot`].
    pub robot: Clock,
    /// See [`ClocksParameters::mocap`].
    pub mocap: Clock,
}

partial_table!(robot, ClockParameters { offset: f64, skew: f64, jitter: f64 }, ROBOT);
partial_table!(mocap, ClockParameters { offset: f64, skew: f64, jitter: f64 }, MOCAP);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wave_aligns_clocks_within_half_period() {
        let clocks = ClocksParameters::default();
        let of_period = |period: f64| SyncWaveParameters { period, ..SyncWaveParameters::default() };
        clocks.validate_alignment(&SyncWaveParameters::default()).unwrap();
        // 0.165 s between robot and motion capture, though each is nearer to the controller.
        clocks.validate_alignment(&of_period(0.331)).unwrap();
        let error = clocks.validate_alignment(&of_period(0.32)).unwrap_err();
        assert_eq!((error.name.as_str(), error.value.as_str()), ("clocks.mocap.offset", "-0.04"));
        assert!(error.allowed.contains("0.16 s") && error.allowed.contains("clocks.robot.offset = 0.125"), "{error}");
        let error = clocks.validate_alignment(&of_period(0.25)).unwrap_err();
        assert!(error.name == "clocks.robot.offset" && error.allowed.contains("clocks.controller.offset"), "{error}");
    }
}

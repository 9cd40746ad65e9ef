//! Report of sensor fusion, for people and programs.

use fleetfoot_recipe::SensorKind;
use serde::Serialize;

use crate::places::Places;

/// Report of the fusion of a body's sensors.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct BodyReport {
    /// The origin of the markers' frame in the body frame, m; the deviation of a given value is 0.
    pub lever: [f64; 3],
    /// Its deviations.
    pub lever_deviation: [f64; 3],
    /// The markers' frame to the body frame: x, y, z, w.
    pub mounting: [f64; 4],
    /// Its deviations, rad.
    pub mounting_deviation: [f64; 3],
    /// Seconds by which poses are stamped late.
    pub delay: f64,
    /// Its deviation.
    pub delay_deviation: f64,
    /// In the world, m/s^2.
    pub gravity: [f64; 3],
    /// The deviations of its direction about two axes across it, rad.
    pub gravity_deviation: [f64; 2],
    /// True with an accelerometer. Without one gravity is not measured, and the jerk is modelled as white noise.
    pub accelerometer: bool,
    /// Densities of the noise of rate and force, an axis.
    pub imu_noise: [[f64; 3]; 2],
    /// The deviations of these densities: 0 of a given value, `null` if the residuals do not determine it.
    pub imu_noise_deviation: [[Option<f64>; 3]; 2],
    /// Deviations of the white noise of single readings of rate (rad/s) and force (m/s^2), an axis, by the readings
    /// alone. `null` if these do not determine it.
    pub reading_noise: [[Option<f64>; 3]; 2],
    /// Their deviations.
    pub reading_noise_deviation: [[Option<f64>; 3]; 2],
    /// Random walk of their biases, rad/s^2/sqrt(Hz) and m/s^3/sqrt(Hz).
    pub imu_walk: [f64; 2],
    /// The deviations of these: 0 of a given value, `null` if the record does not determine it.
    pub imu_walk_deviation: [Option<f64>; 2],
    /// Uncertainty of rates and forces between two readings, as a factor: 1 if a jump may have been anywhere, 0 if
    /// readings are means.
    pub imu_missed: [f64; 2],
    /// Their deviations.
    pub imu_missed_deviation: [Option<f64>; 2],
    /// Without an accelerometer: the density of the jerk's noise, m/s^3/sqrt(Hz).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jerk: Option<f64>,
    /// Its deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jerk_deviation: Option<f64>,
    /// Deviations of position and attitude, m and rad.
    pub pose_noise: [f64; 2],
    /// The deviations of these.
    pub pose_noise_deviation: [Option<f64>; 2],
    /// True if the residuals determined the noise.
    pub noise_fitted: bool,
    /// Poses that were read.
    pub poses: usize,
    /// Poses without readings about them.
    pub outside: usize,
    /// Poses of stretches of which fewer than two positions or no attitude lay within the gate: these are not written.
    pub contradicted: usize,
    /// Poses that were left out, log by log.
    pub rejected: Vec<RejectedPoses>,
    /// True if the iteration converged.
    pub converged: bool,
}

/// Poses of a log that are gross errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct RejectedPoses {
    /// The log.
    pub log: String,
    /// Positions, in seconds of the log's readings.
    pub positions: Places,
    /// Attitudes.
    pub attitudes: Places,
}

/// Report of the fusion of a joint's sensors.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct JointReport {
    /// The joint.
    pub joint: String,
    /// Its sensors.
    pub sensors: Vec<JointSensorReport>,
    /// Density of the white noise that the jerk is taken for, u/s^3/sqrt(Hz), u the unit of positions.
    pub jerk: f64,
    /// True if the readings determined it.
    pub jerk_fitted: bool,
    /// Correlations between the errors of sensors that share stamps.
    pub correlations: Vec<CorrelationReport>,
    /// Seconds after which states share a hundredth of a reading.
    pub smoothed: f64,
    /// True if the iteration converged.
    pub converged: bool,
}

/// Report of the fusion of a sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct JointSensorReport {
    /// The sensor.
    pub sensor: String,
    /// `position` or `rate`.
    pub kind: SensorKind,
    /// Readings that were fused.
    pub readings: usize,
    /// Deviation of a reading, steps aside.
    pub noise: f64,
    /// True if the readings determined it.
    pub noise_fitted: bool,
    /// Seconds by which it is stamped late.
    pub delay: f64,
    /// Its deviation; 0 of a given value.
    pub delay_deviation: f64,
    /// Bias of a reading, measured minus true.
    pub bias: f64,
    /// Its deviation; 0 of a given value.
    pub bias_deviation: f64,
    /// Readings that were left out, log by log, in seconds of the sensor's stamps after the first row of the log.
    pub rejected: Vec<Places>,
}

/// Correlation between the errors of two sensors.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CorrelationReport {
    /// Both.
    pub sensors: [String; 2],
    /// Of their errors at one stamp or at neighbouring ones, the greatest.
    pub correlation: f64,
    /// Pairs of readings behind it.
    pub readings: usize,
}

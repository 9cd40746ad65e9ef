//! `[body]`, `[joint.NAME]` and `[sensor.NAME]`: sensors that `prepare` fuses into the motion of a rigid body or a joint.

use fleetfoot_signal::Estimate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Kind, settings::Tunable};

/// Settings of the fused motion of a body.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BodySection {
    /// Magnitude of gravity, m/s^2, with a fitted direction (9.80665), or its three components in the world.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Gravity>,
    /// Attitude as a state of the written recipe (euler).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attitude: Option<AttitudeForm>,
    /// Deviations beyond which a measured position or attitude counts by its distance instead of its square (4).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub huber: Option<f64>,
    /// Degrees of freedom of Student's distribution for the errors of positions and attitudes, in place of `huber`:
    /// fewer degrees weigh outliers less.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub student: Option<f64>,
    /// Deviations beyond which a measured position or attitude is left out; 0 keeps all (10).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gate: Option<f64>,
    /// Measurements behind a state: `smoother`, all; `filter`, those up to the instant of a row, as on the machine
    /// (smoother).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<EstimateKind>,
    /// Without an accelerometer: density of the white noise that models an axis' jerk, m/s^3/sqrt(Hz) (estimated from
    /// the residuals).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jerk: Option<f64>,
}

/// Attitude of a fused body as a state of the written recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum AttitudeForm {
    /// Three angles, `roll`, `pitch` and `yaw`: R = Rz(yaw) Ry(pitch) Rx(roll), body to world.
    #[default]
    Euler,
    /// One rotation, `attitude`, of the columns `qw`, `qx`, `qy` and `qz`, body to world.
    Quaternion,
}

/// Settings of the fused motion of a joint.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JointSection {
    /// Sensors of the joint, by their names in `[sensor]` (for a single joint: all sensors of positions and rates).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sensors: Vec<String>,
    /// `angle` where positions jump by a turn (`linear`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<Kind>,
    /// Unit of positions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Density of the white noise that models the jerk, u/s^3/sqrt(Hz) with `u` the unit of positions (estimated from
    /// the readings).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jerk: Option<f64>,
    /// Deviations beyond which a reading counts by its distance instead of its square (4).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub huber: Option<f64>,
    /// Degrees of freedom of Student's distribution for the errors of readings, in place of `huber`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub student: Option<f64>,
    /// Deviations beyond which a reading is left out; 0 keeps all (10).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gate: Option<f64>,
    /// Measurements behind a state: `smoother` or `filter`, as for a body (smoother).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<EstimateKind>,
    /// Fusion of sensors with correlated errors, such as a rate computed from the encoder (false: they are refused).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub correlated: Option<bool>,
}

/// Measurements behind a fused state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EstimateKind {
    /// All measurements, earlier and later.
    Smoother,
    /// Measurements up to the instant of a row.
    Filter,
}

impl From<EstimateKind> for Estimate {
    fn from(kind: EstimateKind) -> Self {
        match kind {
            EstimateKind::Smoother => Self::Smoother,
            EstimateKind::Filter => Self::Filter,
        }
    }
}

/// Gravity: its magnitude, or its components.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected the size of gravity in m/s^2, or its three components in the world")]
pub enum Gravity {
    /// Magnitude.
    Size(f64),
    /// Components.
    Components([f64; 3]),
}

/// Quantity that a sensor measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum SensorKind {
    /// Position and attitude in the world: x, y, z, and a quaternion x, y, z, w.
    Pose,
    /// Angular rate, rad/s, and specific force, m/s^2, in the body frame: three channels each.
    Imu,
    /// Angular rate alone.
    Gyro,
    /// Specific force alone.
    Accelerometer,
    /// The position of a joint: one channel.
    Position,
    /// The rate of a joint: one channel.
    Rate,
}

impl SensorKind {
    /// True for sensors of a joint.
    pub fn is_of_joint(self) -> bool {
        matches!(self, Self::Position | Self::Rate)
    }
}

/// A sensor of the body or of a joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorSection {
    /// Quantity that it measures.
    pub kind: SensorKind,
    /// Fields or expressions, in the order of the kind.
    pub channels: Vec<String>,
    /// Position of the pose frame in the body, m, or `auto` to estimate it (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lever: Option<Mounting>,
    /// Rotation of the pose frame in the body, a quaternion x, y, z, w, or `auto` to estimate it (none).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting: Option<Mounting>,
    /// Delay of a pose's stamps behind the readings, or of a joint's reading behind its other sensors, in seconds, or
    /// `auto` to estimate it (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<Tunable>,
    /// Noise: of a pose the deviations of position (m) and attitude (rad); of an imu the densities of rate
    /// (rad/s/sqrt(Hz)) and force (m/s^2/sqrt(Hz)); of a gyro or an accelerometer one density; of a joint's sensor the
    /// deviation of a reading. If one sensor of the body lacks it, residuals estimate the noise of all; a joint's
    /// sensors are estimated one by one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<Vec<f64>>,
    /// Averaging time of a reading before its stamp, in seconds (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub average: Option<f64>,
    /// Step between two values of a joint's sensor (none).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<f64>,
    /// Bias of a joint's sensor, or `auto` to estimate it (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias: Option<Tunable>,
    /// Random walk of the biases, rad/s^2/sqrt(Hz) and m/s^3/sqrt(Hz) (2e-5, 3e-3).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walk: Option<Vec<f64>>,
}

/// Numbers, or `auto`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a list of numbers, or \"auto\"")]
pub enum Mounting {
    /// Given numbers.
    Given(Vec<f64>),
    /// `auto`.
    Word(String),
}

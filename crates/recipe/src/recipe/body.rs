//! `[body]`, `[joint.NAME]` and `[sensor.NAME]`: sensors of one rigid body and of joints, whose motion `prepare` fuses of them.

use fleetfoot_signal::Estimate;
use serde::{Deserialize, Serialize};

use super::{Kind, settings::Tunable};

/// How the motion of a body is fused.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodySection {
    /// The size of gravity, m/s^2, whose direction is found (9.80665), or its three components in the world.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Gravity>,
    /// What the written recipe takes the attitude for (euler).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attitude: Option<AttitudeForm>,
    /// Deviations beyond which a measured position, or an attitude, counts by its distance and no more by its square (4).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub huber: Option<f64>,
    /// Degrees of freedom of Student's law, which the errors of positions and attitudes have in place of `huber`: the fewer, the less count those that are far off.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub student: Option<f64>,
    /// Deviations beyond which a measured position, or an attitude, is left out; 0: none is (10).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gate: Option<f64>,
    /// What states are told from: `smoother`, all measurements; `filter`, those up to the instant of a row, as on the machine (smoother).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<EstimateKind>,
    /// Without an accelerometer: density of the white noise that an axis' jerk is taken for, m/s^3/sqrt(Hz) (told by the residuals).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jerk: Option<f64>,
}

/// What the attitude of a fused body is as a state of the written recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AttitudeForm {
    /// Three angles, `roll`, `pitch` and `yaw`: R = Rz(yaw) Ry(pitch) Rx(roll), body to world.
    #[default]
    Euler,
    /// One rotation, `attitude`, of the columns `qw`, `qx`, `qy` and `qz`, body to world.
    Quaternion,
}

/// How the motion of a joint is fused.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JointSection {
    /// The sensors of the joint, by their names in `[sensor]` (of the only joint: all of positions and rates).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sensors: Vec<String>,
    /// `angle` where positions jump by a turn (`linear`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<Kind>,
    /// The unit of positions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Density of the white noise that the jerk is taken for, u/s^3/sqrt(Hz) with `u` the unit of positions (told by the readings).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jerk: Option<f64>,
    /// Deviations beyond which a reading counts by its distance and no more by its square (4).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub huber: Option<f64>,
    /// Degrees of freedom of Student's law, which the errors of readings have in place of `huber`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub student: Option<f64>,
    /// Deviations beyond which a reading is left out; 0: none is (10).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gate: Option<f64>,
    /// What states are told from: `smoother` or `filter`, as those of a body (smoother).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<EstimateKind>,
    /// Whether sensors are fused whose errors go together, as those of a rate that was computed from the encoder do (false: they are refused).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub correlated: Option<bool>,
}

/// What states are told from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EstimateKind {
    /// All measurements, earlier and later.
    Smoother,
    /// Those up to the instant of a row.
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

/// Gravity: its size, or its components.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected the size of gravity in m/s^2, or its three components in the world")]
pub enum Gravity {
    /// Its size.
    Size(f64),
    /// Its components.
    Components([f64; 3]),
}

/// What a sensor measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
    /// Whether it is of a joint.
    pub fn is_of_joint(self) -> bool {
        matches!(self, Self::Position | Self::Rate)
    }
}

/// A sensor of the body or of a joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSection {
    /// What it measures.
    pub kind: SensorKind,
    /// Fields or expressions, in the order that the kind says.
    pub channels: Vec<String>,
    /// Where the frame of a pose sits in the body, m, or `auto`: it is found (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lever: Option<Mounting>,
    /// How the frame of a pose is turned in the body, a quaternion x, y, z, w, or `auto`: it is found (not at all).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting: Option<Mounting>,
    /// Seconds by which a pose is stamped late beside the readings, or a reading of a joint beside those of its other sensors, or `auto`: it is found (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<Tunable>,
    /// Of a pose the deviations of position (m) and attitude (rad); of an imu the densities of rate (rad/s/sqrt(Hz)) and force (m/s^2/sqrt(Hz)); of the others one
    /// density; of a joint's the deviation of a reading. Where a sensor of the body says nothing, all of the body's are told by the residuals; of a joint's its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<Vec<f64>>,
    /// Seconds before its stamp over which a reading is the mean (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub average: Option<f64>,
    /// Of a joint's: the step between two values that it can say (none).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<f64>,
    /// Of a joint's: what a reading says too much, or `auto`: it is found (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias: Option<Tunable>,
    /// How biases walk, rad/s^2/sqrt(Hz) and m/s^3/sqrt(Hz) (2e-5, 3e-3).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walk: Option<Vec<f64>>,
}

/// Numbers, or `auto`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a list of numbers, or \"auto\"")]
pub enum Mounting {
    /// These.
    Given(Vec<f64>),
    /// `auto`.
    Word(String),
}

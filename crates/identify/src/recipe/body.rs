//! `[body]` and `[sensor.NAME]`: sensors of one rigid body, whose motion `prepare` fuses of them.

use serde::{Deserialize, Serialize};

use super::Tunable;

/// How the motion of a body is fused.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodySection {
    /// The size of gravity, m/s^2, whose direction is found (9.80665), or its three components in the world.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Gravity>,
    /// Deviations beyond which a measured position, or an attitude, counts by its distance and no more by its square (4).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub huber: Option<f64>,
    /// Deviations beyond which a measured position, or an attitude, is left out; 0: none is (10).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gate: Option<f64>,
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
}

/// A sensor of the body.
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
    /// Seconds by which a pose is stamped late beside the readings, or `auto`: it is found (0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<Tunable>,
    /// Of a pose the deviations of position (m) and attitude (rad); of an imu the densities of rate (rad/s/sqrt(Hz)) and force (m/s^2/sqrt(Hz)); of the others one
    /// density. Where a sensor says nothing, all are told by the residuals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<Vec<f64>>,
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

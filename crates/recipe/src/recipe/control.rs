//! `[control]`: what a regulator is to do.

use serde::{Deserialize, Serialize};

use super::settings::settings;

/// Whether every region of a model has its law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ControlSchedule {
    /// By region, where one of them rests at the set point; else the mean.
    #[default]
    Auto,
    /// By region.
    Region,
    /// One law, of the mean of all regions by their rows: for regions that a cycle passes through.
    Mean,
}

settings! {
    control, |_, _| {};
    /// What a regulator is to do. Every entry is the flag of `control lqr` of the same name.
    pub struct ControlSection {
        /// Values that states and inputs are to have, `x=0,y=0`, of a rotation all of its parts, or `roll(attitude)`, `pitch(attitude)` and `yaw(attitude)`; the others are found, so that the model rests (default: none, the nearest rest to
        /// the means in training).
        #[arg(long, value_name = "NAME=VALUE,...", allow_hyphen_values = true)]
        pub setpoint: String,
        /// Weights of states, `x=100,yaw=1` (default: one over the variance in training).
        #[arg(long, value_name = "STATE=WEIGHT,...")]
        pub q: String,
        /// Weights of inputs, `u_v=1` (default: one over the variance in training).
        #[arg(long, value_name = "INPUT=WEIGHT,...")]
        pub r: String,
        /// Integral action: weights of the time integrals of states' errors, `x=10` (default: none).
        #[arg(long, value_name = "STATE=WEIGHT,...")]
        pub integral: String,
        /// Lowest and highest values of inputs, `u_v=0:1,u_w=-1.5:1.5` (default: none).
        #[arg(long, value_name = "INPUT=LOW:HIGH,...", allow_hyphen_values = true)]
        pub limits: String,
        /// Inputs that are driven, separated by commas; what moves the model beside them is measured, and answered at once (default: all inputs).
        #[arg(long, value_name = "INPUTS")]
        pub drive: String,
        /// States that are neither kept nor fed back, separated by commas; rotations as a whole (default: none).
        #[arg(long, value_name = "STATES")]
        pub free: String,
        /// Seconds between commands (default: the model's sampling period).
        #[arg(long, value_name = "SECONDS")]
        pub period: f64,
        /// Whether every region of the model has its law (default: auto).
        #[arg(long, value_enum, value_name = "WHICH")]
        pub schedule: ControlSchedule,
    }
}

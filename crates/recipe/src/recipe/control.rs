//! `[control]`: settings of a controller.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::settings::settings;

/// Schedule of the laws over the regions of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ControlSchedule {
    /// One law per region where a region rests at the set point; else the mean.
    #[default]
    Auto,
    /// One law per region.
    Region,
    /// One law, of the mean of all regions weighted by their rows.
    Mean,
}

settings! {
    control, |_, _| {};
    /// Settings of a controller. Every entry is the flag of `control lqr` and `control mpc` of the same name; `horizon`
    /// and `bounds` are flags of `control mpc` alone.
    pub struct ControlSection {
        /// Set point: values of states and inputs, `x=0,y=0`, also `roll(attitude)`, `pitch(attitude)`, `yaw(attitude)`
        /// of a rotation; the others follow from rest (default: none, the rest nearest to the training means).
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
        /// Inputs that the regulator drives, separated by commas; others are measured and compensated (default: all
        /// inputs).
        #[arg(long, value_name = "INPUTS")]
        pub drive: String,
        /// States that are neither regulated nor fed back, separated by commas; rotations as a whole (default: none).
        #[arg(long, value_name = "STATES")]
        pub free: String,
        /// Seconds between commands (default: the model's sampling period).
        #[arg(long, value_name = "SECONDS")]
        pub period: f64,
        /// Schedule of the laws over the regions (default: auto).
        #[arg(long, value_enum, value_name = "WHICH")]
        pub schedule: ControlSchedule,
        /// Predictive control: samples that are planned ahead (default: 20).
        #[arg(long, value_name = "SAMPLES")]
        pub horizon: u64,
        /// Predictive control: lowest and highest values of states, `y=-0.1:0.1`. Violations are punished, not
        /// excluded (default: none).
        #[arg(long, value_name = "STATE=LOW:HIGH,...", allow_hyphen_values = true)]
        pub bounds: String,
    }
}

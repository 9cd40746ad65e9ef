//! `[filter]`: settings of a filter of recorded states.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::settings::{Tunable, settings};

/// Rule by which one region follows another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FilterSwitching {
    /// By the region of the state.
    #[default]
    State,
    /// By the transitions counted in training, wherever the state is.
    Transitions,
}

/// Correlation of the process noise from row to row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FilterNoise {
    /// Coloured where the model's residuals are correlated.
    #[default]
    Auto,
    /// No correlation.
    White,
    /// An autoregression of the model's residuals.
    Coloured,
}

settings! {
    filter, |_, _| {};
    /// Settings of a filter. Every entry is the flag of `filter` of the same name.
    pub struct FilterSection {
        /// Measured states, each with the standard deviation of its sensor, `x=0.01,v` (default: all states in the log;
        /// a deviation from the log's column NAME_deviation, else from the innovations).
        #[arg(long, value_name = "STATE[=DEVIATION],...")]
        pub measured: String,
        /// Fields or expressions of the log that measure states, `v=/odom.twist.twist.linear.x` (default: those of the
        /// training).
        #[arg(long, value_name = "STATE=FIELD,...")]
        pub sensors: String,
        /// Fields of the log with the true states, for the errors of the estimates, `v=/truth.v` (default: none).
        #[arg(long, value_name = "STATE=FIELD,...")]
        pub truth: String,
        /// Mean and standard deviation of states before their first measurement, `v=0:0.1` (default: those of the
        /// training).
        #[arg(long, value_name = "STATE=MEAN:DEVIATION,...", allow_hyphen_values = true)]
        pub initial: String,
        /// Factor on the process noise (the residual covariance of the regions), or auto: by the innovations, if the
        /// deviations of all sensors are known (default: 1).
        #[arg(long, value_name = "FACTOR")]
        pub process: Tunable,
        /// Correlation of the process noise from row to row (default: auto).
        #[arg(long, value_enum, value_name = "COLOUR")]
        pub noise: FilterNoise,
        /// Rule by which one region follows another (default: state).
        #[arg(long, value_enum, value_name = "HOW")]
        pub switching: FilterSwitching,
    }
}

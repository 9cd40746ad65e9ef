//! `[filter]`: how the states of a recording are filtered.

use serde::{Deserialize, Serialize};

use super::settings::{Tunable, settings};

/// How one region follows another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FilterSwitching {
    /// By where the state is.
    #[default]
    State,
    /// By the transitions that were counted in training, wherever the state is.
    Transitions,
}

/// Whether the process noise of a row hangs on that of the rows before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FilterNoise {
    /// Where the model's residuals do.
    #[default]
    Auto,
    /// It does not.
    White,
    /// It does, by an autoregression of the model's residuals.
    Coloured,
}

settings! {
    filter, |_, _| {};
    /// How states are filtered. Every entry is the flag of `filter` of the same name.
    pub struct FilterSection {
        /// States that are measured, each with the standard deviation of its sensor, `x=0.01,v` (default: all that the log has; a deviation by the log's
        /// column NAME_deviation, else by the innovations so far).
        #[arg(long, value_name = "STATE[=DEVIATION],...")]
        pub measured: String,
        /// Where the log has the measurements of states, fields or expressions, `v=/odom.twist.twist.linear.x` (default: where the model was trained on).
        #[arg(long, value_name = "STATE=FIELD,...")]
        pub sensors: String,
        /// Where the log has the truth, that errors are told of, `v=/truth.v` (default: nowhere).
        #[arg(long, value_name = "STATE=FIELD,...")]
        pub truth: String,
        /// Mean and standard deviation of states before their first measurement, `v=0:0.1` (default: those of the training).
        #[arg(long, value_name = "STATE=MEAN:DEVIATION,...", allow_hyphen_values = true)]
        pub initial: String,
        /// Factor on the process noise, which is the residual covariance of the regions, or `auto`: by the innovations so far, where the deviations of all sensors are known
        /// (default: 1).
        #[arg(long, value_name = "FACTOR")]
        pub process: Tunable,
        /// Whether the process noise of a row hangs on that of the rows before, by the correlation of the model's residuals (default: auto, where they are correlated).
        #[arg(long, value_enum, value_name = "COLOUR")]
        pub noise: FilterNoise,
        /// How one region follows another (default: state).
        #[arg(long, value_enum, value_name = "HOW")]
        pub switching: FilterSwitching,
    }
}

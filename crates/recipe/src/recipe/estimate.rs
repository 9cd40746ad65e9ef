//! `[estimate]`: parameters of given equations. The parameters stand in `[parameters]`, the equations in `known` of the states.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{bounds::whole, settings::settings};

/// Data that the parameters are fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum EstimateMethod {
    /// Derivatives row by row; noise in the states biases the parameters.
    EquationError,
    /// Simulations from estimated initial states; noise in the measurements.
    #[default]
    OutputError,
    /// Simulations corrected by measurements; noise in measurements and dynamics.
    FilterError,
}

settings! {
    estimate, |_, _| {};
    /// Settings of the estimate of parameters. Every entry is the flag of `fit parameters` of the same name.
    pub struct EstimateSection {
        /// Method of the estimate (default: output-error).
        #[arg(long, value_enum, value_name = "METHOD")]
        pub method: EstimateMethod,
        /// Largest number of rows of a segment; each has its own initial state (default: whole episodes).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000_000))]
        pub segment: usize,
        /// States compared with their measurements, separated by commas (default: all).
        #[arg(long, value_name = "STATES")]
        pub compare: String,
        /// Folds whose rows are held out in turn and simulated; 0 for none (default: 5).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1000))]
        pub folds: usize,
        /// Evaluations of a global search for the start, between the bounds of the parameters; each is one simulation
        /// of the logs (default: 0, start at the initial values).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub search: usize,
    }
}

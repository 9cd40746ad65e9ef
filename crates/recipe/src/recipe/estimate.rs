//! `[estimate]`: parameters of given equations. The parameters stand in `[parameters]`, the equations in `known` of the states.

use serde::{Deserialize, Serialize};

use super::{bounds::whole, settings::settings};

/// What parameters are fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum EstimateMethod {
    /// The derivatives of the states row by row: noise in the states pulls the parameters.
    EquationError,
    /// Simulations from estimated beginnings: maximum likelihood with noise in the measurements.
    #[default]
    OutputError,
    /// Simulations that measurements correct on the way, by gains that are estimated too: noise in measurements and dynamics.
    FilterError,
}

settings! {
    estimate, |_, _| {};
    /// How parameters of given equations are estimated. Every entry is the flag of `fit parameters` of the same name.
    pub struct EstimateSection {
        /// What parameters are fitted to: simulations from estimated beginnings, the same corrected by measurements, or the derivatives row by row (default: output-error).
        #[arg(long, value_enum, value_name = "METHOD")]
        pub method: EstimateMethod,
        /// Rows of a segment, at most; each begins at a state of its own (default: whole episodes).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000_000))]
        pub segment: usize,
        /// States that are compared with their measurements, separated by commas; of others the column tells where the search for a beginning starts (default: all).
        #[arg(long, value_name = "STATES")]
        pub compare: String,
        /// Folds whose rows are held out in turn and simulated, to tell what the model is worth; 0 for none (default: 5).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1000))]
        pub folds: usize,
    }
}

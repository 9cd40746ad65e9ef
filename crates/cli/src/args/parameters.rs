//! Arguments of `fit parameters`.

use clap::Args;
use fleetfoot::EstimateSection;

use super::{FitData, FitOutput};

#[derive(Debug, Args)]
pub(crate) struct FitParameters {
    #[command(flatten)]
    pub(crate) data: FitData,
    #[command(flatten)]
    pub(crate) estimate: EstimateSection,
    /// Unknown number inside the equations, with the start of its search: `mass=90`, or `mass=90 in 50..150`; may be
    /// repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    pub(crate) parameter: Vec<String>,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

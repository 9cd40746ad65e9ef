//! Arguments of `control`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use fleetfoot::ControlSection;

use super::examples;

#[derive(Debug, Subcommand)]
pub(crate) enum Control {
    /// Linear-quadratic regulator that keeps a model at a set point, with a law for every region.
    #[command(
        after_help = examples::CONTROL_LQR,
        mut_arg("horizon", |argument| argument.hide(true)),
        mut_arg("bounds", |argument| argument.hide(true))
    )]
    Lqr(Box<ControlDesign>),
    /// Predictive controller that plans inputs within their limits, from the model and weights of a regulator.
    #[command(after_help = examples::CONTROL_MPC)]
    Mpc(Box<ControlDesign>),
}

#[derive(Debug, Args)]
pub(crate) struct ControlDesign {
    /// Model file.
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Recipe whose `[control]` holds the entries that flags do not set (default: that of the model).
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) control: ControlSection,
    /// Controller to write.
    #[arg(short, long, value_name = "FILE", default_value = "controller.json")]
    pub(crate) output: PathBuf,
}

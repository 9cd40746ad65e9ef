//! Arguments of `control`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use fleetfoot::ControlSection;

use super::examples;

#[derive(Debug, Subcommand)]
pub(crate) enum Control {
    /// The linear-quadratic regulator that keeps a model at a set point, with a law for every region.
    #[command(after_help = examples::CONTROL_LQR)]
    Lqr(Box<ControlLqr>),
}

#[derive(Debug, Args)]
pub(crate) struct ControlLqr {
    /// The model.
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// A recipe whose `[control]` says what the flags do not (default: that of the model).
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) control: ControlSection,
    /// The controller to write.
    #[arg(short, long, value_name = "FILE", default_value = "controller.json")]
    pub(crate) output: PathBuf,
}

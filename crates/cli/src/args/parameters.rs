//! Arguments of `fit parameters`.

use std::path::PathBuf;

use clap::Args;
use fleetfoot::EstimateSection;

use super::RecipeArgs;

#[derive(Debug, Args)]
pub(crate) struct FitParameters {
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) estimate: EstimateSection,
    /// A number inside the equations that is not known, and where its search begins: `mass=90`, with bounds `mass=90 in 50..150`; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    pub(crate) parameter: Vec<String>,
    /// The model to write.
    #[arg(short, long, value_name = "MODEL", default_value = "model.json")]
    pub(crate) output: PathBuf,
}

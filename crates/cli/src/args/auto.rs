//! Arguments of `auto`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use fleetfoot::AutoSection;

use super::RecipeArgs;

/// Languages of the code beside the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum AutoExport {
    /// C99, in the folder `c`.
    C,
}

#[derive(Debug, Args)]
pub(crate) struct Auto {
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) auto: AutoSection,
    /// Language of code beside the model (default: no code).
    #[arg(long, value_enum, value_name = "LANGUAGE")]
    pub(crate) export: Option<AutoExport>,
    /// Folder to write: model.json, recipe.toml, report.html, auto.json.
    #[arg(short, long, value_name = "DIR", default_value = "model")]
    pub(crate) output: PathBuf,
    /// Replace the folder of an earlier result.
    #[arg(long)]
    pub(crate) force: bool,
}

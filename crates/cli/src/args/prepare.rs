//! Arguments of `prepare`.

use std::path::PathBuf;

use clap::Args;
use fleetfoot::PrepareSection;

use super::TimeArgs;

#[derive(Debug, Args)]
pub(crate) struct Prepare {
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    /// Recipe: its states are smoothed; its inputs and other columns are written unsmoothed.
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: PathBuf,
    #[command(flatten)]
    pub(crate) time: TimeArgs,
    #[command(flatten)]
    pub(crate) prepare: PrepareSection,
    /// Replace the files of an earlier preparation in the folder.
    #[arg(long)]
    pub(crate) force: bool,
    /// Folder for the clean episodes and their recipe, `robot.toml`.
    #[arg(short, long, value_name = "DIR", default_value = "clean")]
    pub(crate) output: PathBuf,
}

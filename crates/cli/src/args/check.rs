//! Arguments of `check`.

use std::path::PathBuf;

use clap::Args;

use super::TimeArgs;

#[derive(Debug, Args)]
pub(crate) struct Check {
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    /// Recipe whose states and inputs are checked (default: all columns of tables; of robots' logs those that `init`
    /// proposes).
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) time: TimeArgs,
    /// Exit code 1 if there are findings.
    #[arg(long)]
    pub(crate) strict: bool,
}

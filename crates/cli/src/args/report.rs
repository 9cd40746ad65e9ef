//! Arguments of `report`.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::Args;

use super::{ControllerArgs, List, PathArgs, TimeArgs};

#[derive(Debug, Args)]
pub(crate) struct Report {
    /// Models (`*.json`), and files, globs or folders of logs to compare them with.
    #[arg(required = true, value_name = "MODEL|DATA")]
    pub(crate) files: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) time: TimeArgs,
    /// Title of the page (default: names the models).
    #[arg(long, value_name = "TEXT")]
    pub(crate) title: Option<String>,
    /// Steps of every simulation (default: 200, and at most a quarter of the longest episode).
    #[arg(long, value_name = "STEPS", value_parser = fleetfoot::whole::<usize>(0..=10_000_000))]
    pub(crate) horizon: Option<usize>,
    /// Number of simulations of every model.
    #[arg(long, value_name = "N", default_value = "500")]
    pub(crate) starts: NonZeroUsize,
    #[command(flatten)]
    pub(crate) controller: ControllerArgs,
    #[command(flatten)]
    pub(crate) paths: PathArgs,
    /// Two columns or expressions: a map of the best model's errors and region changes (default: the angles of a model
    /// that has two, else none).
    #[arg(long, value_name = "A,B")]
    pub(crate) plane: Option<List>,
    /// Report of `fit sparse --json` or `fit sindy --json`, to show how the model was chosen; may be repeated (default:
    /// none).
    #[arg(long, value_name = "FILE")]
    pub(crate) fit: Vec<PathBuf>,
    /// Page to write.
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    pub(crate) output: PathBuf,
    /// Folder for every figure as SVG (default: none).
    #[arg(long, value_name = "DIR")]
    pub(crate) svg: Option<PathBuf>,
    /// Folder for the numbers of every figure as CSV (default: none).
    #[arg(long, value_name = "DIR")]
    pub(crate) csv: Option<PathBuf>,
}

//! Arguments of `fit sparse`.

use std::path::PathBuf;

use clap::Args;
use fleetfoot::SparseSection;

use super::{FitData, FitOutput};

#[derive(Debug, Args)]
pub(crate) struct FitSparse {
    #[command(flatten)]
    pub(crate) data: FitData,
    #[command(flatten)]
    pub(crate) sparse: SparseSection,
    /// Label of the episodes from the path of their file: `aircraft={dir1}` is its folder, {dir2} the one above, also
    /// {name}, {stem}; may be repeated.
    #[arg(long, value_name = "NAME=TEXT")]
    pub(crate) key: Vec<String>,
    /// Label whose values have a model each, model_{value}.json (default: one model of all).
    #[arg(long, value_name = "LABEL")]
    pub(crate) by: Option<String>,
    /// Parquet file of coefficients and selection frequencies (default: none).
    #[arg(long, value_name = "FILE")]
    pub(crate) frequencies: Option<PathBuf>,
    /// `.stats` file for the statistic of the pass (default: none).
    #[arg(long, value_name = "STATS")]
    pub(crate) keep: Option<PathBuf>,
    /// Influence of every episode (Cook's distance), and its error when it is left out.
    #[arg(long)]
    pub(crate) influence: bool,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

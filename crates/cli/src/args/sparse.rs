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
    /// Label of the episodes from the path of their file: `aircraft={dir1}` is the name of its folder; also {dir2},
    /// {name}, {stem}; may be repeated.
    #[arg(long, value_name = "NAME=TEXT")]
    pub(crate) key: Vec<String>,
    /// Label whose values have a model each (model_{value}.json), with a table of selection frequencies by value
    /// (default: one model of all).
    #[arg(long, value_name = "LABEL")]
    pub(crate) by: Option<String>,
    /// Parquet file for coefficients and selection frequencies, one row per candidate (default: none).
    #[arg(long, value_name = "FILE")]
    pub(crate) frequencies: Option<PathBuf>,
    /// `.stats` file for the statistic of the pass, to fit again without the logs (default: none).
    #[arg(long, value_name = "STATS")]
    pub(crate) keep: Option<PathBuf>,
    /// Influence of every episode (Cook's distance) and its error when it is left out, without another pass.
    #[arg(long)]
    pub(crate) influence: bool,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

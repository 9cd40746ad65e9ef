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
    /// A label of the episodes from the path of their file: `aircraft={dir1}` is the name of its folder; also {dir2}, {name}, {stem}; may be repeated.
    #[arg(long, value_name = "NAME=TEXT")]
    pub(crate) key: Vec<String>,
    /// Fit a model for every value of this label: model_{value}.json, and a table of selection frequencies by value (default: one
    /// model of all).
    #[arg(long, value_name = "LABEL")]
    pub(crate) by: Option<String>,
    /// The Parquet file to write coefficients and selection frequencies to, a row a candidate (default: none).
    #[arg(long, value_name = "FILE")]
    pub(crate) frequencies: Option<PathBuf>,
    /// The `.stats` file to keep the statistic of the pass in: to fit again without one (default: none).
    #[arg(long, value_name = "STATS")]
    pub(crate) keep: Option<PathBuf>,
    /// Leave every episode out once, without another pass: which ones carry the fit (Cook's distance), and what it errs on episodes that it has not seen.
    #[arg(long)]
    pub(crate) influence: bool,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

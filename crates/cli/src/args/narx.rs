//! Arguments of `fit narx`.

use std::path::PathBuf;

use clap::Args;
use fleetfoot::NarxSection;

use super::{FitData, FitOutput, List};

#[derive(Debug, Args)]
pub(crate) struct FitNarx {
    #[command(flatten)]
    pub(crate) data: FitData,
    #[command(flatten)]
    pub(crate) narx: NarxSection,
    /// Outputs, separated by commas (default: the recipe's states).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) outputs: Option<List>,
    /// Functions of outputs and inputs of one row, separated by commas (`y, u, y^2, sqrt(max(y,0))`): the candidates are the lags of each, in the place of
    /// products of lags (default: products of lags).
    #[arg(long, value_name = "ITEMS")]
    pub(crate) library: Option<List>,
    /// Partitions: average, zscore:1.5, kmeans:10, refined:5, lattice:5, tree:3, labels:COLUMN. Each region has terms of its own; of several (`average,kmeans:2,5,10`) one is
    /// chosen, by free runs or by what --select says (default: average).
    #[arg(short, long, value_name = "PARTITIONS")]
    pub(crate) partition: Option<String>,
    /// What partitions look at, separated by commas (default: the outputs).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) partition_on: Option<List>,
    /// Files to simulate that did not train; may be repeated.
    #[arg(long, value_name = "FILE")]
    pub(crate) free_run: Vec<PathBuf>,
    /// Show all models that were tried, not only the best.
    #[arg(long)]
    pub(crate) tried: bool,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

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
    /// Functions of one row, separated by commas (`y, u, y^2, sqrt(max(y,0))`), whose lags are the candidates (default:
    /// products of lags).
    #[arg(long, value_name = "ITEMS")]
    pub(crate) library: Option<List>,
    /// Partitions, of which --select chooses one: average, zscore:1.5, `kmeans:2,5,10`, refined:5, lattice:5, tree:3,
    /// labels:COLUMN (default: average).
    #[arg(short, long, value_name = "PARTITIONS")]
    pub(crate) partition: Option<String>,
    /// Columns that define the regions, separated by commas (default: the outputs).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) partition_on: Option<List>,
    /// File that did not train and is simulated; may be repeated.
    #[arg(long, value_name = "FILE")]
    pub(crate) free_run: Vec<PathBuf>,
    /// List of all models that were tried, instead of the best one only.
    #[arg(long)]
    pub(crate) tried: bool,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

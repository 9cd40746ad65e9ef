//! Arguments of `filter`.

use std::path::PathBuf;

use clap::Args;
use fleetfoot::FilterSection;

use super::ModelData;

#[derive(Debug, Args)]
pub(crate) struct Filter {
    #[command(flatten)]
    pub(crate) model: ModelData,
    #[command(flatten)]
    pub(crate) section: FilterSection,
    /// File for means and deviations of states, innovations, and probabilities of the regions: `*.parquet`, `*.csv`,
    /// `*.tsv` or `*.mcap` (default: none).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

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
    /// File for mean and deviation of every state, innovations, and probabilities of the regions: Parquet
    /// (`*.parquet`), text (`*.csv`, `*.tsv`) or messages (`*.mcap`) (default: none).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

//! Arguments of `resimulate`.

use std::path::PathBuf;

use clap::Args;
use fleetfoot::ResimulateSection;

use super::ModelData;

#[derive(Debug, Args)]
pub(crate) struct Resimulate {
    #[command(flatten)]
    pub(crate) model: ModelData,
    #[command(flatten)]
    pub(crate) section: ResimulateSection,
    /// Deviations of every episode.
    #[arg(long)]
    pub(crate) episodes: bool,
    /// File for states and inputs beside their measurements and the open-loop simulation: `*.parquet`, `*.csv`, `*.tsv`
    /// or `*.mcap` (default: none).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

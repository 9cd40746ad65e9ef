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
    pub(crate) how: ResimulateSection,
    /// Show the deviations of every episode.
    #[arg(long)]
    pub(crate) episodes: bool,
    /// The file to write states and inputs to, each beside what was measured and what the open loop gives: Parquet (`*.parquet`), text (`*.csv`, `*.tsv`) or messages for
    /// viewers (`*.mcap`), with layouts for Foxglove and PlotJuggler beside them (default: none).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

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
    /// File for states and inputs, each beside its measurement and the open-loop simulation: Parquet (`*.parquet`),
    /// text (`*.csv`, `*.tsv`) or messages for viewers (`*.mcap`, with layouts for Foxglove and PlotJuggler) (default:
    /// none).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
}

//! Arguments of `fit sindy`.

use clap::Args;
use fleetfoot::SindySection;

use super::{FitData, FitOutput, List};

#[derive(Debug, Args)]
pub(crate) struct FitSindy {
    #[command(flatten)]
    pub(crate) data: FitData,
    #[command(flatten)]
    pub(crate) equations: EquationArgs,
    #[command(flatten)]
    pub(crate) sindy: SindySection,
    /// Partition with equations for every region: kmeans:5, refined:5, lattice:5, tree:3, zscore:1.5, labels:COLUMN,
    /// labels:COLUMN+kmeans:3 (default: one region).
    #[arg(short, long, value_name = "PARTITION")]
    pub(crate) partition: Option<String>,
    /// Columns that define the regions, separated by commas (default: the states).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) partition_on: Option<List>,
    /// Pareto front: the least error by number of terms.
    #[arg(long)]
    pub(crate) front: bool,
    /// Steps of the rollouts that choose the span of `--derivative STATE=over:auto` (default: 50).
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub(crate) horizon: Option<u32>,
    #[command(flatten)]
    pub(crate) output: FitOutput,
}

/// Options that override `[library]`, `[states]` and `[parameters]` of the recipe.
#[derive(Debug, Args, Default)]
pub(crate) struct EquationArgs {
    /// Candidate functions, separated by commas: poly(3), sin, fourier(2), poly(1)*sin, past(5, every=2), `V^2*alpha`
    /// (default: the monomials up to --degree, else poly(2), or poly(1) where poly(2) has more than 500).
    #[arg(long, value_name = "ITEMS")]
    pub(crate) library: Option<List>,
    /// Known part of a state's equation: only the rest is learnt; may be repeated.
    #[arg(long, value_name = "STATE=EXPRESSION")]
    pub(crate) nominal: Vec<String>,
    /// Terms that a state's equation always has, separated by commas; may be repeated.
    #[arg(long, value_name = "STATE=ITEMS")]
    pub(crate) fixed: Vec<String>,
    /// Unknown number inside expressions, with the start of its search: `tau=0.05`, or `tau=0.05 in 0.01..0.3`; may be
    /// repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    pub(crate) parameter: Vec<String>,
}

//! Arguments of `frequency`.

use std::path::PathBuf;

use clap::Args;

use super::TimeArgs;

#[derive(Debug, Args)]
pub(crate) struct Frequency {
    /// Files, globs or folders of logs; a model (`*.json`) adds the response of its simulations.
    #[arg(required = true, value_name = "MODEL|DATA")]
    pub(crate) files: Vec<PathBuf>,
    /// Recipe whose columns are used, without a model (default: the columns of the logs).
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: Option<PathBuf>,
    /// Input: a column, or an expression over columns.
    #[arg(long, value_name = "COLUMN")]
    pub(crate) input: String,
    /// Output: a column, or an expression over columns; with a model one of its states.
    #[arg(long, value_name = "COLUMN")]
    pub(crate) output: String,
    /// Length of the averaged segments, rounded to a power of two of samples (default: the longest that gives sixteen
    /// segments).
    #[arg(long, value_name = "SECONDS", conflicts_with = "period")]
    pub(crate) segment: Option<f64>,
    /// Period of a periodic excitation, such as a multisine (default: averaged spectra).
    #[arg(long, value_name = "SECONDS")]
    pub(crate) period: Option<f64>,
    /// Periods at the beginning of each episode that are left out.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "period", value_parser = fleetfoot::whole::<usize>(0..=1_000_000))]
    pub(crate) skip: usize,
    #[command(flatten)]
    pub(crate) time: TimeArgs,
    /// HTML page with the Bode figure (default: none).
    #[arg(long, value_name = "FILE")]
    pub(crate) page: Option<PathBuf>,
    /// Folder for the figures as SVG (default: none).
    #[arg(long, value_name = "DIR")]
    pub(crate) svg: Option<PathBuf>,
}

//! Arguments of `fit narx`.

use std::path::PathBuf;

use clap::Args;

use super::{List, RecipeArgs};

#[derive(Debug, Args)]
pub(crate) struct FitNarx {
    /// Files, globs or folders.
    #[arg(required = true, value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) narx: NarxArgs,
    /// Partitions: average, zscore:1.5, kmeans:10, labels:COLUMN. Each region has terms of its own; of several (`average,kmeans:2,5,10`) one is
    /// chosen by free runs (default: average).
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
    /// The model to write.
    #[arg(short, long, value_name = "MODEL", default_value = "model.json")]
    pub(crate) output: PathBuf,
}

/// What `[narx]` of the recipe says; a flag overrides it.
#[derive(Debug, Args, Default)]
pub(crate) struct NarxArgs {
    /// Outputs, separated by commas (default: the recipe's states).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) outputs: Option<List>,
    /// Past values of every output (default: looked for).
    #[arg(long, value_name = "N")]
    pub(crate) lags_out: Option<usize>,
    /// Past values of every input (default: looked for).
    #[arg(long, value_name = "N")]
    pub(crate) lags_in: Option<usize>,
    /// Inputs act at once: u(k) stands beside its past (default: looked for, unless --lags-in is given).
    #[arg(long)]
    pub(crate) direct: bool,
    /// fixed: lags and degree as given, 2 where they are not; auto: the best up to them (default: what is not given is looked for).
    #[arg(long, value_name = "RULE")]
    pub(crate) order: Option<String>,
    /// How far what is not given is looked for: low, normal, high; a count of work, never of seconds (default: normal).
    #[arg(long, value_name = "EFFORT")]
    pub(crate) effort: Option<String>,
    /// Functions of outputs and inputs of one row, separated by commas (`y, u, y^2, sqrt(max(y,0))`): the candidates are the lags of each, in the place of
    /// products of lags (default: products of lags).
    #[arg(long, value_name = "ITEMS")]
    pub(crate) library: Option<List>,
    /// Terms of every equation, by forward regression: a number, auto, or all candidates (default: auto).
    #[arg(long, value_name = "N")]
    pub(crate) terms: Option<String>,
    /// The most terms that auto tries (default: 20).
    #[arg(long, value_name = "N")]
    pub(crate) max_terms: Option<usize>,
    /// What order, terms and partition are chosen by: free-run (simulations of spans that did not train), or one-step errors: one-se, cv, aic, bic,
    /// ebic (default: free-run).
    #[arg(long, value_name = "RULE")]
    pub(crate) select: Option<String>,
    /// Spans of the training rows that are held out in turn (default: 5).
    #[arg(long, value_name = "N")]
    pub(crate) folds: Option<usize>,
    /// Keep every n-th row (default: 1, all of them).
    #[arg(long, value_name = "N")]
    pub(crate) decimate: Option<usize>,
    /// The last share of the rows of every episode, which does not train and is simulated (default: 0).
    #[arg(long, value_name = "SHARE")]
    pub(crate) test_share: Option<f64>,
    /// Seed of k-means (default: 0).
    #[arg(long, value_name = "SEED")]
    pub(crate) seed: Option<u64>,
    /// Clusterings of every k-means to choose from by free runs, from the seed and the next ones (default: 1).
    #[arg(long, value_name = "N")]
    pub(crate) starts: Option<usize>,
}

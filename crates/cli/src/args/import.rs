//! Arguments of `import`.

use std::path::PathBuf;

use clap::Args;

#[derive(Debug, Args)]
pub(crate) struct Import {
    /// Network, an ONNX file.
    #[arg(value_name = "NETWORK")]
    pub(crate) network: PathBuf,
    /// Logs that trained it: files, globs or folders, for training ranges and residuals (default: both are unknown).
    #[arg(value_name = "DATA")]
    pub(crate) data: Vec<PathBuf>,
    /// Recipe: its states and inputs, with their lags, are the network's inputs in order, its targets the outputs.
    #[arg(short = 'c', long = "recipe", value_name = "RECIPE")]
    pub(crate) recipe: PathBuf,
    /// Time between rows (default: that of the logs, else `dt` or `rate` in the recipe's `[time]`).
    #[arg(long, value_name = "SECONDS")]
    pub(crate) dt: Option<f64>,
    /// Model to write.
    #[arg(short, long, value_name = "MODEL", default_value = "model.json")]
    pub(crate) output: PathBuf,
}

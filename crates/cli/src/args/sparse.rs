//! Arguments of `fit sparse`.

use std::path::PathBuf;

use clap::Args;

use super::RecipeArgs;

#[derive(Debug, Args)]
pub(crate) struct FitSparse {
    /// Files, globs or folders; or one `.stats` file, which needs no pass.
    #[arg(required = true, value_name = "DATA|STATS")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) sparse: SparseArgs,
    /// A label of the episodes from the path of their file: `aircraft={dir1}` is the name of its folder; also {dir2}, {name}, {stem}; may be repeated.
    #[arg(long, value_name = "NAME=TEXT")]
    pub(crate) key: Vec<String>,
    /// Fit a model for every value of this label: model_{value}.json, and a table of selection frequencies by value (default: one
    /// model of all).
    #[arg(long, value_name = "LABEL")]
    pub(crate) by: Option<String>,
    /// The Parquet file to write coefficients and selection frequencies to, a row a candidate (default: none).
    #[arg(long, value_name = "FILE")]
    pub(crate) frequencies: Option<PathBuf>,
    /// The `.stats` file to keep the statistic of the pass in: to fit again without one (default: none).
    #[arg(long, value_name = "STATS")]
    pub(crate) keep: Option<PathBuf>,
    /// Leave every episode out once, without another pass: which ones carry the fit (Cook's distance), and what it errs on episodes that it has not seen.
    #[arg(long)]
    pub(crate) influence: bool,
    /// Tell what the job would read and keep, and stop.
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// The model to write.
    #[arg(short, long, value_name = "MODEL", default_value = "model.json")]
    pub(crate) output: PathBuf,
}

/// What `[sparse]` of the recipe says; a flag overrides it.
#[derive(Debug, Args, Default)]
pub(crate) struct SparseArgs {
    /// Strength of the l1 penalty, `1/(2n) rss + lambda l1`: auto, a number, or `0.5/sqrt(n)` (default: auto).
    #[arg(long, value_name = "LAMBDA")]
    pub(crate) lambda: Option<String>,
    /// What lambda is chosen by: one-se (largest within one standard error of the least held-out error), cv (least held-out error), aic, bic,
    /// ebic (default: one-se).
    #[arg(long, value_name = "RULE")]
    pub(crate) select: Option<String>,
    /// Held-out rows: a number of folds (whole episodes when there are as many, and five; else spans of every episode in turn, five at least), episodes
    /// (each left out once), splits:30 (random splits with a third held out), or auto, ten folds, five of few rows (default: auto).
    #[arg(long, value_name = "FOLDS")]
    pub(crate) folds: Option<String>,
    /// Share of the l1 penalty in an elastic net (default: 1, the lasso).
    #[arg(long, value_name = "SHARE")]
    pub(crate) l1_ratio: Option<f64>,
    /// Adaptive lasso: penalty factors from a first least-squares fit.
    #[arg(long)]
    pub(crate) adaptive: bool,
    /// Bolasso: keep what the replicates agree on. Resample rows (the paper's way; needs the logs), chunks or episodes, 128 times or as many as said:
    /// `episodes:1000` (default: no bolasso).
    #[arg(long, value_name = "UNIT[:B]", conflicts_with = "stability")]
    pub(crate) bolasso: Option<String>,
    /// Share of the replicates that must select a column (default: 1, of a stability selection 0.9).
    #[arg(long, value_name = "SHARE")]
    pub(crate) threshold: Option<f64>,
    /// Stability selection by complementary halves, with its bound on false selections.
    #[arg(long)]
    pub(crate) stability: bool,
    /// Strength lambda_t of all priors (default: that of each prior, else 1).
    #[arg(long, value_name = "STRENGTH")]
    pub(crate) prior_strength: Option<f64>,
    /// Penalise coefficients in raw units instead of in those of their columns.
    #[arg(long)]
    pub(crate) unscaled: bool,
    /// Seed of everything random (default: 0).
    #[arg(long, value_name = "SEED")]
    pub(crate) seed: Option<u64>,
}

//! Arguments of `fit sindy`.

use std::path::PathBuf;

use clap::Args;

use super::{List, RecipeArgs};

#[derive(Debug, Args)]
pub(crate) struct FitSindy {
    /// Files, globs or folders; or one `.stats` file, which needs no pass.
    #[arg(required = true, value_name = "DATA|STATS")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) recipe: RecipeArgs,
    #[command(flatten)]
    pub(crate) sindy: SindyArgs,
    /// Equations in every region of a partition: kmeans:5, zscore:1.5, labels:COLUMN, labels:COLUMN+kmeans:3 (default: one region).
    #[arg(short, long, value_name = "PARTITION")]
    pub(crate) partition: Option<String>,
    /// What the partition looks at, separated by commas (default: the states).
    #[arg(long, value_name = "COLUMNS")]
    pub(crate) partition_on: Option<List>,
    /// Show the Pareto front: the error of the best model of every number of terms.
    #[arg(long)]
    pub(crate) front: bool,
    /// Write the models of the Pareto front beside the chosen one: model_terms3.json, model_terms4.json, ...
    #[arg(long)]
    pub(crate) keep_front: bool,
    /// Steps of the rollouts that choose the span of `--derivative STATE=over:auto` (default: 50).
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) horizon: Option<u32>,
    /// Tell what the job would read and keep, and stop.
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// The model to write.
    #[arg(short, long, value_name = "MODEL", default_value = "model.json")]
    pub(crate) output: PathBuf,
}

/// What `[library]`, `[states]`, `[parameters]` and `[sindy]` of the recipe say; a flag overrides it.
#[derive(Debug, Args, Default)]
pub(crate) struct SindyArgs {
    /// Candidate functions, separated by commas: poly(3), sin, fourier(2), poly(1)*sin, past(5, every=2), `V^2*alpha`
    /// (default: poly(2), or the monomials up to --degree).
    #[arg(long, value_name = "ITEMS")]
    pub(crate) library: Option<List>,
    /// Known part of a state's equation: only the rest is learnt; may be repeated.
    #[arg(long, value_name = "STATE=EXPRESSION")]
    pub(crate) nominal: Vec<String>,
    /// Terms that a state's equation has in any case, separated by commas; may be repeated.
    #[arg(long, value_name = "STATE=ITEMS")]
    pub(crate) fixed: Vec<String>,
    /// A number inside expressions that is not known, and where its search begins: `tau=0.05`, with bounds `tau=0.05 in 0.01..0.3`; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    pub(crate) parameter: Vec<String>,
    /// How terms are found: auto (thresholds of stlsq and backward elimination together), stlsq, sr3, ssr, frols, lasso, ols (default: auto; stlsq for a given
    /// threshold).
    #[arg(long, value_name = "NAME")]
    pub(crate) optimizer: Option<String>,
    /// Smallest coefficient that stays, of stlsq and sr3: a number, or auto (default: auto, a sweep and --select).
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub(crate) threshold: Option<String>,
    /// Weight of the squared coefficients while terms are chosen by stlsq (default: 0.05 for a given threshold, 0 for auto).
    #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
    pub(crate) ridge: Option<f64>,
    /// Thresholds are shares of the target's size instead of physical coefficients (default for --threshold auto).
    #[arg(long)]
    pub(crate) normalize: bool,
    /// Number of terms of every equation, in place of a threshold (default: by the threshold).
    #[arg(long, value_name = "N")]
    pub(crate) terms: Option<usize>,
    /// What the number of terms is chosen by: one-se (fewest within one standard error of the least held-out error), cv (least held-out error), aic, bic,
    /// ebic (default: one-se).
    #[arg(long, value_name = "RULE")]
    pub(crate) select: Option<String>,
    /// Held-out rows: a number of folds (whole episodes when there are as many, and five; else spans of every episode in turn, five at least), episodes
    /// (each left out once), splits:30 (random splits with a third held out), or auto, ten folds, five of few rows (default: auto).
    #[arg(long, value_name = "FOLDS")]
    pub(crate) folds: Option<String>,
    /// Keep the terms that many fits agree on, to varied chunks, episodes or libraries: `chunks:100` (default: one fit).
    #[arg(long, value_name = "WHAT[:N]")]
    pub(crate) ensemble: Option<String>,
    /// Share of an ensemble's fits that must have a term (default: 0.6).
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    pub(crate) inclusion: Option<f64>,
    /// Seed of everything random (default: 0).
    #[arg(long, value_name = "SEED")]
    pub(crate) seed: Option<u64>,
}

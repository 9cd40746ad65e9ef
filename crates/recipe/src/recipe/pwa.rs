//! `[pwa]`: piecewise-affine models. Partitions, degree and target are in `[model]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    bounds::whole,
    objective::Objective,
    phase::PhaseColumn,
    ports::PortList,
    settings::{Tunable, settings},
};

/// Rule that chooses one of several partitions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum PartitionChoice {
    /// The smallest model whose cross-validated error is within one standard error of the best.
    Cv,
    /// The lowest Bayesian information criterion, with the effective sample size.
    Bic,
    /// Least error of rollouts over the horizon on held-out spans.
    Rollout,
}

/// Rule for labels that training did not see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum UnseenLabels {
    /// An error.
    Refuse,
    /// The model fitted on all rows.
    Pool,
}

/// Prediction of a model of several regions outside of the training ranges of its regions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum OutsideRanges {
    /// From the border of the range on by the slopes of the one-region model.
    Average,
    /// With the value at the border of the range.
    Hold,
    /// By the map of the region, however far.
    Extrapolate,
}

settings! {
    pwa, |_, _| {};
    /// Settings of a piecewise-affine model. Every entry is the flag of `fit pwa` of the same name.
    pub struct PwaSection {
        /// Rule that chooses one of several partitions (default: cv).
        #[arg(long, value_enum, value_name = "RULE")]
        pub select: PartitionChoice,
        /// Steps of the rollouts that `--select rollout`, or a span of `over:auto`, compares (default: 50).
        #[arg(long, value_name = "STEPS", value_parser = whole::<u32>(0..=10_000_000))]
        pub horizon: u32,
        /// Objective of the coefficients: one-step; steps:N, simulations of N steps; or free-run, as long as held-out
        /// rows allow. A model fitted to simulations is written only if its held-out rollouts are better (default:
        /// one-step).
        #[arg(long, value_name = "OBJECTIVE")]
        pub objective: Objective,
        /// Folds of the cross-validation: whole episodes when there are as many (and five), else spans of every
        /// episode; 0 for none (default: 10).
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=100))]
        pub folds: u16,
        /// Seconds between held-out and training rows of one episode (default: a tenth of the held-out span).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub purge: f64,
        /// Pull of each region's map towards the map of all rows: a number of rows, none, or auto, by cross-validation
        /// (default: auto).
        #[arg(long, value_name = "ROWS", allow_negative_numbers = true)]
        pub shrinkage: Tunable,
        /// Maps of neighbouring regions meet at their border, for kmeans, refined and tree on columns that are
        /// regressors (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub continuous: bool,
        /// Contraction bound of each region's map over one sampling period (spectral norm in the shared metric): stable
        /// at 1; at 0.99 states shrink by a hundredth a row (default: free).
        #[arg(long, value_name = "BOUND", num_args = 0..=1, require_equals = true, default_missing_value = "1", allow_negative_numbers = true)]
        pub stable: f64,
        /// Ports (`force:speed`, separated by commas), inputs with the states whose product is a power: maps give out
        /// no more energy than they took in, and are stable. INPUT:STATE:SHORTAGE sets the allowed energy gain per sample,
        /// else twice the discretisation error (default: free).
        #[arg(long, value_name = "INPUT:STATE[:SHORTAGE],...")]
        pub passive: PortList,
        /// Phase for the counts of regions, along it and from stride to stride: a periodic column or expression, in 12
        /// bins or as in COLUMN:24, or labels:COLUMN. Rows without it do not train; `show --transitions` prints the
        /// counts (default: none).
        #[arg(long, value_name = "COLUMN[:BINS]")]
        pub phase: PhaseColumn,
        /// Rule for labels that training did not see (default: refuse).
        #[arg(long, value_enum, value_name = "WHAT")]
        pub unseen_labels: UnseenLabels,
        /// Prediction where a regressor leaves the training range of its region (bounded maps, and maps that
        /// meet at borders, always extrapolate) (default: average).
        #[arg(long, value_enum, value_name = "WHAT")]
        pub outside: OutsideRanges,
        /// Seed of k-means++ (default: 0).
        #[arg(long, value_name = "SEED")]
        pub seed: u64,
        /// Number of k-means runs, of which the best is kept (default: 1).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1000))]
        pub restarts: usize,
        /// Largest number of iterations of k-means (default: 100).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub iterations: usize,
        /// Memory for the rows of k-means; beyond it a sample is clustered (default: 512).
        #[arg(long, value_name = "MiB", allow_negative_numbers = true)]
        pub memory: f64,
        /// Fit by TSQR in one more pass, instead of the preconditioned Gram matrix (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub tsqr: bool,
    }
}

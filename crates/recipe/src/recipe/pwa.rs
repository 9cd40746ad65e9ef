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
    /// Smallest model within one standard error of the least cross-validated error.
    Cv,
    /// Bayesian information criterion of the effective rows.
    Bic,
    /// Least error of rollouts on held-out spans.
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
    /// On from the border by the slopes of the one-region model.
    Average,
    /// Value at the border.
    Hold,
    /// By the map of the region.
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
        /// rows allow (default: one-step).
        #[arg(long, value_name = "OBJECTIVE")]
        pub objective: Objective,
        /// Folds of the cross-validation: whole episodes if there are enough, else spans; 0 for none (default: 10).
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=100))]
        pub folds: u16,
        /// Seconds between held-out and training rows of one episode (default: a tenth of the held-out span).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub purge: f64,
        /// Pull of each region's map towards the map of all rows: a number of rows, none, or auto, by cross-validation
        /// (default: auto).
        #[arg(long, value_name = "ROWS", allow_negative_numbers = true)]
        pub shrinkage: Tunable,
        /// Maps of neighbouring regions meet at their border, for kmeans, refined and tree on regressors (default:
        /// false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub continuous: bool,
        /// Contraction bound of each region's map over one sampling period, in a shared metric; stable at 1 (default:
        /// free).
        #[arg(long, value_name = "BOUND", num_args = 0..=1, require_equals = true, default_missing_value = "1", allow_negative_numbers = true)]
        pub stable: f64,
        /// Ports (`force:speed`, separated by commas): stable maps that give out no more energy there than they took
        /// in. SHORTAGE is the allowed energy gain per sample, else twice the discretisation error (default: free).
        #[arg(long, value_name = "INPUT:STATE[:SHORTAGE],...")]
        pub passive: PortList,
        /// Phase along which regions are counted: a periodic column or expression, in 12 bins or as in COLUMN:24, or
        /// labels:COLUMN (default: none).
        #[arg(long, value_name = "COLUMN[:BINS]")]
        pub phase: PhaseColumn,
        /// Rule for labels that training did not see (default: refuse).
        #[arg(long, value_enum, value_name = "WHAT")]
        pub unseen_labels: UnseenLabels,
        /// Prediction where a regressor leaves the training range of its region; bounded or continuous maps extrapolate
        /// (default: average).
        #[arg(long, value_enum, value_name = "WHAT")]
        pub outside: OutsideRanges,
        /// Seed of all random numbers (default: 0).
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

//! Sections of equations from libraries: `[library]`, `[parameters]`, `[sindy]`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Recipe,
    bounds::whole,
    criterion::Criterion,
    objective::Objective,
    settings::{Tunable, settings},
};
use crate::groups::GroupWords;

/// Candidate functions of every equation without a library of its own, in the library language.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LibrarySection {
    /// `["poly(3)", "sin", "V^2*alpha"]`; when empty the monomials up to the degree of `[model]`, else `poly(2)`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub functions: Vec<String>,
    /// Number of radial functions beside the others, around k-means centroids of states and inputs; for `fit pwa` and
    /// `fit sindy`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radial: Option<usize>,
}

/// Unknown number to estimate; it may stand wherever a column may: in library items, nominal dynamics and targets.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterSection {
    /// Start of the search.
    pub initial: f64,
    /// Least and greatest value; no bounds when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f64; 2]>,
    /// Held at its initial value; for `fit parameters`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixed: Option<bool>,
    /// Unit, for reports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// Units of thresholds and of the ridge: a choice, or a word.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected true, false or \"length\"")]
pub enum Normalize {
    /// Shares of the target, or physical coefficients.
    Choice(bool),
    /// `length`.
    Word(String),
}

impl std::str::FromStr for Normalize {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Word(text.to_owned()), Self::Choice))
    }
}

/// Optimiser that selects the terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum SindyOptimizer {
    /// Best support of stlsq thresholds and backward elimination.
    #[default]
    Auto,
    /// Sequentially thresholded least squares (Brunton, Proctor, Kutz 2016, Algorithm 1).
    Stlsq,
    /// Sparse relaxed regularised regression.
    Sr3,
    /// Stepwise sparse regression: one term less at a time.
    Ssr,
    /// Forward orthogonal least squares by error reduction ratio.
    Frols,
    /// Lasso path.
    Lasso,
    /// Path of the group lasso or sparse-group lasso.
    GroupLasso,
    /// Least squares on all candidates.
    #[serde(rename = "ols")]
    #[value(name = "ols")]
    LeastSquares,
}

impl SindyOptimizer {
    /// The word for users.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Stlsq => "stlsq",
            Self::Sr3 => "sr3",
            Self::Ssr => "ssr",
            Self::Frols => "frols",
            Self::Lasso => "lasso",
            Self::GroupLasso => "group-lasso",
            Self::LeastSquares => "ols",
        }
    }

    /// True for optimisers with a threshold.
    pub fn thresholds(self) -> bool {
        matches!(self, Self::Auto | Self::Stlsq | Self::Sr3)
    }
}

/// Rule for smoothing the states under the equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum SmoothStates {
    /// On for at most 20,000 rows that are fitted on windows because of noise.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

settings! {
    sindy, SindySection::silenced;
    /// Settings of sparse equations. Every entry is the flag of `fit sindy` of the same name.
    pub struct SindySection {
        /// Optimiser that selects the terms (default: auto; stlsq for a given threshold, group-lasso for given groups).
        #[arg(long, value_enum, value_name = "NAME")]
        pub optimizer: SindyOptimizer,
        /// Smallest coefficient that stays, for stlsq and sr3: a number, or auto (default: auto, a sweep and --select).
        #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
        pub threshold: Tunable,
        /// Weight of the squared coefficients in the regressions of stlsq (default: 0.05 for a given threshold, 0 for
        /// auto).
        #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
        pub ridge: f64,
        /// Thresholds and ridge in shares of the target's size (default for a threshold of auto), or length:
        /// coefficients of columns of length 1, as pysindy's `normalize_columns`.
        #[arg(long, value_name = "BOOL|length", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
        pub normalize: Normalize,
        /// Largest number of regressions of stlsq (default: 20).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub max_iterations: usize,
        /// Weight of a term in the stopping rule of frols, as in pysindy (default: by --select).
        #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
        pub kappa: f64,
        /// Number of terms of every equation, in place of a threshold (default: by the threshold).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub terms: usize,
        /// Rule that chooses the number of terms (default: one-se).
        #[arg(long, value_enum, value_name = "RULE")]
        pub select: Criterion,
        /// Objective of the coefficients: one-step; steps:N, simulations of N steps; or free-run, as long as held-out
        /// rows allow (default: one-step).
        #[arg(long, value_name = "OBJECTIVE")]
        pub objective: Objective,
        /// Weak form, without differences: windows of a number of rows, auto (a length by the signals), or off
        /// (default: auto where more than a fifth of the variance of some state's differences is noise, else off).
        #[arg(long, value_name = "ROWS|auto|off")]
        pub weak: Tunable,
        /// Smoothing of the states under the equations, in turn with the fit (default: auto).
        #[arg(long, value_enum, value_name = "WHEN")]
        pub smooth_states: SmoothStates,
        /// Folds: a number (whole episodes if there are enough, else spans), episodes (each left out once), splits:30
        /// (random splits with a third held out), or auto: ten, five of few rows (default: auto).
        #[arg(long, value_name = "FOLDS")]
        pub folds: String,
        /// Ensemble of fits to varied chunks, episodes or libraries, `chunks:100`, whose common terms are kept
        /// (default: one fit).
        #[arg(long, value_name = "WHAT[:N]")]
        pub ensemble: String,
        /// Share of an ensemble's fits that must have a term (default: 0.6).
        #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
        pub inclusion: f64,
        /// Seed of all random numbers (default: 0).
        #[arg(long, value_name = "SEED")]
        pub seed: u64,
        /// Share of the absolute values in the penalty of the group lasso, beside the norms of its groups (default: 0).
        #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
        pub l1_ratio: f64,
        /// Groups of functions that enter together, for the group lasso: signal (a signal with its powers and lags), or
        /// named signals, `legs=q1,q2,arms=q3,q4` (default of group-lasso: signal).
        #[arg(long, value_name = "RULE|NAME=SIGNALS")]
        pub groups: GroupWords,
    }
}

impl SindySection {
    /// A threshold and a number of terms exclude each other; the options of the fit refuse both at once.
    fn silenced(&self, recipe: &mut Recipe) {
        if self.threshold.is_some() {
            recipe.sindy.terms = None;
        }
        if self.terms.is_some() {
            recipe.sindy.threshold = None;
        }
    }
}

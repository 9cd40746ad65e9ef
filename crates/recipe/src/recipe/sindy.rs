//! Sections of equations from libraries: `[library]`, `[parameters]`, `[sindy]`.

use serde::{Deserialize, Serialize};

use super::{
    Recipe,
    bounds::whole,
    criterion::Criterion,
    objective::Objective,
    settings::{Tunable, settings},
};
use crate::groups::GroupWords;

/// Candidate functions of every equation that has no library of its own, in the library language (`fleetfoot_library::Library::parse`).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LibrarySection {
    /// `["poly(3)", "sin", "V^2*alpha"]`; the monomials up to the degree of `[model]`, else `poly(2)`, when empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub functions: Vec<String>,
    /// So many radial functions beside the others, around the centroids of k-means on the states and inputs; of `fit pwa` and `fit sindy`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radial: Option<usize>,
}

/// A number that is not known: it stands in library items, nominal dynamics and targets, wherever a column may, and is estimated.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterSection {
    /// Where the search begins.
    pub initial: f64,
    /// Least and greatest value; no bounds when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f64; 2]>,
    /// Whether it stays where it is; of `fit parameters`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixed: Option<bool>,
    /// Unit, for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// The units of thresholds and of the ridge: a choice, or a word.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
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

/// Which optimiser looks for the terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum SindyOptimizer {
    /// The best known: thresholds of stlsq and backward elimination together, whose supports compete.
    #[default]
    Auto,
    /// Sequentially thresholded least squares (Brunton, Proctor, Kutz 2016, Algorithm 1).
    Stlsq,
    /// Sparse relaxed regularised regression.
    Sr3,
    /// Stepwise sparse regression: one term less at a time.
    Ssr,
    /// Forward regression, orthogonal least squares by error reduction ratio.
    Frols,
    /// The path of the lasso.
    Lasso,
    /// The path of the group lasso, or of the sparse-group lasso.
    GroupLasso,
    /// Least squares on all candidates.
    #[serde(rename = "ols")]
    #[value(name = "ols")]
    LeastSquares,
}

impl SindyOptimizer {
    /// As users write it.
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

    /// Whether it has a threshold.
    pub fn thresholds(self) -> bool {
        matches!(self, Self::Auto | Self::Stlsq | Self::Sr3)
    }
}

/// When states are smoothed under the equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum SmoothStates {
    /// Where equations are fitted on windows because of noise, nothing else is asked for that it would overrule, and there are no more than 20,000 rows.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

settings! {
    sindy, SindySection::silenced;
    /// How equations are found. Every entry is the flag of `fit sindy` of the same name.
    pub struct SindySection {
        /// How terms are found (default: auto; stlsq for a given threshold, group-lasso for given groups).
        #[arg(long, value_enum, value_name = "NAME")]
        pub optimizer: SindyOptimizer,
        /// Smallest coefficient that stays, of stlsq and sr3: a number, or auto (default: auto, a sweep and --select).
        #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
        pub threshold: Tunable,
        /// Weight of the squared coefficients while terms are chosen by stlsq (default: 0.05 for a given threshold, 0 for auto).
        #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
        pub ridge: f64,
        /// Thresholds and ridge see shares of the target's size instead of physical coefficients (default for a threshold of auto); length: coefficients of
        /// columns of length 1, which grow with the number of rows, as pysindy's `normalize_columns` has them.
        #[arg(long, value_name = "BOOL|length", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
        pub normalize: Normalize,
        /// Regressions of stlsq at most (default: 20).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub max_iterations: usize,
        /// Forward regression (frols) chooses the number of terms by its error reduction ratios, as pysindy does: this is the weight of a term, relative to the
        /// condition number of the columns (default: by --select).
        #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
        pub kappa: f64,
        /// Number of terms of every equation, in place of a threshold (default: by the threshold).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub terms: usize,
        /// What the number of terms is chosen by (default: one-se).
        #[arg(long, value_enum, value_name = "RULE")]
        pub select: Criterion,
        /// What coefficients are fitted to: one-step; steps:N, simulations of N steps; or free-run, as long as held-out rows allow. The simulations' model is written where its rollouts of held-out rows
        /// are the better ones (default: one-step).
        #[arg(long, value_name = "OBJECTIVE")]
        pub objective: Objective,
        /// Fit on windows of so many rows in the place of rows (weak form), so that no noisy row is differentiated: a number, auto (a length by the signals), or off
        /// (default: auto where more than a
        /// fifth of the variance of some state's differences is noise, else off).
        #[arg(long, value_name = "ROWS|auto|off")]
        pub weak: Tunable,
        /// Smooth the states under the equations and find both together, in turn, of logs that fit into memory: on, off, or auto, up to 20,000 rows where there are windows
        /// because of noise (default: auto).
        #[arg(long, value_enum, value_name = "WHEN")]
        pub smooth_states: SmoothStates,
        /// Held-out rows: a number of folds (whole episodes when there are as many, and five; else spans of every episode in turn, five at least), episodes
        /// (each left out once), splits:30 (random splits with a third held out), or auto, ten folds, five of few rows (default: auto).
        #[arg(long, value_name = "FOLDS")]
        pub folds: String,
        /// Keep the terms that many fits agree on, to varied chunks, episodes or libraries: `chunks:100` (default: one fit).
        #[arg(long, value_name = "WHAT[:N]")]
        pub ensemble: String,
        /// Share of an ensemble's fits that must have a term (default: 0.6).
        #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
        pub inclusion: f64,
        /// Seed of everything random (default: 0).
        #[arg(long, value_name = "SEED")]
        pub seed: u64,
        /// Share of the absolute values in the penalty of the group lasso, beside the norms of its groups (default: 0).
        #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
        pub l1_ratio: f64,
        /// Functions that enter together, of the group lasso: signal (a signal with its powers and lags), or the functions of named signals, `legs=q1,q2,arms=q3,q4`
        /// (default of group-lasso: signal).
        #[arg(long, value_name = "RULE|NAME=SIGNALS")]
        pub groups: GroupWords,
    }
}

impl SindySection {
    /// A threshold and a number of terms exclude each other; both said at once are left for the options of the fit to refuse.
    fn silenced(&self, recipe: &mut Recipe) {
        if self.threshold.is_some() {
            recipe.sindy.terms = None;
        }
        if self.terms.is_some() {
            recipe.sindy.threshold = None;
        }
    }
}

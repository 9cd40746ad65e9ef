//! `[narx]`: autoregressions of outputs on past outputs and inputs. `[library]` has functions to lag in place of outputs
//! and inputs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Recipe, alias::also, bounds::whole, criterion::Criterion, objective::Objective, settings::settings};

/// Search effort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
#[schemars(transform = also("medium", "normal"))]
pub enum Effort {
    /// Few lags, small libraries.
    Low,
    /// Enough for most machines, within a minute.
    #[default]
    #[serde(alias = "medium")]
    #[value(alias = "medium")]
    Normal,
    /// Ten times the effort of normal.
    High,
}

impl Effort {
    /// The word for users.
    pub fn word(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Normal => "normal",
            Self::High => "high",
        }
    }
}

/// Rule that chooses order, terms and partition: `free-run`, or a criterion of one-step errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", expecting = "expected free-run, one-se, cv, aic, bic or ebic")]
pub enum NarxSelection {
    /// Error of simulations of spans that did not train.
    #[default]
    FreeRun,
    /// One-step errors.
    #[serde(untagged)]
    OneStep(Criterion),
}

impl clap::ValueEnum for NarxSelection {
    fn value_variants<'a>() -> &'a [Self] {
        use Criterion::{Aic, Bic, CrossValidation, Ebic, OneStandardError};
        &[
            Self::FreeRun,
            Self::OneStep(OneStandardError),
            Self::OneStep(CrossValidation),
            Self::OneStep(Aic),
            Self::OneStep(Bic),
            Self::OneStep(Ebic),
        ]
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        match self {
            Self::FreeRun => {
                Some(clap::builder::PossibleValue::new("free-run").help("Simulations of spans that did not train"))
            }
            Self::OneStep(criterion) => criterion.to_possible_value(),
        }
    }
}

/// Use of given lags and degree: those of the model, or its limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum GivenAs {
    /// Exactly the given lags and degree; 2 where one is not given.
    Fixed,
    /// The best lags and degree up to the given ones.
    Auto,
}

settings! {
    narx, NarxSection::silenced;
    /// Settings of an autoregression. Every entry is the flag of `fit narx` of the same name; outputs are `[states]`,
    /// inputs `[inputs]`.
    pub struct NarxSection {
        /// Past values of every output, y(k-1) to y(k-N) (default: searched).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1000))]
        pub lags_out: usize,
        /// Past values of every input, u(k-1) to u(k-N) (default: searched).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1000))]
        pub lags_in: usize,
        /// Direct feedthrough: u(k) is a candidate beside its past (default: searched, unless --lags-in is given).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub direct: bool,
        /// Use of given lags and degree (default: the search covers those that are not given).
        #[arg(long, value_enum, value_name = "RULE")]
        pub order: GivenAs,
        /// Search effort, a count of work, never of seconds (default: normal).
        #[arg(long, value_enum, value_name = "EFFORT")]
        pub effort: Effort,
        /// Terms of every equation, by forward regression: a number, auto, or all candidates (default: auto).
        #[arg(long, value_name = "N")]
        pub terms: NarxTerms,
        /// Largest number of terms that auto tries (default: 20).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=10_000))]
        pub max_terms: usize,
        /// Rule that chooses order, terms and partition (default: free-run).
        #[arg(long, value_enum, value_name = "RULE")]
        pub select: NarxSelection,
        /// Objective of the coefficients: one-step; steps:N, simulations of N steps; or free-run, as long as held-out
        /// rows allow (default: one-step).
        #[arg(long, value_name = "OBJECTIVE")]
        pub objective: Objective,
        /// Number of spans of the training rows that are held out in turn (default: 5).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1000))]
        pub folds: usize,
        /// Interval of the rows that are kept (default: 1, all of them).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub decimate: usize,
        /// Share of the rows at the end of every episode that does not train and is simulated (default: 0).
        #[arg(long, value_name = "SHARE")]
        pub test_share: f64,
        /// Seed of all random numbers (default: 0).
        #[arg(long, value_name = "SEED")]
        pub seed: u64,
        /// Number of clusterings of every k-means; free runs choose one (default: 1).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub starts: usize,
    }
}

impl NarxSection {
    /// Lags of outputs or inputs replace the general lags of `[model]`.
    fn silenced(&self, recipe: &mut Recipe) {
        if self.lags_out.is_some() || self.lags_in.is_some() {
            recipe.model.lags = None;
        }
    }
}

/// A number of terms, or a word.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number, \"auto\" or \"all\"")]
pub enum NarxTerms {
    /// Given number.
    Number(usize),
    /// `auto` or `all`.
    Word(String),
}

impl std::str::FromStr for NarxTerms {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Word(text.to_owned()), Self::Number))
    }
}

/// Effort as a count of evaluations, never of seconds, so that the same input gives the same model.
impl Effort {
    /// Largest number of evaluated terms.
    pub fn limit(self) -> u64 {
        match self {
            Self::Low => 300_000_000,
            Self::Normal => 3_000_000_000,
            Self::High => 30_000_000_000,
        }
    }

    /// Lags of the linear models, where they are not given.
    pub fn lags(self) -> &'static [usize] {
        match self {
            Self::Low => &[1, 2, 3, 4],
            Self::Normal => &[1, 2, 3, 4, 5, 6, 8, 10],
            Self::High => &[1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 20],
        }
    }

    /// Linear models whose lags nonlinear models take over.
    pub fn seeds(self) -> usize {
        match self {
            Self::Low => 1,
            Self::Normal => 4,
            Self::High => 10,
        }
    }

    /// Largest number of candidates of an order.
    pub fn most_candidates(self) -> usize {
        match self {
            Self::Low => 120,
            Self::Normal => 300,
            Self::High => 1_000,
        }
    }

    /// Rounds in which the orders next to the best one are tried.
    pub fn rounds(self) -> usize {
        match self {
            Self::Low => 1,
            Self::Normal => 4,
            Self::High => 12,
        }
    }
}

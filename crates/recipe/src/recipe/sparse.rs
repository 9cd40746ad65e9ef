//! Sections of structured sparse regression: `[latents]`, `[tasks]`, `[sparse]`.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Recipe, criterion::Criterion, settings::settings};
use crate::groups::GroupWords;

/// Unknown function and its candidates: monomials of variables, or functions one by one.
///
/// `T = { times = "N1", of = ["rho", "M"], degree = 4 }` is N1 times every monomial of degree 0 to 4 in rho and M.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LatentSection {
    /// Factor of every candidate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub times: Option<String>,
    /// Variables of the monomials.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub of: Vec<String>,
    /// Total degree of the monomials; 1 when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub degree: Option<u32>,
    /// Candidates one by one, beside the monomials.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub functions: Vec<String>,
    /// The monomial of degree 0 is a candidate (default: yes with `of`, no without).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constant: Option<bool>,
    /// Penalty factor of its coefficients relative to lambda; 1 when not given, 0 for none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub penalty: Option<f64>,
    /// Signs of its coefficients: `+`, `-`, or `free`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub signs: Option<String>,
    /// Least value on the training data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_least: Option<f64>,
    /// Greatest value on the training data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_most: Option<f64>,
    /// Expected function: an expression over columns (paper, equation (41)).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior: Option<String>,
    /// Weight of the squared deviation from the prior, lambda_t; that of `[sparse]`, else 1, when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior_strength: Option<f64>,
    /// The deviation from the prior that counts as one; the prior's root mean square when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior_scale: Option<f64>,
}

/// A regression equation, linear in the latents: `target = right + error`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TaskSection {
    /// The left side, an expression over columns.
    pub target: String,
    /// The right side, an expression over columns and latents.
    pub right: String,
    /// The error that counts as one, in units of the target; the target's standard deviation when not given. A constant target needs it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
}

/// Limits on latents at every row of the training data: a sum of coefficients times latents, or a symmetric matrix of
/// them, on one side of a bound or between two; or limits on single coefficients.
///
/// `friction = { of = "F*v", at_least = 0.0 }` only takes power;
/// `inertia = { matrix = [["M11", "M12"], ["M12", "M22"]], at_least = 1e-3 }` has no eigenvalue below the bound;
/// `damping = { coefficients = { v = ["v", "v*abs(v)"] }, at_most = 0.0 }` has no sign that drives.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ConstraintSection {
    /// An expression over columns and latents, linear in the latents.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
    /// Single coefficients, by latent, or by the state whose equation `fit sindy` learns: functions among its
    /// candidates, `1` for a constant.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub coefficients: IndexMap<String, Vec<String>>,
    /// Symmetric matrix of such expressions by rows; of each row all entries, or those up to the diagonal.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub matrix: Vec<Vec<String>>,
    /// Least value; of a matrix the least eigenvalue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_least: Option<f64>,
    /// Greatest value; of a matrix the greatest eigenvalue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_most: Option<f64>,
}

settings! {
    sparse, SparseSection::silenced;
    /// Settings of a sparse regression. Every entry is the flag of `fit sparse` of the same name.
    pub struct SparseSection {
        /// Strength of the l1 penalty, `1/(2n) rss + lambda l1` with targets and columns over their deviations: auto, a
        /// number, or `0.5/sqrt(n)` (default: auto).
        #[arg(long, value_name = "LAMBDA", allow_negative_numbers = true)]
        pub lambda: String,
        /// Rule that chooses lambda (default: one-se).
        #[arg(long, value_enum, value_name = "RULE")]
        pub select: Criterion,
        /// Folds: a number (whole episodes if there are enough, else spans), episodes (each left out once), splits:30
        /// (random splits with a third held out), or auto: ten, five of few rows (default: auto).
        #[arg(long, value_name = "FOLDS")]
        pub folds: String,
        /// Share of the absolute values in the penalty: beside squares in an elastic net (default: 1, the lasso), beside norms with groups (default: 0, the group
        /// lasso).
        #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
        pub l1_ratio: f64,
        /// Adaptive lasso: penalty factors from a first least-squares fit (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub adaptive: bool,
        /// Bolasso: replicates of rows (needs the logs), chunks or episodes, 128 of them or as in `episodes:1000`
        /// (default: no bolasso).
        #[arg(long, value_name = "UNIT[:B]", conflicts_with = "stability")]
        pub bolasso: String,
        /// Share of the replicates that must select a column (default: 1, of a stability selection 0.9).
        #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
        pub threshold: f64,
        /// Stability selection by complementary halves, with its bound on false selections (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub stability: bool,
        /// Strength lambda_t of all priors (default: 1).
        #[arg(long, value_name = "STRENGTH", allow_negative_numbers = true)]
        pub prior_strength: f64,
        /// Penalty on coefficients in raw units instead of those of their columns (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub unscaled: bool,
        /// Seed of all random numbers (default: 0).
        #[arg(long, value_name = "SEED")]
        pub seed: u64,
        /// Groups of functions that enter together (group lasso): signal (a signal with its powers and lags), term (a
        /// function in all equations), or named signals, `legs=q1,q2,arms=q3,q4` (default: every function alone).
        #[arg(long, value_name = "RULE|NAME=SIGNALS")]
        pub groups: GroupWords,
    }
}

impl SparseSection {
    /// Bolasso, stability selection and groups exclude each other; an explicit strength is that of all priors.
    fn silenced(&self, recipe: &mut Recipe) {
        let (bolasso, stability) = (self.bolasso.is_some(), self.stability == Some(true));
        if bolasso || self.groups.is_some() {
            recipe.sparse.stability = None;
        }
        if stability || self.groups.is_some() {
            recipe.sparse.bolasso = None;
        }
        if bolasso || stability {
            recipe.sparse.groups = None;
        }
        if self.prior_strength.is_some() {
            recipe.latents.values_mut().for_each(|latent| latent.prior_strength = None);
        }
    }
}

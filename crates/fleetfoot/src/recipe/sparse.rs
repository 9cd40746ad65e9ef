//! Sections of structured sparse regression: `[latents]`, `[tasks]`, `[sparse]`.

use serde::{Deserialize, Serialize};

/// An unknown function and the candidates that it may be made of: monomials of variables, or functions one by one.
///
/// `T = { times = "N1", of = ["rho", "M"], degree = 4 }` is N1 times every monomial of degree 0 to 4 in rho and M.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LatentSection {
    /// What every candidate is multiplied with.
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
    /// Whether the monomial of degree 0 is a candidate: yes with `of`, no without, when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constant: Option<bool>,
    /// Penalty factor of its coefficients relative to lambda; 1 when not given, 0 for none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub penalty: Option<f64>,
    /// Signs that its coefficients may have: `+`, `-`, or `free`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub signs: Option<String>,
    /// The least value that it may have on the training data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_least: Option<f64>,
    /// The greatest value that it may have on the training data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_most: Option<f64>,
    /// What it is believed to be: an expression over columns (paper, equation (41)).
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
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
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

/// How a sparse regression goes. Every entry is the flag of `fit sparse` of the same name.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SparseSection {
    /// `auto`, a value, or `L0/sqrt(n)`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lambda: Option<String>,
    /// `cv`, `one-se`, `aic`, `bic`, `ebic`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub select: Option<String>,
    /// `auto`, a number, `episodes`, or `splits:N`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folds: Option<String>,
    /// Share of the absolute values in the elastic net's penalty.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub l1_ratio: Option<f64>,
    /// Penalty factors from a first fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adaptive: Option<bool>,
    /// `rows`, `chunks` or `episodes`, and the replicates: `episodes:128`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bolasso: Option<String>,
    /// Share of the replicates that must select a column.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f64>,
    /// Stability selection by half-samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stability: Option<bool>,
    /// Strength of all priors that name none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior_strength: Option<f64>,
    /// Penalise coefficients in raw units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unscaled: Option<bool>,
    /// Seed of everything random.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

impl SparseSection {
    /// These words, and those of `other` where nothing is said.
    pub(crate) fn over(self, other: &Self) -> Self {
        Self {
            lambda: self.lambda.or_else(|| other.lambda.clone()),
            select: self.select.or_else(|| other.select.clone()),
            folds: self.folds.or_else(|| other.folds.clone()),
            l1_ratio: self.l1_ratio.or(other.l1_ratio),
            adaptive: self.adaptive.or(other.adaptive),
            bolasso: self.bolasso.or_else(|| other.bolasso.clone()),
            threshold: self.threshold.or(other.threshold),
            stability: self.stability.or(other.stability),
            prior_strength: self.prior_strength.or(other.prior_strength),
            unscaled: self.unscaled.or(other.unscaled),
            seed: self.seed.or(other.seed),
        }
    }
}

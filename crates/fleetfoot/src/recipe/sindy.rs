//! Sections of equations from libraries: `[library]`, `[parameters]`, `[sindy]`.

use serde::{Deserialize, Serialize};

/// Candidate functions of every equation that has no library of its own, in the library language (`fleetfoot_library::Library::parse`).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LibrarySection {
    /// `["poly(3)", "sin", "V^2*alpha"]`; the monomials up to the degree of `[model]`, else `poly(2)`, when empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub functions: Vec<String>,
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
    /// Unit, for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// A threshold: a number, or `"auto"`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number or \"auto\"")]
pub enum Threshold {
    /// This one.
    Number(f64),
    /// `auto`.
    Word(String),
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

/// How equations are found. Every entry is the flag of `fit sindy` of the same name; `max_iterations`, `kappa` and `normalize = "length"` are for those who bring
/// settings from elsewhere.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SindySection {
    /// `stlsq`, `sr3`, `ssr`, `frols`, `lasso` or `ols`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub optimizer: Option<String>,
    /// The cut-off of STLSQ and SR3; `auto` tries those at which the terms change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<Threshold>,
    /// Weight of the squared coefficients in STLSQ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ridge: Option<f64>,
    /// Whether thresholds and ridge see shares of the target instead of physical coefficients; `"length"`: coefficients of columns of length 1, which grow with
    /// the number of rows, as pysindy's `normalize_columns` has them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normalize: Option<Normalize>,
    /// Regressions of STLSQ at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_iterations: Option<usize>,
    /// Forward regression chooses the number of terms by its error reduction ratios, as pysindy does: this is the weight of a term, relative to the condition
    /// number of the columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kappa: Option<f64>,
    /// Number of terms of every equation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub terms: Option<usize>,
    /// `one-se`, `cv`, `aic`, `bic`, `ebic`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub select: Option<String>,
    /// `auto`, a number, `episodes`, or `splits:N`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folds: Option<String>,
    /// `chunks:100`, `episodes:100`, `library:100`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ensemble: Option<String>,
    /// Share of an ensemble's members that must have a term.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inclusion: Option<f64>,
    /// Seed of everything random.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

//! `[narx]`: outputs from their own past and that of the inputs. Functions that are to be lagged in the place of outputs and inputs stand in `[library]`.

use serde::{Deserialize, Serialize};

/// How an autoregression is found. Every entry is the flag of `fit narx` of the same name; outputs are `[states]`, inputs `[inputs]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NarxSection {
    /// Past values of every output: `y(k-1)` to `y(k-lags_out)`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lags_out: Option<usize>,
    /// Past values of every input: `u(k-1)` to `u(k-lags_in)`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lags_in: Option<usize>,
    /// Whether inputs act at once: `u(k)` beside their past.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direct: Option<bool>,
    /// `fixed`: lags and degree as they are given, 2 where they are not; `auto`: the best up to them. Without: what is not given is looked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// How far what is not given is looked for: `low`, `normal`, `high`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effort: Option<String>,
    /// Terms of every equation: a number, `auto`, or `all`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub terms: Option<NarxTerms>,
    /// The most terms that `auto` tries.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_terms: Option<usize>,
    /// What order, terms and partition are chosen by: `free-run`, `one-se`, `cv`, `aic`, `bic`, `ebic`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub select: Option<String>,
    /// Spans of the training rows that are held out in turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folds: Option<usize>,
    /// Every n-th row only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimate: Option<usize>,
    /// The last share of the rows of every episode, which does not train and is run freely.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub test_share: Option<f64>,
    /// Seed of k-means.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Clusterings of every k-means to choose from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub starts: Option<usize>,
}

/// A number of terms, or a word.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number, \"auto\" or \"all\"")]
pub enum NarxTerms {
    /// As many.
    Number(usize),
    /// `auto` or `all`.
    Word(String),
}

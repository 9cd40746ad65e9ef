//! Criteria that choose lambda or the number of terms.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Rule that chooses lambda or the number of terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// Sparsest model within one standard error of the least cross-validated error.
    #[default]
    #[serde(rename = "one-se")]
    #[value(name = "one-se")]
    OneStandardError,
    /// Least cross-validated error.
    #[serde(rename = "cv")]
    #[value(name = "cv")]
    CrossValidation,
    /// Akaike's information criterion.
    Aic,
    /// Bayesian information criterion of the effective rows.
    Bic,
    /// Extended Bayesian criterion (Chen and Chen 2008).
    Ebic,
}

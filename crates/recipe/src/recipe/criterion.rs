//! Criteria that choose lambda or the number of terms.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Rule that chooses lambda or the number of terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// The sparsest model whose cross-validated error is within one standard error of the least.
    #[default]
    #[serde(rename = "one-se")]
    #[value(name = "one-se")]
    OneStandardError,
    /// The least cross-validated error.
    #[serde(rename = "cv")]
    #[value(name = "cv")]
    CrossValidation,
    /// Akaike's information criterion.
    Aic,
    /// The Bayesian information criterion, with the effective number of rows.
    Bic,
    /// The extended Bayesian information criterion (Chen and Chen 2008).
    Ebic,
}

//! The report of a structured sparse fit.

use serde::{Serialize, Serializer};

use crate::{
    method::FitReport,
    sparse::{LambdaChoice, SparseReport},
    summary::FitSummary,
};

impl FitReport for SparseReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }
}

impl Serialize for LambdaChoice {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Chosen<'a> {
            value: f64,
            how: &'a str,
            largest: f64,
            validation: Option<Validation<'a>>,
        }
        #[derive(Serialize)]
        struct Validation<'a> {
            folds: usize,
            fold_rule: Option<&'a str>,
            lambdas: &'a [f64],
            error: &'a [f64],
            standard_error: &'a [f64],
            features: &'a [f64],
        }
        let validation = self.validation.as_ref().map(|validation| Validation {
            folds: self.folds,
            fold_rule: self.fold_rule.as_deref(),
            lambdas: &validation.lambdas,
            error: &validation.mean,
            standard_error: &validation.standard_error,
            features: &validation.features,
        });
        Chosen { value: self.value, how: &self.how, largest: self.largest, validation }.serialize(serializer)
    }
}

//! The report of a structured sparse fit.

use fleetfoot_sparse::Certificate;
use serde::{Serialize, Serializer};
use serde_json::Value;

use super::report;
use crate::{LambdaChoice, SparseReport};

impl SparseReport {
    /// Tasks, latents, lambda and certificates for programs.
    pub fn to_json(&self) -> Value {
        report(self)
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
        let validation = self.validation.as_ref().map(|found| Validation {
            folds: self.folds,
            fold_rule: self.fold_rule.as_deref(),
            lambdas: &found.lambdas,
            error: &found.mean,
            standard_error: &found.standard_error,
            features: &found.features,
        });
        Chosen { value: self.value, how: &self.how, largest: self.largest, validation }.serialize(serializer)
    }
}

pub(crate) fn certificate<S: Serializer>(certificate: &Certificate, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Told {
        kkt: f64,
        gap: f64,
        objective: f64,
    }
    Told { kkt: certificate.kkt, gap: certificate.gap, objective: certificate.objective }.serialize(serializer)
}

/// The coefficient that changes most, and its change.
pub(crate) fn largest_change<S: Serializer>(change: &Option<(String, f64)>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Told<'a> {
        coefficient: &'a str,
        standard_errors: f64,
    }
    let told = change.as_ref().map(|(coefficient, errors)| Told { coefficient, standard_errors: *errors });
    told.serialize(serializer)
}

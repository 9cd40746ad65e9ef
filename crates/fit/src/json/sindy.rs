//! The report of a fit of equations.

use serde::Serialize;
use serde_json::Value;

use super::report;
use crate::{
    method::FitReport,
    serialize::{Along, functions},
    sindy::{EquationReport, SindyReport},
    summary::FitSummary,
};

impl FitReport for SindyReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }

    fn to_json(&self) -> Value {
        let paths = self
            .regions
            .iter()
            .flat_map(|region| region.equations.iter().map(|equation| EquationPath::new(&region.name, equation)));
        report(Told { found: self, path: paths.collect() })
    }
}

#[derive(Serialize)]
struct Told<'a> {
    #[serde(flatten)]
    found: &'a SindyReport,
    path: Vec<EquationPath<'a>>,
}

/// What the functions of an equation contribute to its models of so many terms.
#[derive(Serialize)]
struct EquationPath<'a> {
    name: &'a str,
    label: &'a str,
    entered: usize,
    terms: Vec<usize>,
    functions: Vec<Along<'a>>,
}

impl<'a> EquationPath<'a> {
    fn new(region: &'a str, equation: &'a EquationReport) -> Self {
        Self {
            name: region,
            label: &equation.label,
            entered: equation.entered,
            terms: equation.front.iter().map(|point| point.terms).collect(),
            functions: functions(&equation.along),
        }
    }
}

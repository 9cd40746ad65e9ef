//! The report of a fit of equations.

use serde::{Serialize, Serializer};

use crate::{
    method::FitReport,
    serialize::{Along, functions},
    sindy::{EquationReport, RegionReport, SindyReport},
    summary::FitSummary,
};

impl FitReport for SindyReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }
}

/// Regions, and beside them the paths of all their equations.
pub(crate) fn with_paths<S: Serializer>(regions: &[RegionReport], serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Content<'a> {
        regions: &'a [RegionReport],
        path: Vec<EquationPath<'a>>,
    }
    let equations =
        regions.iter().flat_map(|region| region.equations.iter().map(move |equation| (&region.name, equation)));
    let path = equations.map(|(region, equation)| EquationPath::new(region, equation)).collect();
    Content { regions, path }.serialize(serializer)
}

/// Contributions of the functions of an equation to its models, by number of terms.
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

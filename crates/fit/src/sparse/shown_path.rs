//! The regularisation path beyond the choice, as in a report: the order in which columns enter, and those that a
//! smaller lambda would add.

use fleetfoot_sparse::{Path, Solution, estimator::Stop};
use serde::Serialize;

use super::problem::Problem;
use crate::{error::Error, serialize};

/// The path ends at this share of the chosen lambda, or when so many more columns are in than were chosen.
const BEYOND: f64 = 0.1;
const MORE: usize = 40;
/// Functions and knots that are listed: those with the largest coefficients along the path.
const FUNCTIONS: usize = 24;
const KNOTS: usize = 120;

/// Coefficients along a regularisation path.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PathReport {
    /// Lambdas, falling: the knots of a path that is linear between them, else those at which it was solved; of very many, evenly spread ones.
    pub lambdas: Vec<f64>,
    /// The functions with the largest coefficients, by name, and their coefficients at every lambda, in the units in which the penalty compares them.
    #[serde(serialize_with = "serialize::along")]
    pub functions: Vec<(String, Vec<f64>)>,
    /// Functions that are in somewhere along the path.
    pub entered: usize,
}

impl PathReport {
    /// The path of all rows, down to a tenth of the chosen lambda; `None` if there is no penalty or nothing enters.
    pub(super) fn of(problem: &Problem<'_>, lambda: f64, chosen: usize) -> Result<Option<Self>, Error> {
        if lambda <= 0.0 {
            return Ok(None);
        }
        let assembled = &problem.assembled;
        let stop = Stop { lambda: BEYOND * lambda, max_features: Some(chosen + MORE) };
        let path = problem.estimator.path(&assembled.problem, &assembled.penalty, &stop)?;
        let mut largest = vec![0.0_f64; assembled.scale.len()];
        for (&column, &value) in path.knots.iter().flat_map(|knot| knot.support.iter().zip(&knot.coefficients)) {
            largest[column] = largest[column].max(value.abs());
        }
        let mut columns: Vec<usize> = (0..largest.len()).filter(|&column| largest[column] > 0.0).collect();
        let entered = columns.len();
        columns.sort_by(|&a, &b| largest[b].total_cmp(&largest[a]).then(a.cmp(&b)));
        columns.truncate(FUNCTIONS);
        let knots = shown_knots(&path);
        let along = |column: usize| knots.iter().map(|knot| coefficient(knot, column)).collect();
        let functions = columns.iter().map(|&column| (problem.name(column), along(column))).collect();
        let lambdas = knots.iter().map(|knot| knot.l1).collect();
        Ok((entered > 0).then_some(Self { lambdas, functions, entered }))
    }
}

/// The listed knots, the first and the last among them.
fn shown_knots(path: &Path) -> Vec<&Solution> {
    let all = path.knots.len();
    let shown = all.min(KNOTS);
    (0..shown).map(|place| &path.knots[place * (all - 1) / (shown - 1).max(1)]).collect()
}

fn coefficient(knot: &Solution, column: usize) -> f64 {
    knot.support.binary_search(&column).map_or(0.0, |place| knot.coefficients[place])
}

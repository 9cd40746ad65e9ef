//! Fits that keep limits at every row of the data. Examples are drag that is never negative (the failure of the paper's
//! section 9.3), a friction that only takes power, and an inertia matrix that is positive definite.
//!
//! A million rows are a million inequalities, of which a few matter. So constraints are generated: solve, pass over the rows once for the worst
//! violations, add these, and again (the cutting-plane method of Kelley 1960), until a pass finds none. A matrix M with an eigenvector v below its bound is cut off by
//! `v'M v >= bound`, which is linear in the coefficients and holds for every matrix that keeps the bound.

use std::collections::HashSet;

use fleetfoot_data::{Column, MemorySource, Progress, Silent, Source};

use super::{
    Constrained, ConstrainedError, ConstrainedOptions, Constraints, LinearConstraint, RowLimit, constrained,
    survey::{Breach, Found, Survey},
};
use crate::{Strength, structured::Assembled};
use fleetfoot_sums::structured::Regression;

/// A structured regression with limits.
#[derive(Debug, Clone, Copy)]
pub struct LimitedRegression<'a> {
    /// The regression: names and functions of the latents.
    pub regression: &'a Regression,
    /// Its assembled problem.
    pub assembled: &'a Assembled,
    /// Constraints on the coefficients.
    pub constraints: &'a Constraints,
    /// Limits to keep at every row.
    pub limits: &'a [RowLimit],
    /// Strengths of the penalty.
    pub strength: Strength,
    /// Coefficients that may differ from 0 (`None`: all).
    pub support: Option<&'a [usize]>,
}

/// Options for imposing limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitOptions {
    /// Options of the solver for each problem.
    pub solve: ConstrainedOptions,
    /// Margin beyond the bound at the rows that became constraints, as a share of the largest value without limits. It
    /// lets all other rows keep the bound itself, exactly.
    pub margin: f64,
    /// Rows that become constraints after a pass, at most, for every limit.
    pub rows_per_pass: usize,
    /// Passes over the data, at most.
    pub max_passes: usize,
}

impl Default for LimitOptions {
    fn default() -> Self {
        Self { solve: ConstrainedOptions::default(), margin: 1e-6, rows_per_pass: 64, max_passes: 50 }
    }
}

/// Distance of a form from its bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Clearance {
    /// Least distance over all rows, in the form's units; negative where the bound is broken.
    pub least: f64,
    /// Place of that distance: episode (by name) and row; `None` if it is the same everywhere, or there are no rows.
    pub place: Option<(String, usize)>,
    /// Largest absolute value over all rows, of a matrix of an entry.
    pub size: f64,
}

/// A fit with limits.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LimitedFit {
    /// The minimiser.
    pub fit: Constrained,
    /// For every limit, the distance from the bound that the last pass found.
    pub clearance: Vec<Clearance>,
    /// True if every row of the last pass kept every limit.
    pub kept: bool,
    /// Passes over the data.
    pub passes: usize,
    /// The constraints that the limits became at some rows.
    pub cuts: Vec<LinearConstraint>,
    /// Number of cuts of every limit.
    pub cuts_of: Vec<usize>,
}

/// Fits with the limits kept at every row of the source at which what they speak of is a finite number.
///
/// When [`LimitedFit::kept`] is true, the last pass found `form >= bound` (or `<=`) at all of these rows, without a tolerance, in the arithmetic of
/// [`fleetfoot_library::Program`] and a sum over the functions in their order, of a matrix in that of its eigenvalues; the objective is at most that of bounds
/// tightened by twice the margin. Needs as many passes as there are rounds of new constraints, usually less than ten, and memory for these rows only. Limits that
/// say the same at every row need neither: `source` may be absent if all do.
///
/// # Errors
/// As [`constrained`]; when a latent or a column does not exist, a limit needs rows and there are none, the source cannot be read, or the user stops it.
pub fn fit_within_limits(
    problem: &LimitedRegression<'_>,
    source: Option<&dyn Source>,
    options: &LimitOptions,
    progress: &dyn Progress,
) -> Result<LimitedFit, ConstrainedError> {
    let LimitedRegression { regression, assembled, limits, strength, support, .. } = *problem;
    limits.iter().try_for_each(|limit| limit.check(regression))?;
    let row = one_row();
    let surveys = Surveys::new(regression, limits, source, &row)?;
    let mut constraints = problem.constraints.clone();
    let before = constraints.inequalities.len();
    let mut known = HashSet::new();
    let mut sizes: Option<Vec<f64>> = None;
    let mut passes = 0;
    let mut cuts_of = vec![0; limits.len()];
    loop {
        let fit = constrained(assembled, &constraints, strength, support, &options.solve)?;
        progress.stage("rows that break a limit");
        let found = surveys.pass(&fit.theta, options.rows_per_pass, progress)?;
        passes += 1;
        let sizes = sizes.get_or_insert_with(|| found.iter().map(|found| found.size).collect());
        let kept = found.iter().all(|found| found.least >= 0.0);
        let (last, solved_with) = (constraints.inequalities.len(), cuts_of.clone());
        for (at, found) in found.iter().enumerate() {
            // A matrix may break its bound again at the same row, in another direction.
            let again = limits[at].forms.len() > 1;
            let new = found.breaches.iter().filter(|breach| known.insert((at, breach.episode, breach.row)) || again);
            let own = constraints.inequalities.len();
            constraints
                .inequalities
                .extend(new.map(|breach| surveys.constraint(at, breach, options.margin * sizes[at])));
            cuts_of[at] += constraints.inequalities.len() - own;
        }
        if kept || constraints.inequalities.len() == last || passes >= options.max_passes {
            let clearance = found.iter().enumerate().map(|(at, found)| surveys.clearance(at, found)).collect();
            let cuts = constraints.inequalities.drain(..last).skip(before).collect();
            return Ok(LimitedFit { fit, clearance, kept, passes, cuts, cuts_of: solved_with });
        }
    }
}

/// Limits that say the same everywhere are looked at in one row, the others in those of the source.
struct Surveys<'a> {
    everywhere: Survey<'a>,
    rows: Option<(Survey<'a>, &'a dyn Source)>,
    /// Of every limit, whether it is among those of the rows, and its place there.
    places: Vec<(bool, usize)>,
}

/// The row in which limits that say the same everywhere are looked at.
fn one_row() -> MemorySource {
    let mut row = MemorySource::new(vec![Column::float("row")]);
    row.push_uniform("everywhere", 1.0, vec![vec![0.0]]);
    row
}

impl<'a> Surveys<'a> {
    fn new(
        regression: &'a Regression,
        limits: &'a [RowLimit],
        source: Option<&'a dyn Source>,
        row: &'a MemorySource,
    ) -> Result<Self, ConstrainedError> {
        let (mut everywhere, mut varying) = (Vec::new(), Vec::new());
        let mut places = Vec::with_capacity(limits.len());
        for limit in limits {
            let constant = limit.is_constant(regression);
            let of = if constant { &mut everywhere } else { &mut varying };
            places.push((!constant, of.len()));
            of.push(limit);
        }
        let rows = match (varying.first(), source) {
            (None, _) => None,
            (Some(limit), None) => return Err(ConstrainedError::NeedsRows { name: limit.name.clone() }),
            (Some(_), Some(source)) => Some((Survey::new(regression, varying, source)?, source)),
        };
        Ok(Self { everywhere: Survey::new(regression, everywhere, row)?, rows, places })
    }

    fn pass(&self, theta: &[f64], keep: usize, progress: &dyn Progress) -> Result<Vec<Found>, ConstrainedError> {
        // One row is not progress.
        let everywhere = self.everywhere.pass(theta, keep, &Silent)?;
        let rows = self.rows.as_ref().map(|(survey, _)| survey.pass(theta, keep, progress)).transpose()?;
        let rows = rows.unwrap_or_default();
        Ok(self.places.iter().map(|&(varies, at)| if varies { &rows[at] } else { &everywhere[at] }.clone()).collect())
    }

    fn constraint(&self, at: usize, breach: &Breach, margin: f64) -> LinearConstraint {
        match (self.places[at], &self.rows) {
            ((true, at), Some((survey, _))) => survey.constraint(at, breach, margin),
            ((_, at), _) => self.everywhere.constraint(at, breach, margin),
        }
    }

    fn clearance(&self, at: usize, found: &Found) -> Clearance {
        let source = self.rows.as_ref().map(|(_, source)| source).filter(|_| self.places[at].0);
        let place = source.zip(found.place);
        let place = place.map(|(source, (episode, row))| (source.episodes()[episode].name.clone(), row));
        Clearance { least: found.least, place, size: found.size }
    }
}

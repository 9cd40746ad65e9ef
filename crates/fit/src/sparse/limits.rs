//! Fits that keep the limits of a recipe at every row.

use fleetfoot_data::setting::LAMBDA;
use fleetfoot_data::{Progress, Silent, Source};
use fleetfoot_sparse::{
    Penalty, Strength,
    constrained::{
        Clearance, ConstrainedError, ConstrainedStatus, Constraints, LimitOptions, LimitedFit, LimitedRegression,
        LinearConstraint, RowLimit, fit_within_limits,
    },
    structured::{Assembled, assemble},
};
use fleetfoot_stats::SquareRoot;
use fleetfoot_task::{CoefficientLimit, bounds};

use super::problem::Problem;
use crate::{
    error::Error,
    limit_report::{LimitReport, LimitSide},
};

/// Distance from a bound, relative to it or to 1, below which a coefficient is held by it: the tolerance of the program.
const AT_BOUND: f64 = 1e-8;

/// Least squares on a support within the limits of the recipe.
pub(super) struct Limited<'a> {
    problem: &'a Problem<'a>,
    support: &'a [usize],
    solution: LimitedFit,
}

/// The least-squares fit on the support with the limits of the recipe; `None` where it has none.
pub(super) fn within_limits<'a>(
    problem: &'a Problem<'a>,
    support: &'a [usize],
    source: Option<&dyn Source>,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Option<Limited<'a>>, Error> {
    let limits = &problem.task.limits;
    if limits.is_empty() && problem.task.coefficients.is_empty() {
        return Ok(None);
    }
    if let (Some(limit), None) = (limits.iter().find(|limit| varies(problem, limit)), source) {
        return Err(Error::needs_rows(format!(
            "{}: a bound at every row needs the rows, which a statistic lacks; give the logs instead, or remove at_least and at_most",
            limit.name
        )));
    }
    let of = |support| solve(problem, &problem.assembled, support, limits, Vec::new(), source, progress);
    let limited = match of(support) {
        Err(Error::Constrained(ConstrainedError::Infeasible { constraints })) => {
            // Of all columns, the constraints may contradict each other by themselves.
            of(&(0..problem.assembled.scale.len()).collect::<Vec<usize>>())?;
            return Err(Error::undetermined(format!(
                "the selected functions cannot keep {}: a function that it needs was not selected; give its latents `penalty = 0.0`, or a smaller {LAMBDA}",
                constraints.join(", ")
            )));
        }
        other => other?,
    };
    if limited.fit.status != ConstrainedStatus::Solved {
        notes.push(format!(
            "the bounded fit did not converge: optimality conditions to {:.1e}, bounds to {:.1e}",
            limited.fit.certificate.kkt, limited.fit.certificate.violation
        ));
    }
    for (limit, clearance) in limits.iter().zip(&limited.clearance).filter(|(_, clearance)| clearance.least < 0.0) {
        notes.push(format!(
            "{} is not {} {} everywhere: {} passes left a row that breaks it by {:.3e}{}",
            limit.name,
            LimitSide::from(limit.side),
            limit.bound,
            limited.passes,
            -clearance.least,
            place(clearance)
        ));
    }
    Ok(Some(Limited { problem, support, solution: limited }))
}

fn varies(problem: &Problem<'_>, limit: &RowLimit) -> bool {
    !limit.is_constant(&problem.task.regression)
}

fn place(clearance: &Clearance) -> String {
    clearance.place.as_ref().map_or_else(String::new, |(episode, row)| format!(" ({episode}, row {})", row + 1))
}

/// Nothing is penalised.
fn solve(
    problem: &Problem<'_>,
    assembled: &Assembled,
    support: &[usize],
    limits: &[RowLimit],
    inequalities: Vec<LinearConstraint>,
    source: Option<&dyn Source>,
    progress: &dyn Progress,
) -> Result<LimitedFit, Error> {
    let p = assembled.scale.len();
    let mut assembled = assembled.clone();
    assembled.penalty = Penalty { factors: vec![0.0; p], ..assembled.penalty };
    let coefficients = &problem.task.coefficients;
    let column = |limit: &CoefficientLimit| problem.task.regression.first(limit.owner) + limit.candidate;
    let constraints = Constraints {
        bounds: if coefficients.is_empty() { Vec::new() } else { bounds(p, coefficients.iter(), column) },
        names: (0..p).map(|coefficient| problem.name(coefficient)).collect(),
        inequalities,
        ..Constraints::default()
    };
    let request = LimitedRegression {
        regression: &problem.task.regression,
        assembled: &assembled,
        constraints: &constraints,
        limits,
        strength: Strength::lasso(0.0),
        support: Some(support),
    };
    Ok(fit_within_limits(&request, source, &LimitOptions::default(), progress)?)
}

impl Limited<'_> {
    /// Coefficients (p).
    pub(super) fn coefficients(&self) -> Vec<f64> {
        self.solution.fit.theta.clone()
    }

    /// The coefficients of other rows, without a pass. Limits are kept at the rows that became constraints here; those
    /// that are the same at every row, anew.
    pub(super) fn refit(&self, roots: &[SquareRoot]) -> Result<Vec<f64>, Error> {
        let Self { problem, support, solution: before } = self;
        let assembled = assemble(&problem.structure, roots, &problem.assembly)?;
        let everywhere: Vec<RowLimit> =
            problem.task.limits.iter().filter(|limit| !varies(problem, limit)).cloned().collect();
        let again = solve(problem, &assembled, support, &everywhere, before.cuts.clone(), None, &Silent)?;
        Ok(again.fit.theta)
    }

    /// The kept bounds, and the distance to each.
    pub(super) fn report(&self) -> Vec<LimitReport> {
        let of = |(at, (limit, clearance)): (usize, (&RowLimit, &Clearance))| LimitReport {
            name: limit.name.clone(),
            side: limit.side.into(),
            bound: limit.bound.as_number().unwrap_or(f64::NAN),
            nearest: clearance.least,
            episode: clearance.place.as_ref().map(|(episode, _)| episode.clone()),
            row: clearance.place.as_ref().map(|(_, row)| *row),
            free_nearest: None,
            cuts: self.solution.cuts_of[at],
        };
        let rows = self.problem.task.limits.iter().zip(&self.solution.clearance).enumerate().map(of);
        let task = &self.problem.task;
        let coefficient = |limit: &CoefficientLimit| {
            let j = task.regression.first(limit.owner) + limit.candidate;
            let value = self.solution.fit.theta[j];
            let held =
                self.support.contains(&j) && limit.clearance(value).abs() <= AT_BOUND * limit.bound.abs().max(1.0);
            LimitReport::of_coefficient(limit, &[value], None, usize::from(held))
        };
        rows.chain(task.coefficients.iter().map(coefficient)).collect()
    }
}

//! Latents that keep a bound at every row of the data.

use fleetfoot_data::{Progress, Source};
use fleetfoot_library::Expr;
use fleetfoot_sparse::{
    Penalty, Strength,
    constrained::{
        ConstrainedLatent, ConstrainedStatus, Constraints, LatentLimit, LatentOptions, Limit, constrain_latent,
    },
};

use super::problem::Problem;
use crate::Error;

/// The least-squares fit on the support with the limits of the recipe; `None` where it has none.
pub(super) fn within_limits(
    problem: &Problem<'_>,
    support: &[usize],
    source: Option<&dyn Source>,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Option<Vec<f64>>, Error> {
    let regression = &problem.task.regression;
    let mut limits = Vec::new();
    for (latent, bounds) in problem.task.bounds.iter().enumerate() {
        for (side, bound) in [(Limit::AtLeast, bounds[0]), (Limit::AtMost, bounds[1])] {
            if bound.is_finite() {
                limits.push(LatentLimit { latent, side, bound: Expr::number(bound) });
            }
        }
    }
    let Some(first) = limits.first() else { return Ok(None) };
    let Some(source) = source else {
        return Err(Error::needs_rows(format!(
            "[latents] {}: a bound at every row needs the rows, which a statistic has not; give the logs instead, or leave at_least and at_most away",
            regression.latents[first.latent].name
        )));
    };
    // Least squares on the support: nothing is penalised.
    let mut assembled = problem.assembled.clone();
    assembled.penalty = Penalty { factors: vec![0.0; assembled.scale.len()], ..assembled.penalty };
    let constraints = Constraints {
        names: (0..assembled.scale.len()).map(|coefficient| problem.name(coefficient)).collect(),
        ..Constraints::default()
    };
    let request = ConstrainedLatent {
        regression,
        assembled: &assembled,
        constraints: &constraints,
        limits: &limits,
        strength: Strength::lasso(0.0),
        support: Some(support),
    };
    let found = constrain_latent(&request, source, &LatentOptions::default(), progress)?;
    for (limit, clearance) in limits.iter().zip(&found.clearance) {
        let name = &regression.latents[limit.latent].name;
        let side = if limit.side == Limit::AtLeast { "at least" } else { "at most" };
        let place =
            clearance.place.as_ref().map_or_else(String::new, |(episode, row)| format!(" ({episode}, row {row})"));
        notes.push(if clearance.least >= 0.0 {
            format!("{name} is {side} {} at every row; nearest by {:.3e}{place}", limit.bound, clearance.least)
        } else {
            format!(
                "{name} is not {side} {} everywhere: {} passes left a row that breaks it by {:.3e}{place}",
                limit.bound, found.passes, -clearance.least
            )
        });
    }
    if found.fit.status != ConstrainedStatus::Solved {
        notes.push(format!(
            "the bounded fit did not converge: optimality conditions to {:.1e}, bounds to {:.1e}",
            found.fit.certificate.kkt, found.fit.certificate.violation
        ));
    }
    Ok(Some(found.fit.theta))
}

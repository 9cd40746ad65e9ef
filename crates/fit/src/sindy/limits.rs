//! Bounds of coefficients, and their cost.

use fleetfoot_data::Progress;
use fleetfoot_data::setting::{CONSTRAINTS, PARAMETERS};
use fleetfoot_task::EquationTask;

use super::{
    SindyReport,
    solve::{Solved, Solver},
};
use crate::{
    error::Error,
    limit_report::{FreeErrors, LimitReport},
    sindy::Evidence,
};

/// The equations of every region without the bounds, found by the same rule on the same folds; `None` where there are no bounds.
pub(super) fn free(
    evidence: &Evidence,
    solver: Solver<'_>,
    progress: &dyn Progress,
) -> Result<Option<Vec<Vec<Solved>>>, Error> {
    if evidence.task.limits.is_empty() {
        return Ok(None);
    }
    let free = solver.free();
    // Their notes would repeat those of the bounded equations.
    let regions = 0..evidence.scan.regions();
    regions.map(|region| free.solve(region, &mut Vec::new(), progress)).collect::<Result<_, _>>().map(Some)
}

/// Reports the errors without the bounds, and the distances of coefficients to them.
pub(super) fn tell(evidence: &Evidence, regions: &[Vec<Solved>], free: &[Vec<Solved>], report: &mut SindyReport) {
    for (region, (bounded, free)) in report.regions.iter_mut().zip(free).enumerate() {
        let weight = evidence.scan.root(region).weight;
        for (equation, free) in bounded.equations.iter_mut().zip(free) {
            let rms = (free.step.rss / weight).sqrt();
            equation.free = Some(FreeErrors { rms, held_out: free.held_out[0].sqrt() });
        }
    }
    for limit in &evidence.task.limits {
        let value = |of: &[Vec<Solved>], region: usize| of[region][limit.owner].step.coefficients[limit.candidate];
        let broken = |region: &usize| {
            limit.clearance(value(free, *region)) < 0.0
                || regions[*region][limit.owner].step.support.contains(&limit.candidate)
                    && limit.clearance(value(regions, *region)) == 0.0
        };
        let held = (0..regions.len()).filter(broken).count();
        let [bounded, free] =
            [regions, free].map(|of| (0..regions.len()).map(|at| value(of, at)).collect::<Vec<f64>>());
        report.limits.push(LimitReport::of_coefficient(limit, &bounded, Some(&free), held));
    }
    if !evidence.parameters.is_empty() {
        report
            .summary
            .notes
            .push(format!("numbers inside expressions ({PARAMETERS}) were estimated without {CONSTRAINTS}"));
    }
}

/// The terms of an equation that no bound holds.
pub(super) fn loose(task: &EquationTask, target: usize, solved: &Solved) -> Vec<usize> {
    let held = |j: usize| {
        let limits = task.limits.iter().filter(|limit| limit.owner == target && limit.candidate == j);
        limits.map(|limit| limit.clearance(solved.step.coefficients[j])).any(|clearance| clearance == 0.0)
    };
    solved.step.support.iter().copied().filter(|&j| !held(j)).collect()
}

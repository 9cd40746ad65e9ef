//! Plans of the statistic, for partitions that are made on all rows.

use fleetfoot_data::Source;
use fleetfoot_library::Expr;
use fleetfoot_model::{Role, Rule};
use fleetfoot_stats::{FINE, Grid, Preconditioner};
use fleetfoot_sums::system::{System, SystemPlan};

use crate::{
    Error, Options, Problem,
    budget::{STATS_BUDGET, gram_bytes},
    segmentation::{Candidate, Segmentation},
};

/// The system whose sums answer for a problem in one region: library, targets, the moments of targets and states, the weight.
pub fn system(problem: &Problem) -> System {
    let targets: Vec<Expr> = problem.equations.iter().filter_map(|equation| equation.target.clone()).collect();
    let states = problem.columns.iter().filter(|column| column.role == Role::State);
    let states = states.map(|column| Expr::column(column.name.as_str()));
    System {
        also: targets.iter().cloned().chain(states).collect(),
        weight: problem.weight.clone(),
        ..System::new(problem.library.clone(), targets)
    }
}

/// A plan for every partition that is made on all rows, the first of which is the one region. `None` for those that are
/// joined of cells, or belong to a fold.
///
/// The chunks are those of a statistic of the same rows, as long as the sums of all partitions fit the memory together.
pub(crate) fn plans(
    problem: &Problem,
    segmentation: &Segmentation,
    preconditioner: &Preconditioner,
    source: &dyn Source,
) -> Result<Vec<Option<SystemPlan>>, Error> {
    let system = system(problem);
    let made_on_all = |at: usize| at == 0 || segmentation.candidates.iter().any(|candidate| candidate.full == at);
    let partitions = segmentation.partitions.iter().enumerate();
    let systems: Vec<Option<System>> = partitions
        .map(|(at, partition)| {
            let summed = made_on_all(at) && !matches!(partition.rule, Rule::Joined { .. });
            summed.then(|| System { partition: (at > 0).then(|| partition.clone()), ..system.clone() })
        })
        .collect();
    let regions = systems.iter().flatten().map(System::regions).sum();
    let bytes = gram_bytes(preconditioner.dimension());
    let shortest = Grid::for_budget(source.rows(), regions, bytes, STATS_BUDGET, FINE);
    let of = |system: System| match SystemPlan::of_moments(&system, None, source)? {
        // Of one region.
        Some(plan) => Ok(plan),
        None => SystemPlan::in_coordinates(system, None, source, preconditioner.clone()),
    };
    let of = |system: Option<System>| {
        let plan = system.map(of);
        let longer = |mut plan: SystemPlan| {
            plan.chunk_rows = plan.chunk_rows.max(shortest);
            plan
        };
        plan.map(|plan| plan.map(longer)).transpose().map_err(Error::from)
    };
    systems.into_iter().map(of).collect()
}

/// Partitions of which the chunks of the folds are summed: the one region, those of folds, and those whose residuals
/// need sums by chunk.
pub(crate) fn cut(segmentation: &Segmentation, plans: &[Option<SystemPlan>], options: &Options) -> Vec<bool> {
    let of = |at: usize| {
        let fold = |candidate: &Candidate| candidate.by_fold.contains(&at);
        let counted = |candidate: &Candidate| {
            candidate.full == at && (options.phase.is_some() || candidate.specification.fits_targets())
        };
        at == 0 || plans[at].is_none() || segmentation.candidates.iter().any(|one| fold(one) || counted(one))
    };
    (0..segmentation.partitions.len()).map(of).collect()
}

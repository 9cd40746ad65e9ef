//! Memory of an identification.

use crate::{
    Options, Problem, Specification,
    budget::{STATS_BUDGET, expected_regions, gram_bytes},
    lattice::bytes as cell_bytes,
    survey::{example_bytes, examples, kept_bytes},
};

/// Passes of an identification: where regions are, the sums in them, and the errors.
const PASSES: usize = 3;

/// Memory of an identification, and its passes over the rows.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Cost {
    /// Rows that are kept to find regions: all, or as many as the memory allows.
    pub clustered_rows: usize,
    /// Passes over the rows: one more if all rows draw the borders of regions that are refined on a sample, and one
    /// more for weights.
    pub passes: usize,
    /// Bytes, about: kept rows, stored statistics, blocks in flight.
    pub bytes: usize,
    /// Multiplications of the models of all regions and folds, about; finding regions that fit the dynamics comes beside them.
    pub operations: f64,
}

/// Memory of [`identify`](crate::identify()) for `rows` rows.
pub fn cost(problem: &Problem, options: &Options, rows: usize) -> Cost {
    let targets = problem.equations.iter().filter(|equation| equation.target.is_some()).count();
    let width = problem.library.len() + targets;
    let per_row = kept_bytes(problem.partition_columns.len(), 0);
    let any = |wanted: fn(&Specification) -> bool| options.partitions.iter().any(wanted);
    let clustered = if any(Specification::is_clustered) { rows.min(options.memory / per_row.max(1)) } else { 0 };
    let per_example = example_bytes(problem.partition_columns.len(), width);
    let refined = if any(Specification::fits_targets) || options.continuous {
        examples(rows, per_example, options.memory)
    } else {
        0
    };
    let shape = (problem.library.len(), targets);
    let joined = options.partitions.iter().filter_map(Specification::joined).max();
    let cells = joined.map_or(0, |regions| cell_bytes(rows, shape, regions, options.folds));
    let regions: usize =
        options.partitions.iter().map(expected_regions).sum::<usize>() * (1 + usize::from(options.folds)) + 1;
    // By chunks of the folds, and twice by those of the statistic.
    let of_regions = |regions: usize| (rows.div_ceil(256) * regions * gram_bytes(width)).min(STATS_BUDGET);
    let made_on_all = options.partitions.iter().map(expected_regions).sum::<usize>() + 1;
    let statistics = of_regions(regions) + 2 * of_regions(made_on_all);
    let blocks = 2 * fleetfoot_data::thread_count() * 65_536 * 8 * (problem.columns.len() + 1);
    let drawn = any(|one| matches!(one, Specification::Refined(_))) && !options.continuous && refined < rows;
    let models = options.partitions.iter().map(|one| expected_regions(one).max(1)).sum::<usize>();
    let models = models * usize::from(options.folds.max(1)) * if options.folds > 1 { 2 } else { 1 };
    Cost {
        operations: models as f64 * (problem.library.len() as f64 + 1.0).powi(3),
        passes: PASSES + usize::from(drawn) + usize::from(problem.weight.is_some()),
        clustered_rows: clustered.max(refined),
        bytes: clustered * per_row + refined * per_example + statistics + cells + blocks,
    }
}

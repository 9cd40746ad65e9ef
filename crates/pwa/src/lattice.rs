//! Many small cells, and the regions that they are joined to.
//!
//! One pass over the rows keeps a Gram matrix for every cell and place in cross-validation ([`CellSums`]). From these alone follow, for all rows and for the
//! training rows of every fold, a tree of joins ([`Tree`]), and with it every number of regions: its maps, its training error and its error on the rows that
//! were held out. Cells are those of k-means on the partition columns of a sample of all rows: they are the same for every fold, see no target, and are so many
//! that where they lie says nothing of one row; what is joined follows from training rows alone.

mod cells;
mod sums;
mod tree;

use std::sync::Arc;

use fleetfoot_data::{Progress, Silent, parallel_map};
use fleetfoot_model::{Join, Level, Partition, Rule};
use fleetfoot_stats::{Gram, Preconditioner};

use crate::{
    Error,
    identify::{STATS_BUDGET, gram_bytes},
    select::Order,
};

pub(crate) use cells::{Cells, Columns, centroids, count as cell_count};
pub(crate) use sums::{CellPart, CellSums, Sets, joined};
pub(crate) use tree::{Cell, Limits, Tree};

/// Cells at most (but two for each region).
const CELLS: usize = 1024;
/// Rows of a cell that its place is found from, on average.
const PLACED: usize = 32;
/// Rows of a part of these.
const PART: usize = 2048;
/// Regions from which on joins are not limited to neighbours.
const APART: usize = 128;

/// Cells, before rows are summed in them.
pub(crate) struct Lattice {
    /// Cuts rows into the cells.
    pub(crate) partition: Partition,
    /// The same rule as all that is joined of the cells shares it.
    pub(crate) rule: Arc<Rule>,
    cells: Cells,
    regressors: usize,
    /// Whether there would be more cells with more memory.
    cut: bool,
}

/// Cells that a budget of memory has room for: Gram matrices of so many columns for every place in cross-validation, and joined for every fold.
fn most_cells(width: usize, folds: u16) -> usize {
    STATS_BUDGET / (grams_of_a_cell(folds) * gram_bytes(width))
}

/// A fold has rows beside the spans before and behind it, and each fold's training and held-out rows are summed.
fn grams_of_a_cell(folds: u16) -> usize {
    5 * usize::from(folds) + 3
}

/// Bytes of the sums of the cells of so many regions; `shape` is the number of regressors and of targets.
pub(crate) fn bytes(rows: usize, shape: (usize, usize), regions: usize, folds: u16) -> usize {
    wanted(rows, shape, regions, folds) * grams_of_a_cell(folds) * gram_bytes(shape.0 + shape.1)
}

/// How many cells are made for so many regions.
fn wanted(rows: usize, (regressors, targets): (usize, usize), regions: usize, folds: u16) -> usize {
    cell_count(rows, regressors, regions, CELLS).min(most_cells(regressors + targets, folds)).max(1)
}

impl Lattice {
    /// Cells for so many regions of `rows` rows, from the raw partition columns of some of them; `shape` is the number of regressors and of targets, and
    /// `partition` standardises.
    ///
    /// # Errors
    /// Cancelled; columns that cannot be clustered.
    pub(crate) fn new(
        (rows, columns): (usize, &[Vec<f64>]),
        shape: (usize, usize),
        (regions, folds): (usize, u16),
        partition: Partition,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let kept = columns.first().map_or(0, Vec::len);
        let count = wanted(rows, shape, regions, folds).min(kept);
        let cut = count < cell_count(rows, shape.0, regions, CELLS).min(kept);
        let every = (kept / (PLACED * count.max(1))).max(1);
        let units = partition.centre.iter().zip(&partition.scale);
        let standard = |(column, (centre, scale)): (&Vec<f64>, (&f64, &f64))| {
            column.iter().step_by(every).map(|value| (value - centre) / scale).collect()
        };
        let columns: Vec<Vec<f64>> = columns.iter().zip(units).map(standard).collect();
        let cells = match columns.first().map_or(0, Vec::len) {
            0 => Cells::one(partition.columns.len()),
            n => {
                let part = |from: usize| columns.iter().map(|column| &column[from..(from + PART).min(n)]).collect();
                let parts: Vec<Columns<'_>> = (0..n).step_by(PART).map(part).collect();
                Cells::new(&parts, count, seed, progress)?.0
            }
        };
        let rule = Rule::voronoi(cells.centroids.clone());
        let partition = Partition { rule: rule.clone(), ..partition };
        Ok(Self { partition, rule: Arc::new(rule), cells, regressors: shape.0, cut })
    }

    /// How many cells there are.
    pub(crate) fn count(&self) -> usize {
        self.cells.centroids.len()
    }

    /// What the user should know.
    pub(crate) fn note(&self) -> Option<String> {
        let (cells, memory) = (self.count(), STATS_BUDGET >> 20);
        let told = || {
            format!(
                "lattice: regions are joined of {cells} cells; the sums of more would take over {memory} MiB, with fewer folds or columns there are more"
            )
        };
        self.cut.then(told)
    }

    /// The tree of each set of rows; `variance` is that of every target.
    ///
    /// # Errors
    /// Cancelled.
    pub(crate) fn grow(
        &self,
        sets: &Sets,
        preconditioner: &Preconditioner,
        variance: &[f64],
    ) -> Result<Vec<Tree>, Error> {
        let limits = Limits { least: 1, rows: self.regressors as u64 + 2, apart: APART };
        let error = |gram: &Gram| {
            if gram.weight <= 0.0 {
                return 0.0;
            }
            let residual = preconditioner.residual(gram);
            residual.iter().zip(variance).map(|(residual, variance)| residual / variance).sum()
        };
        let grow = |at: usize| Ok::<_, Error>(Tree::grow(self.cells.with(sets.training(at).to_vec()), limits, error));
        parallel_map(sets.count(), &Silent, grow)
    }
}

/// What a model tells of the tree that its regions are a level of: the joins that follow, and the levels that were tried; `weight` is that of the rows.
pub(crate) fn described(
    tree: &Tree,
    regions: usize,
    tried: &[&Order],
    (weight, targets): (f64, usize),
) -> fleetfoot_model::Lattice {
    let table = tree.regions(regions);
    let scaled = |error: f64| error / (weight * targets as f64);
    let join = |join: &tree::Join| Join {
        kept: table[join.kept as usize],
        gone: table[join.gone as usize],
        training: scaled(join.error),
    };
    let mut levels: Vec<Level> = tried
        .iter()
        .map(|order| Level {
            regions: order.full.len(),
            training: scaled(tree.error(order.full.len())),
            held_out: order.loss,
            standard_error: order.standard_error,
            bic: order.bic,
        })
        .collect();
    levels.sort_by_key(|level| level.regions);
    levels.dedup_by_key(|level| level.regions);
    fleetfoot_model::Lattice { joins: tree.joins(regions).iter().map(join).collect(), levels }
}

//! Many small cells, and the regions that they are joined to.
//!
//! Cells of k-means lie across the places where the dynamics change, and a thousand of them hardly find the three
//! relevant columns among sixteen. So borders come first: the separators of refined regions ([`crate::refined`], their
//! number by a criterion) on kept training rows. Within each region follow cells of k-means on the partition columns.
//! One pass over the rows keeps a Gram matrix for every cell ([`CellSums`]). From these alone follows a tree of joins
//! ([`Tree`]), and with it every number of regions: its maps, its training error and its held-out error. Borders depend
//! on targets, so that every fold has separate cells, of its training rows, and a pass sums the rows in all of them.

mod cells;
mod sums;
mod tree;

use std::sync::Arc;

use fleetfoot_data::{Progress, Silent, parallel_map};
use fleetfoot_model::{Partition, Rule};
use fleetfoot_stats::{Gram, Preconditioner};

use crate::{
    Error, Finding, PartitionNote,
    budget::{STATS_BUDGET, gram_bytes},
};

pub(crate) use cells::{Cells, Columns, centroids, count as cell_count};
pub(crate) use sums::{CellPart, CellSums, Sets, joined, joined_ranges};
pub(crate) use tree::{Cell, Limits, Tree};

/// Cells at most (but two for each region).
const CELLS: usize = 256;
/// Weight of a border between regions, relative to one between cells of a region, a standard deviation from either. It
/// moves by one over this.
const SHARP: f64 = 1e4;
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
    /// True if more memory would give more cells.
    cut: bool,
}

/// Cells that a budget of memory has room for: Gram matrices of so many columns for every fold, and joined.
fn most_cells(width: usize, folds: u16) -> usize {
    STATS_BUDGET / (grams_of_a_cell(folds) * gram_bytes(width))
}

/// All rows and each fold's training and held-out rows are summed, and the training rows copied to be joined.
fn grams_of_a_cell(folds: u16) -> usize {
    3 * usize::from(folds) + 2
}

/// Bytes of the sums of the cells of so many regions; `shape` is the number of regressors and of targets.
pub(crate) fn bytes(rows: usize, shape: (usize, usize), regions: usize, folds: u16) -> usize {
    wanted(rows, shape, regions, folds) * grams_of_a_cell(folds) * gram_bytes(shape.0 + shape.1)
}

/// Number of cells for so many regions.
fn wanted(rows: usize, (regressors, targets): (usize, usize), regions: usize, folds: u16) -> usize {
    cell_count(rows, regressors, regions, CELLS).min(most_cells(regressors + targets, folds)).max(1)
}

impl Lattice {
    /// Cells for so many regions of `rows` rows, from the raw partition columns of some training rows. `shape` is the
    /// number of regressors and of targets; `partition` standardises. No cell lies across the borders of the regions of
    /// `borders`.
    ///
    /// # Errors
    /// Cancelled; columns that cannot be clustered.
    pub(crate) fn new(
        (rows, columns): (usize, &[Vec<f64>]),
        shape: (usize, usize),
        (regions, folds): (usize, u16),
        (partition, borders): (Partition, &Rule),
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
            0 => Bordered { cells: Cells::one(partition.columns.len()), region: vec![0] },
            _ => Bordered::new(&columns, count, borders, seed, progress)?,
        };
        let rule = cells.rule(borders);
        let partition = Partition { rule: rule.clone(), ..partition };
        Ok(Self { partition, rule: Arc::new(rule), cells: cells.cells, regressors: shape.0, cut })
    }

    /// Number of cells.
    pub(crate) fn count(&self) -> usize {
        self.cells.centroids.len()
    }

    /// Note for the user if memory limits the number of cells.
    pub(crate) fn note(&self) -> Option<PartitionNote> {
        let (cells, memory) = (self.count(), STATS_BUDGET >> 20);
        self.cut.then(|| PartitionNote::new("lattice", Finding::CellsLackMemory { cells, memory }))
    }

    /// The tree of the joins of cells; `variance` is that of every target.
    fn grow(&self, cells: &[Gram], preconditioner: &Preconditioner, variance: &[f64]) -> Tree {
        let limits = Limits { least: 1, rows: self.regressors as u64 + 2, apart: APART };
        let error = |gram: &Gram| {
            if gram.weight <= 0.0 {
                return 0.0;
            }
            let residual = preconditioner.residual(gram);
            residual.iter().zip(variance).map(|(residual, variance)| residual / variance).sum()
        };
        Tree::grow(self.cells.with(cells.to_vec()), limits, error)
    }
}

/// The tree of every training set; `variance` is that of every target.
///
/// # Errors
/// Cancelled.
pub(crate) fn grow(
    lattices: &[Lattice],
    sets: &Sets,
    preconditioner: &Preconditioner,
    variance: &[f64],
) -> Result<Vec<Tree>, Error> {
    parallel_map(lattices.len(), &Silent, |set| Ok(lattices[set].grow(sets.training(set), preconditioner, variance)))
}

/// Cells within regions.
struct Bordered {
    cells: Cells,
    /// The region of every cell.
    region: Vec<u32>,
}

impl Bordered {
    /// About `count` cells of standardised columns, of every region as many as is its share of the rows, and one at least.
    fn new(
        columns: &[Vec<f64>],
        count: usize,
        borders: &Rule,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let rows = columns.first().map_or(0, Vec::len);
        let mut regions = vec![0; rows];
        borders.assign(&columns.iter().map(Vec::as_slice).collect::<Vec<&[f64]>>(), &mut regions);
        let mut joined = Self { cells: Cells { centroids: Vec::new(), neighbours: Vec::new() }, region: Vec::new() };
        let mut before = 0;
        for region in 0..borders.count().max(1) as u32 {
            let members: Vec<usize> = (0..rows).filter(|&row| regions[row] == region).collect();
            // Shares of all cells that add up to them.
            let share = |rows_before: usize| rows_before * count / rows.max(1);
            let cells = (share(before + members.len()) - share(before)).max(1);
            before += members.len();
            let of = |column: &Vec<f64>| members.iter().map(|&row| column[row]).collect::<Vec<f64>>();
            let region_columns: Vec<Vec<f64>> = columns.iter().map(of).collect();
            let part = |from: usize| {
                region_columns
                    .iter()
                    .map(|column| &column[from..(from + PART).min(members.len())])
                    .collect::<Columns<'_>>()
            };
            let parts: Vec<Columns<'_>> = (0..members.len()).step_by(PART).map(part).collect();
            let made = if members.is_empty() {
                Cells::one(columns.len())
            } else {
                Cells::new(&parts, cells, seed, progress)?.0
            };
            joined.region.extend(vec![region; made.centroids.len()]);
            joined.cells.append(made);
        }
        Ok(joined)
    }

    /// The nearest centroid within a row's region, as one argument of the greatest. The scores of regions are far above
    /// those of the centroids in them.
    fn rule(&self, borders: &Rule) -> Rule {
        let nearest = Rule::voronoi(self.cells.centroids.clone());
        let (Rule::Linear { weights, offsets }, Rule::Linear { weights: of_regions, offsets: levels }) =
            (&nearest, borders)
        else {
            return nearest;
        };
        let square = of_regions.iter().flatten().map(|weight| weight * weight).sum::<f64>();
        if square.is_nan() || square <= 0.0 {
            return nearest;
        }
        let factor = SHARP * (of_regions.len() as f64 / square).sqrt();
        let both = |(centroid, &region): (&Vec<f64>, &u32)| {
            centroid.iter().zip(&of_regions[region as usize]).map(|(centre, border)| centre + factor * border).collect()
        };
        Rule::Linear {
            weights: weights.iter().zip(&self.region).map(both).collect(),
            offsets: offsets
                .iter()
                .zip(&self.region)
                .map(|(offset, &at)| offset + factor * levels[at as usize])
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fleetfoot_data::mix;

    #[test]
    fn greatest_argument_is_the_nearest_centroid() {
        let uniform = |at: usize| 4.0 * (mix(at as u64 + 1) >> 11) as f64 * 2f64.powi(-53) - 2.0;
        let columns: Vec<Vec<f64>> = (0..3).map(|j| (0..6000).map(|row| uniform(7919 * row + j)).collect()).collect();
        let part: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        for size in [1e-3, 1.0, 1e3] {
            let weights = (0..5).map(|k| (0..3).map(|j| size * uniform(1_000_000 + 10 * k + j)).collect()).collect();
            let borders =
                Rule::Linear { weights, offsets: (0..5).map(|k| 0.2 * size * uniform(2_000_000 + k)).collect() };
            let made = Bordered::new(&columns, 60, &borders, 1, &Silent).unwrap();
            assert!((58..=62).contains(&made.region.len()), "{}", made.region.len());
            let (mut regions, mut cells) = (vec![0; 6000], vec![0; 6000]);
            borders.assign(&part, &mut regions);
            made.rule(&borders).assign(&part, &mut cells);
            let square = |cell: usize, row: usize| -> f64 {
                made.cells.centroids[cell].iter().zip(&columns).map(|(c, column)| (column[row] - c).powi(2)).sum()
            };
            let nearest = |row: usize| {
                let cells = (0..made.region.len()).filter(|&cell| made.region[cell] == regions[row]);
                cells.min_by(|&a, &b| square(a, row).total_cmp(&square(b, row))).unwrap()
            };
            let other = (0..6000).filter(|&row| nearest(row) != cells[row] as usize).count();
            // Borders are moved by a ten thousandth of a deviation or some: no more than a few rows of 6,000 lie there.
            assert!(other < 12, "size {size}: {other} rows");
            // Cells are neighbours within a region alone.
            let beside = made.cells.neighbours.iter().zip(&made.region);
            for (neighbours, region) in beside {
                assert!(neighbours.iter().all(|&other| made.region[other as usize] == *region));
            }
        }
    }

    #[test]
    fn without_borders_cells_match_kmeans() {
        let columns: Vec<Vec<f64>> = vec![(0..500).map(|row| (mix(row) % 1000) as f64).collect()];
        for borders in [Rule::Whole, Rule::Linear { weights: vec![vec![0.0]], offsets: vec![0.0] }] {
            let made = Bordered::new(&columns, 9, &borders, 1, &Silent).unwrap();
            assert_eq!(made.rule(&borders), Rule::voronoi(made.cells.centroids.clone()));
            assert_eq!(made.region, [0; 9]);
        }
    }
}

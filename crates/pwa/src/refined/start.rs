//! Where a descent begins: regions of the rows, and separators.

use fleetfoot_data::Progress;
use fleetfoot_stats::Gram;

use super::separators::Separators;
use crate::{
    Error,
    examples::Examples,
    lattice::{Cell, Cells, Limits, Tree, cell_count, centroids},
};

/// Cells that are joined, at most (but two for each region).
const CELLS: usize = 200;
/// Regions from which on joins are not limited to neighbours.
const APART: usize = 50;

/// The regions of the rows, by chunk, and separators to begin with.
pub(super) type Start = (Vec<Vec<u32>>, Separators);

/// How many cells are joined to so many regions.
pub(super) fn cells(examples: &Examples, regions: usize) -> usize {
    cell_count(examples.rows, examples.regressors, regions, CELLS)
}

/// The cells of k-means; `None` where there is one place only.
pub(super) fn by_kmeans(
    examples: &Examples,
    regions: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Option<Start>, Error> {
    let separators = Separators::voronoi(&centroids(&examples.places(), regions, seed, progress)?, examples.dimensions);
    Ok((separators.regions > 1).then(|| (separators.winners(examples), separators)))
}

/// Small cells, joined by what their joint fit costs.
pub(super) struct Joined {
    /// The cell of every row.
    cells: Vec<Vec<u32>>,
    count: usize,
    /// Joins of neighbours, and joins that in the end are not limited to them.
    trees: [Tree; 2],
}

impl Joined {
    /// Makes so many cells (fewer where there are fewer places) and joins them.
    pub(super) fn new(examples: &Examples, cells: usize, seed: u64, progress: &dyn Progress) -> Result<Self, Error> {
        let (places, cells) = Cells::new(&examples.places(), cells, seed, progress)?;
        let count = places.centroids.len();
        let grams = examples.grams(&cells, count);
        let error = |gram: &Gram| examples.error(gram);
        let leaves: Vec<Cell> = places.with(grams);
        let grow = |leaves, apart| Tree::grow(leaves, Limits { least: 2, rows: 0, apart }, error);
        Ok(Self { cells, count, trees: [grow(leaves.clone(), 0), grow(leaves, APART)] })
    }

    /// Joined to so many regions, in one way or two; none where there are no more cells than that.
    pub(super) fn starts(&self, regions: usize, dimensions: usize) -> Vec<Start> {
        let mut tables: Vec<Vec<u32>> = self.trees.iter().map(|tree| tree.regions(regions)).collect();
        tables.dedup();
        let labels = |table: &Vec<u32>| {
            let of = |rows: &Vec<u32>| rows.iter().map(|&cell| table[cell as usize]).collect();
            self.cells.iter().map(of).collect()
        };
        let start = |table: Vec<u32>| (labels(&table), Separators::zero(regions, dimensions));
        tables.into_iter().filter(|_| self.count > regions).map(start).collect()
    }
}

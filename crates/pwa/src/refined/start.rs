//! Where a descent begins: regions of the rows, and separators.

use std::collections::BTreeSet;

use fleetfoot_data::Progress;
use fleetfoot_stats::Gram;

use super::{
    examples::{Chunk, Examples},
    separators::Separators,
};
use crate::{
    Error, KMeansOptions, Points, kmeans,
    lattice::{Cell, Tree},
};

/// Cells that are joined, at most (but two for each region).
const CELLS: usize = 200;
/// Rows of a cell on average, over those that a map needs, where there are enough.
const ROWS_OF_A_CELL: usize = 3;
/// Iterations of the k-means that makes cells.
const ITERATIONS: usize = 20;

/// The regions of the rows, by chunk, and separators to begin with.
type Start = (Vec<Vec<u32>>, Separators);

/// How many cells are joined to so many regions.
pub(super) fn cells(examples: &Examples, regions: usize) -> usize {
    let few = examples.rows / (ROWS_OF_A_CELL * (examples.regressors + 2));
    few.min(CELLS).max(2 * regions).min(examples.rows)
}

/// The cells of k-means; `None` where there is one place only.
pub(super) fn by_kmeans(
    examples: &Examples,
    regions: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Option<Start>, Error> {
    let separators = Separators::voronoi(&clustered(examples, regions, seed, progress)?, examples.dimensions);
    Ok((separators.regions > 1).then(|| (separators.winners(examples), separators)))
}

/// Small cells, joined by what their joint fit costs.
pub(super) struct Joined {
    /// The cell of every row.
    cells: Vec<Vec<u32>>,
    count: usize,
    tree: Tree,
}

impl Joined {
    /// Makes so many cells (fewer where there are fewer places) and joins them.
    pub(super) fn new(examples: &Examples, cells: usize, seed: u64, progress: &dyn Progress) -> Result<Self, Error> {
        let d = examples.dimensions;
        let centroids = clustered(examples, cells, seed, progress)?;
        let count = centroids.len() / d;
        let nearest = examples.map(|_, chunk| two_nearest(chunk, &centroids, d));
        let mut neighbours = vec![BTreeSet::new(); count];
        for &(first, second) in nearest.iter().flatten().filter(|(first, second)| first != second) {
            neighbours[first as usize].insert(second);
            neighbours[second as usize].insert(first);
        }
        let cells: Vec<Vec<u32>> = nearest.iter().map(|rows| rows.iter().map(|row| row.0).collect()).collect();
        let grams = examples.grams(&cells, count).into_iter().zip(neighbours).zip(centroids.chunks_exact(d));
        let leaves =
            grams.map(|((gram, neighbours), place)| Cell { gram, place: place.to_vec(), neighbours }).collect();
        let error = |gram: &Gram| {
            if gram.weight > 0.0 { examples.scaled(&examples.root(gram).residual) } else { 0.0 }
        };
        Ok(Self { cells, count, tree: Tree::grow(leaves, 2, error) })
    }

    /// Joined to so many regions; `None` where there are no more cells than that.
    pub(super) fn start(&self, regions: usize, dimensions: usize) -> Option<Start> {
        let region = self.tree.regions(regions);
        let of = |rows: &Vec<u32>| rows.iter().map(|&cell| region[cell as usize]).collect();
        let labels = || self.cells.iter().map(of).collect();
        (self.count > regions).then(|| (labels(), Separators::zero(regions, dimensions)))
    }
}

/// Centroids of the rows by k-means (k x d); fewer where there are fewer places.
fn clustered(examples: &Examples, k: usize, seed: u64, progress: &dyn Progress) -> Result<Vec<f64>, Error> {
    let d = examples.dimensions;
    let mut points = Points::new(d);
    for chunk in &examples.chunks {
        let columns: Vec<&[f64]> = (0..d).map(|column| chunk.column(column)).collect();
        points.append(&columns, &vec![0.0; d], &vec![1.0; d])?;
    }
    let options = KMeansOptions { k, max_iterations: ITERATIONS, ..KMeansOptions::default() };
    Ok(kmeans(&points, crate::Start::PlusPlus { seed, restarts: 1 }, &options, progress)?.centroids)
}

/// The nearest and the second nearest centroid of every row: cells that are so for some row share a border (Martinetz and Schulten, "Topology representing
/// networks", 1994).
fn two_nearest(chunk: &Chunk, centroids: &[f64], d: usize) -> Vec<(u32, u32)> {
    let mut found = vec![(0, 0); chunk.rows];
    let mut least = vec![(f64::INFINITY, f64::INFINITY); chunk.rows];
    let mut squares = vec![0.0; chunk.rows];
    for (cell, centroid) in centroids.chunks_exact(d).enumerate() {
        squares.fill(0.0);
        for (column, c) in centroid.iter().enumerate() {
            for (square, z) in squares.iter_mut().zip(chunk.column(column)) {
                *square += (z - c) * (z - c);
            }
        }
        for (row, &square) in squares.iter().enumerate() {
            if square < least[row].0 {
                least[row] = (square, least[row].0);
                found[row] = (cell as u32, found[row].0);
            } else if square < least[row].1 {
                (least[row].1, found[row].1) = (square, cell as u32);
            }
        }
    }
    found
}

//! Small cells of k-means, and which of them share a border.

use std::collections::BTreeSet;

use fleetfoot_data::{Progress, Silent, parallel_map};

use fleetfoot_stats::Gram;

use super::tree::Cell;
use crate::{Error, KMeansOptions, Points, Start, kmeans};

/// Rows of a cell on average, over those that a map needs, where there are enough.
const ROWS_OF_A_CELL: usize = 3;
/// Iterations of the k-means that makes cells.
const ITERATIONS: usize = 20;

/// Standardised columns of some rows, column by column.
pub(crate) type Columns<'a> = Vec<&'a [f64]>;

/// Places of the cells, and their neighbours.
pub(crate) struct Cells {
    /// One centroid a cell, standardised.
    pub(crate) centroids: Vec<Vec<f64>>,
    /// The cells that each shares a border with.
    pub(crate) neighbours: Vec<BTreeSet<u32>>,
}

/// Number of cells for so many rows: at most `most`, at least two for each region.
pub(crate) fn count(rows: usize, regressors: usize, regions: usize, most: usize) -> usize {
    let few = rows / (ROWS_OF_A_CELL * (regressors + 2));
    few.min(most).max(2 * regions).min(rows)
}

impl Cells {
    /// At most `count` cells of the rows of some parts (fewer where there are fewer places), and the cell of every row, part by part.
    ///
    /// # Errors
    /// Cancelled; columns that cannot be clustered.
    pub(crate) fn new(
        parts: &[Columns<'_>],
        count: usize,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<(Self, Vec<Vec<u32>>), Error> {
        let centroids = centroids(parts, count, seed, progress)?;
        let nearest = parallel_map(parts.len(), &Silent, |at| Ok::<_, Error>(two_nearest(&parts[at], &centroids)))?;
        let mut neighbours = vec![BTreeSet::new(); centroids.len()];
        for &(first, second) in nearest.iter().flatten().filter(|(first, second)| first != second) {
            neighbours[first as usize].insert(second);
            neighbours[second as usize].insert(first);
        }
        let cells_of_rows = nearest.iter().map(|rows| rows.iter().map(|row| row.0).collect()).collect();
        Ok((Self { centroids, neighbours }, cells_of_rows))
    }

    /// One cell.
    pub(crate) fn one(dimensions: usize) -> Self {
        Self { centroids: vec![vec![0.0; dimensions]], neighbours: vec![BTreeSet::new()] }
    }

    /// Appends cells that share no border with these.
    pub(crate) fn append(&mut self, other: Self) {
        let before = self.centroids.len() as u32;
        let moved = |cells: BTreeSet<u32>| cells.into_iter().map(|cell| cell + before).collect();
        self.centroids.extend(other.centroids);
        self.neighbours.extend(other.neighbours.into_iter().map(moved));
    }

    /// The cells with the Gram matrix of the rows of each.
    pub(crate) fn with(&self, grams: Vec<Gram>) -> Vec<Cell> {
        let places = self.centroids.iter().zip(&self.neighbours).zip(grams);
        places
            .map(|((place, neighbours), gram)| Cell { gram, place: place.clone(), neighbours: neighbours.clone() })
            .collect()
    }
}

/// Centroids of the rows by k-means; fewer where there are fewer places.
///
/// # Errors
/// Cancelled; columns that cannot be clustered.
pub(crate) fn centroids(
    parts: &[Columns<'_>],
    k: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<Vec<f64>>, Error> {
    let d = parts.first().map_or(0, Vec::len);
    let mut points = Points::new(d);
    for columns in parts {
        points.append(columns, &vec![0.0; d], &vec![1.0; d])?;
    }
    let options = KMeansOptions { k, max_iterations: ITERATIONS, ..KMeansOptions::default() };
    let kmeans = kmeans(&points, Start::PlusPlus { seed, restarts: 1 }, &options, progress)?;
    Ok(kmeans.centroids.chunks_exact(d.max(1)).map(<[f64]>::to_vec).collect())
}

/// The nearest and the second nearest centroid of every row. Two cells that are so for some row share a border
/// (Martinetz and Schulten, "Topology representing networks", 1994).
fn two_nearest(columns: &[&[f64]], centroids: &[Vec<f64>]) -> Vec<(u32, u32)> {
    let rows = columns.first().map_or(0, |column| column.len());
    let mut nearest_two = vec![(0, 0); rows];
    let mut least = vec![(f64::INFINITY, f64::INFINITY); rows];
    let mut squares = vec![0.0; rows];
    for (cell, centroid) in centroids.iter().enumerate() {
        squares.fill(0.0);
        for (&c, column) in centroid.iter().zip(columns) {
            for (square, z) in squares.iter_mut().zip(*column) {
                *square += (z - c) * (z - c);
            }
        }
        for (row, &square) in squares.iter().enumerate() {
            if square < least[row].0 {
                least[row] = (square, least[row].0);
                nearest_two[row] = (cell as u32, nearest_two[row].0);
            } else if square < least[row].1 {
                (least[row].1, nearest_two[row].1) = (square, cell as u32);
            }
        }
    }
    nearest_two
}

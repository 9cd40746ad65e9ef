//! Start of a descent: regions of the rows, and separators.

use fleetfoot_data::{Progress, mix};
use fleetfoot_stats::{Gram, ridge};

use super::separators::Separators;
use crate::{
    Error,
    examples::Examples,
    lattice::{Cell, Cells, Limits, Tree, cell_count, centroids},
    region_model::RegionModel,
};

/// Cells that are joined, at most (but two for each region).
const CELLS: usize = 200;
/// Regions from which on joins are not limited to neighbours.
const APART: usize = 50;

/// The regions of the rows, by chunk, and separators to begin with.
pub(super) type Start = (Vec<Vec<u32>>, Separators);

/// Number of cells that are joined to so many regions.
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

/// Rows by the map of least error, of maps that each fit the neighbours of one row. The first row is random, every
/// further one is drawn by its squared error under the maps before, as k-means++ draws centroids by their distance
/// (Arthur and Vassilvitskii 2007). If modes do not follow density, and rows are few, cells lie across modes; a few
/// neighbours often do not.
pub(super) fn by_maps(examples: &Examples, regions: usize, seed: u64) -> Start {
    let uniform = |draw: usize| (mix(mix(seed).wrapping_add(draw as u64)) >> 11) as f64 * 2f64.powi(-53);
    let weight = |at: usize, row: usize| examples.chunks[at].weight(row);
    let mut least: Vec<Vec<f64>> = examples.map(|_, chunk| vec![f64::INFINITY; chunk.rows]);
    let mut labels: Vec<Vec<u32>> = examples.map(|_, chunk| vec![0; chunk.rows]);
    for region in 0..regions {
        let share = |at: usize, row: usize| if region > 0 { least[at][row] * weight(at, row) } else { weight(at, row) };
        let rows = || (0..least.len()).flat_map(|at| (0..least[at].len()).map(move |row| (at, row)));
        let mut left = uniform(region) * rows().map(|(at, row)| share(at, row)).sum::<f64>();
        let drawn = rows().find(|&(at, row)| {
            left -= share(at, row);
            left < 0.0
        });
        let maps = examples.maps(&[neighbours(examples, drawn.unwrap_or((0, 0)))]);
        for (at, chunk) in examples.chunks.iter().enumerate() {
            let mut errors = vec![0.0; chunk.rows];
            examples.errors(chunk, &maps, 0, &mut errors);
            for ((error, least), label) in errors.into_iter().zip(&mut least[at]).zip(&mut labels[at]) {
                if error < *least {
                    (*least, *label) = (error, region as u32);
                }
            }
        }
    }
    (labels, Separators::zero(regions, examples.dimensions))
}

/// The map of the rows nearest to one, twice as many as it has numbers, and of one more that obeys the map of all.
fn neighbours(examples: &Examples, (at, row): (usize, usize)) -> RegionModel {
    let place: Vec<f64> = (0..examples.dimensions).map(|column| examples.chunks[at].column(column)[row]).collect();
    let distances = examples.map(|_, chunk| {
        let square = |row: usize| -> f64 {
            place.iter().enumerate().map(|(column, z)| (chunk.column(column)[row] - z).powi(2)).sum()
        };
        (0..chunk.rows).map(square).collect::<Vec<f64>>()
    });
    let wanted = (2 * (examples.regressors + 1)).min(examples.rows);
    let mut sorted: Vec<(f64, usize, usize)> = Vec::with_capacity(examples.rows);
    for (at, of_chunk) in distances.iter().enumerate() {
        sorted.extend(of_chunk.iter().enumerate().map(|(row, distance)| (*distance, at, row)));
    }
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut labels: Vec<Vec<u32>> = examples.map(|_, chunk| vec![1; chunk.rows]);
    sorted[..wanted].iter().for_each(|&(_, at, row)| labels[at][row] = 0);
    let grams = examples.grams(&labels, 2);
    let base = &examples.base;
    if grams[0].weight <= 0.0 {
        return base.average.clone();
    }
    let root = examples.root(&grams[0]);
    RegionModel::new(ridge(&root, &base.scale, 1.0 / root.weight, Some(base.average.coefficients.as_ref())))
}

/// Small cells, joined by the growth of their joint error.
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

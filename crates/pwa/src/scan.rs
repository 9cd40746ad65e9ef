//! The second pass: one scan for all regions, all folds and all partitions together.

use faer::{MatMut, MatRef};
use fleetfoot_data::{Progress, Source};
use fleetfoot_stats::{
    Chunk, Fold, Key, Preconditioner, Stats,
    scan::{RegionGrams, RegionRanges, scan},
};

use crate::{
    Error,
    assignment::Assigner,
    lattice::{CellPart, CellSums, Lattice},
    rows::{Rows, Tile},
    segmentation::Segmentation,
};

/// Grams of all partitions, and the ranges of the regressors in the regions of those partitions made on all rows.
pub(crate) struct Scan {
    pub(crate) stats: Stats,
    /// Ranges of the regressors for every partition; none for those that belong to a fold.
    pub(crate) ranges: Vec<RegionRanges>,
    /// Sums of the cells, where there are cells to join.
    pub(crate) cells: Option<CellSums>,
}

struct Part {
    /// By partition; without regions for those that are joined of cells.
    grams: Vec<RegionGrams>,
    ranges: Vec<RegionRanges>,
    cells: Option<CellPart>,
    work: Vec<f64>,
    regions: Vec<u32>,
}

/// Scans all rows once for all partitions.
pub(crate) fn sum(
    rows: &Rows,
    segmentation: &Segmentation,
    preconditioner: &Preconditioner,
    source: &dyn Source,
    chunks: &[Chunk],
    plan: &str,
    progress: &dyn Progress,
) -> Result<Scan, Error> {
    let cells: Vec<usize> = segmentation.lattices.iter().map(Lattice::count).collect();
    let start = || Part::new(rows, segmentation, &cells);
    let mut scanned = Scan {
        stats: Stats::new(plan),
        ranges: start().ranges,
        cells: (!cells.is_empty()).then(|| CellSums::new(&cells, (rows.regressors, rows.dimension()))),
    };
    let assigner = Assigner::new(segmentation);
    scan(
        &rows.columns,
        source,
        chunks,
        progress,
        start,
        |part, place, tile| {
            part.add(rows, &assigner, preconditioner, &Tile::new(tile), place.chunk.fold);
            Ok::<_, Error>(())
        },
        |chunk, _, part| {
            let episode = source.episodes()[chunk.episode].id;
            scanned.ranges.iter_mut().zip(&part.ranges).for_each(|(all, some)| all.merge(some));
            if let (Some(all), Some(part)) = (&mut scanned.cells, part.cells) {
                all.add(chunk.fold, part);
            }
            for (partition, grams) in part.grams.into_iter().enumerate() {
                for (region, gram) in grams.into_regions() {
                    let partition = partition as u16;
                    let key = Key { episode, chunk: chunk.index, fold: chunk.fold, partition, region };
                    scanned.stats.insert(key, gram)?;
                }
            }
            Ok(())
        },
    )?;
    Ok(scanned)
}

impl Part {
    fn new(rows: &Rows, segmentation: &Segmentation, cells: &[usize]) -> Self {
        // Those joined of cells have no sums of their own.
        let count = |p: usize| segmentation.partitions[p].rule.count();
        // What is made on all rows tells where it was trained.
        let described = |p: usize| segmentation.candidates.iter().any(|candidate| candidate.full == p);
        let partitions = 0..segmentation.partitions.len();
        let ranges = |p: usize| RegionRanges::new(if described(p) { count(p) } else { 0 }, rows.regressors);
        Self {
            grams: partitions.clone().map(|p| RegionGrams::new(count(p))).collect(),
            ranges: partitions.map(ranges).collect(),
            cells: (!cells.is_empty()).then(|| CellPart::new(cells, rows.regressors)),
            work: Vec::new(),
            regions: Vec::new(),
        }
    }

    fn add(
        &mut self,
        rows: &Rows,
        assigner: &Assigner<'_>,
        preconditioner: &Preconditioner,
        tile: &Tile<'_>,
        fold: Fold,
    ) {
        self.work.clear();
        self.work.extend_from_slice(tile.regression());
        preconditioner.apply(MatMut::from_column_major_slice_mut(&mut self.work, tile.len(), rows.dimension()));
        let z = MatRef::from_column_major_slice(&self.work, tile.len(), rows.dimension());
        let (assignment, regressors) = (assigner.on(tile), tile.regressors());
        if let Some(cells) = &mut self.cells {
            cells.add((z, tile.weights(), fold), |set| assignment.cells(set), &regressors);
        }
        let Some((whole, others)) = self.grams.split_first_mut() else { return };
        let (mut summed, weights) = (false, tile.weights());
        let one = |partition: usize, grams: &RegionGrams| {
            grams.regions() == 1 && assigner.segmentation.labels[partition].is_none()
        };
        // The first partition is that of one region: the regions of another one can serve it.
        for (partition, grams) in (1..).zip(others).filter(|(_, grams)| grams.regions() > 0) {
            let regions = if one(partition, grams) {
                grams.add(z, weights, None);
                None
            } else {
                assignment.assign(partition, &mut self.regions);
                if summed {
                    grams.add(z, weights, Some(&self.regions));
                } else {
                    grams.add_with_whole(z, weights, &self.regions, whole);
                }
                summed = true;
                Some(self.regions.as_slice())
            };
            let ranges = &mut self.ranges[partition];
            if !ranges.0.is_empty() {
                ranges.add(&regressors, regions);
            }
        }
        if !summed {
            whole.add(z, weights, None);
        }
        if !self.ranges[0].0.is_empty() {
            self.ranges[0].add(&regressors, None);
        }
    }
}

//! The second pass: one reduction for all regions, all folds and all partitions together.

use std::cell::RefCell;

use faer::{MatMut, MatRef};
use fleetfoot_data::{Progress, Source};
use fleetfoot_library::DesignRows;
use fleetfoot_model::Partition;
use fleetfoot_stats::{Chunk, Gram, Key, Preconditioner, Stats, pilot_tiles, reduce};

use crate::{
    Error,
    regions::Segmentation,
    rows::{Rows, Tile},
};

/// Grams of all partitions, and the ranges of the regressors in the regions of those partitions made on all rows.
pub(crate) struct Scan {
    pub(crate) stats: Stats,
    /// `ranges[partition][region][regressor]`; empty for partitions that belong to a fold.
    pub(crate) ranges: Vec<Vec<Vec<[f64; 2]>>>,
}

/// The preconditioner from a strided pilot sample of the regression's rows.
pub(crate) fn pilot(rows: &Rows, source: &dyn Source) -> Result<Preconditioner, Error> {
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); rows.dimension()];
    let mut scratch = DesignRows::default();
    pilot_tiles(source, rows.halo(), |episode, block, tile| {
        let tile = rows.evaluate(block, &episode.name, tile, &mut scratch)?;
        for (all, column) in values.iter_mut().zip(tile.regression().chunks_exact(tile.len().max(1))) {
            all.extend_from_slice(column);
        }
        Ok::<_, Error>(())
    })?;
    let length = values.first().map_or(0, Vec::len);
    let joined: Vec<f64> = values.concat();
    let matrix = MatRef::from_column_major_slice(&joined, length, rows.dimension());
    Ok(Preconditioner::from_pilot(matrix, rows.regressors))
}

/// Assigns the rows of a tile to the regions of a partition.
pub(crate) struct Assigner<'a> {
    segmentation: &'a Segmentation,
}

thread_local! {
    static STANDARDISED: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

impl<'a> Assigner<'a> {
    pub(crate) fn new(segmentation: &'a Segmentation) -> Self {
        Self { segmentation }
    }

    pub(crate) fn assign(&self, partition: usize, tile: &Tile<'_>, regions: &mut Vec<u32>) {
        regions.clear();
        regions.resize(tile.len(), 0);
        let Partition { rule, centre, scale, .. } = &self.segmentation.partitions[partition];
        if rule.count() == 1 && self.segmentation.labels[partition].is_none() {
            return;
        }
        let mut columns = tile.partition_columns();
        if let Some(label) = self.segmentation.labels[partition] {
            columns.push(tile.label(label));
        }
        STANDARDISED.with_borrow_mut(|buffer| {
            buffer.clear();
            for ((column, centre), scale) in columns.iter().zip(centre).zip(scale) {
                buffer.extend(column.iter().map(|value| (value - centre) / scale));
            }
            let z: Vec<&[f64]> = buffer.chunks_exact(tile.len().max(1)).collect();
            rule.assign(&z, regions);
        });
    }
}

#[derive(Default)]
struct Part {
    /// `grams[partition][region]`.
    grams: Vec<Vec<Option<Gram>>>,
    ranges: Vec<Vec<Vec<[f64; 2]>>>,
    scratch: DesignRows,
    work: Vec<f64>,
    regions: Vec<u32>,
}

/// Scans all rows once for all partitions.
pub(crate) fn scan(
    rows: &Rows,
    segmentation: &Segmentation,
    preconditioner: &Preconditioner,
    source: &dyn Source,
    chunks: &[Chunk],
    plan: &str,
    progress: &dyn Progress,
) -> Result<Scan, Error> {
    let described: Vec<bool> = (0..segmentation.partitions.len())
        .map(|p| segmentation.candidates.iter().any(|candidate| candidate.full == p))
        .collect();
    let count = |p: usize| segmentation.partitions[p].rule.count();
    let empty_range = vec![[f64::INFINITY, f64::NEG_INFINITY]; rows.regressors];
    let no_ranges: Vec<Vec<Vec<[f64; 2]>>> = (0..described.len())
        .map(|p| if described[p] { vec![empty_range.clone(); count(p)] } else { Vec::new() })
        .collect();
    let mut scan = Scan { stats: Stats::new(plan), ranges: no_ranges.clone() };
    let assigner = Assigner::new(segmentation);
    reduce(
        source,
        chunks,
        rows.halo(),
        progress,
        || Part {
            grams: (0..described.len()).map(|p| vec![None; count(p)]).collect(),
            ranges: no_ranges.clone(),
            ..Part::default()
        },
        |part, chunk, block, tile| {
            let mut scratch = std::mem::take(&mut part.scratch);
            let tile = rows.evaluate(block, &source.episodes()[chunk.episode].name, tile, &mut scratch)?;
            if tile.len() > 0 {
                part.add(rows, &assigner, preconditioner, &tile, &described);
            }
            part.scratch = scratch;
            Ok::<_, Error>(())
        },
        |chunk, part| {
            let episode = source.episodes()[chunk.episode].id;
            for (all, some) in scan.ranges.iter_mut().flatten().flatten().zip(part.ranges.iter().flatten().flatten()) {
                *all = [all[0].min(some[0]), all[1].max(some[1])];
            }
            for (partition, grams) in part.grams.into_iter().enumerate() {
                for (region, gram) in grams.into_iter().enumerate() {
                    if let Some(gram) = gram {
                        let key = Key {
                            episode,
                            chunk: chunk.index,
                            fold: chunk.fold,
                            partition: partition as u16,
                            region: region as u32,
                        };
                        scan.stats.insert(key, gram)?;
                    }
                }
            }
            Ok(())
        },
    )?;
    Ok(scan)
}

impl Part {
    fn add(
        &mut self,
        rows: &Rows,
        assigner: &Assigner<'_>,
        preconditioner: &Preconditioner,
        tile: &Tile<'_>,
        described: &[bool],
    ) {
        self.work.clear();
        self.work.extend_from_slice(tile.regression());
        preconditioner.apply(MatMut::from_column_major_slice_mut(&mut self.work, tile.len(), rows.dimension()));
        let z = MatRef::from_column_major_slice(&self.work, tile.len(), rows.dimension());
        for (partition, grams) in self.grams.iter_mut().enumerate() {
            let labelled = assigner.segmentation.labels[partition].is_some();
            if grams.len() == 1 && !labelled {
                merge(&mut grams[0], Gram::of_rows(z, tile.weights()));
                self.regions.clear();
                self.regions.resize(tile.len(), 0);
            } else {
                assigner.assign(partition, tile, &mut self.regions);
                for (region, gram) in Gram::by_region(z, tile.weights(), &self.regions, grams.len()) {
                    merge(&mut grams[region as usize], gram);
                }
            }
            if described[partition] {
                for regressor in 0..rows.regressors {
                    for (&region, &value) in self.regions.iter().zip(tile.regressor(regressor)) {
                        if let Some(range) = self.ranges[partition].get_mut(region as usize) {
                            let range = &mut range[regressor];
                            // Seldom true, so cheaper than writing every time.
                            if value < range[0] {
                                range[0] = value;
                            }
                            if value > range[1] {
                                range[1] = value;
                            }
                        }
                    }
                }
            }
        }
    }
}

fn merge(total: &mut Option<Gram>, gram: Gram) {
    match total {
        Some(total) => total.merge(&gram),
        None => *total = Some(gram),
    }
}

//! The second pass: one reduction for all regions, all folds and all partitions together.

use std::cell::{OnceCell, RefCell};

use faer::{MatMut, MatRef};
use fleetfoot_data::{Progress, Source};
use fleetfoot_library::DesignRows;
use fleetfoot_model::{Partition, Rule, join};
use fleetfoot_stats::{Chunk, Gram, Key, Preconditioner, Stats, pilot_tiles, reduce};

use crate::{
    Error,
    lattice::{CellPart, CellSums, Lattice},
    regions::Segmentation,
    rows::{Rows, Tile},
};

/// Grams of all partitions, and the ranges of the regressors in the regions of those partitions made on all rows.
pub(crate) struct Scan {
    pub(crate) stats: Stats,
    /// `ranges[partition][region][regressor]`; empty for partitions that belong to a fold.
    pub(crate) ranges: Vec<Vec<Vec<[f64; 2]>>>,
    /// Sums of the cells, where there are cells to join.
    pub(crate) cells: Option<CellSums>,
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

    /// The rows of a tile, for all partitions.
    pub(crate) fn on<'t>(&'t self, tile: &'t Tile<'t>) -> Assignment<'t> {
        Assignment { segmentation: self.segmentation, tile, cells: OnceCell::new() }
    }
}

/// The rows of a tile on their way to regions. Cells are found once for all that are joined of them.
pub(crate) struct Assignment<'t> {
    segmentation: &'t Segmentation,
    tile: &'t Tile<'t>,
    cells: OnceCell<Vec<u32>>,
}

impl Assignment<'_> {
    /// The region of every row.
    pub(crate) fn assign(&self, partition: usize, regions: &mut Vec<u32>) {
        let label = self.segmentation.labels[partition];
        let partition = &self.segmentation.partitions[partition];
        match &partition.rule {
            Rule::Joined { regions: table, .. } => {
                regions.clear();
                regions.extend_from_slice(self.cells());
                join(table, regions);
            }
            _ => self.by(partition, label, regions),
        }
    }

    /// The cell of every row.
    pub(crate) fn cells(&self) -> &[u32] {
        self.cells.get_or_init(|| {
            let mut cells = Vec::new();
            if let Some(lattice) = &self.segmentation.lattice {
                self.by(&lattice.partition, None, &mut cells);
            }
            cells
        })
    }

    /// By a partition's own rule.
    fn by(&self, partition: &Partition, label: Option<usize>, regions: &mut Vec<u32>) {
        let tile = self.tile;
        regions.clear();
        regions.resize(tile.len(), 0);
        let Partition { rule, centre, scale, .. } = partition;
        if rule.count() == 1 && label.is_none() {
            return;
        }
        let mut columns = tile.partition_columns();
        if let Some(label) = label {
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
    cells: Option<CellPart>,
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
    // Those joined of cells have no sums of their own.
    let count = |p: usize| segmentation.partitions[p].rule.count();
    let cells = segmentation.lattice.as_ref().map(Lattice::count);
    let empty_range = vec![[f64::INFINITY, f64::NEG_INFINITY]; rows.regressors];
    let no_ranges: Vec<Vec<Vec<[f64; 2]>>> = (0..described.len())
        .map(|p| if described[p] { vec![empty_range.clone(); count(p)] } else { Vec::new() })
        .collect();
    let mut scan = Scan {
        stats: Stats::new(plan),
        ranges: no_ranges.clone(),
        cells: cells.map(|cells| CellSums::new(cells, (rows.regressors, rows.dimension()))),
    };
    let assigner = Assigner::new(segmentation);
    reduce(
        source,
        chunks,
        rows.halo(),
        progress,
        || Part {
            grams: (0..described.len()).map(|p| vec![None; count(p)]).collect(),
            ranges: no_ranges.clone(),
            cells: cells.map(CellPart::new),
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
            if let (Some(all), Some(part)) = (&mut scan.cells, part.cells) {
                all.add(chunk.fold, part);
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
        let assignment = assigner.on(tile);
        if let Some(cells) = &mut self.cells {
            let regressors: Vec<&[f64]> = (0..rows.regressors).map(|regressor| tile.regressor(regressor)).collect();
            cells.add(z, tile.weights(), assignment.cells(), &regressors);
        }
        for (partition, grams) in self.grams.iter_mut().enumerate().filter(|(_, grams)| !grams.is_empty()) {
            let labelled = assigner.segmentation.labels[partition].is_some();
            if grams.len() == 1 && !labelled {
                merge(&mut grams[0], Gram::of_rows(z, tile.weights()));
                self.regions.clear();
                self.regions.resize(tile.len(), 0);
            } else {
                assignment.assign(partition, &mut self.regions);
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

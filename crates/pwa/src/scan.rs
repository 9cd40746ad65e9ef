//! The second pass: one scan for all regions, all folds and all partitions together.
//!
//! A chunk of the pass is a chunk of the statistic that `fleetfoot scan` makes of the same rows. In partitions that are
//! made on all rows it is summed as such a statistic sums it, to the bit: a model is the same from logs and from their
//! statistic. Folds cut the rows elsewhere. Every chunk that they divide is summed once more in its pieces.

use std::ops::Range;

use faer::{MatMut, MatRef};
use fleetfoot_data::{Progress, Source};
use fleetfoot_library::DesignRows;
use fleetfoot_stats::{
    Chunk, Gram, Grid, Key, Preconditioner, Stats, TILE_ROWS, reduce,
    scan::{RegionGrams, RegionRanges, RowCounts},
};
use fleetfoot_sums::system::{ChunkSums, EpisodeSums, SystemPass, SystemPlan, SystemScan, SystemSums};

use crate::{
    Error,
    assignment::Assigner,
    cuts::{Cuts, rows_of},
    lattice::{CellPart, CellSums, Lattice},
    rows::{Rows, Tile},
    segmentation::Segmentation,
};

/// Grams of all partitions, and the ranges of the regressors in the regions of those partitions made on all rows.
pub(crate) struct Scan {
    /// By chunks that folds cut.
    pub(crate) stats: Stats,
    /// The statistic of every partition that is made on all rows; none of those that are joined of cells, or belong to a fold.
    pub(crate) whole: Vec<Option<SystemScan>>,
    /// Ranges of the regressors for every partition; none for those that belong to a fold.
    pub(crate) ranges: Vec<RegionRanges>,
    /// Sums of the cells, where there are cells to join.
    pub(crate) cells: Option<CellSums>,
}

/// Sums that a pass makes: plans of the partitions that are made on all rows, and everything by chunks of the folds.
pub(crate) struct Wanted<'a> {
    /// By partition.
    pub(crate) plans: &'a [Option<SystemPlan>],
    /// The chunks of the folds.
    pub(crate) cuts: Cuts<'a>,
    /// Of which partitions they are summed.
    pub(crate) cut: &'a [bool],
}

impl Wanted<'_> {
    /// The chunks of the pass: those of the statistic, of the folds where there is none.
    fn passed(&self, source: &dyn Source) -> Vec<Chunk> {
        let chunk_rows = self.plans.iter().flatten().map(|plan| plan.chunk_rows).max();
        chunk_rows.map_or_else(|| self.cuts.chunks.to_vec(), |chunk_rows| Grid { chunk_rows }.chunks(source.episodes()))
    }
}

/// Sums of a chunk so far.
struct Part {
    /// By partition; `None` without a plan, or with one of moments.
    whole: Vec<Option<RegionGrams>>,
    /// Of the one region, where its plan is one of moments.
    moments: Option<ChunkSums>,
    counts: RowCounts,
    rows: DesignRows,
    /// Complete rows that no region took, by partition.
    unassigned: Vec<u64>,
    ranges: Vec<RegionRanges>,
    also: Gram,
    pieces: Vec<Piece>,
    work: Vec<f64>,
    regions: Vec<u32>,
}

/// The part of a chunk that lies in a chunk of the folds.
struct Piece {
    /// The place of that chunk.
    chunk: usize,
    /// By partition; without regions for those that are not summed.
    grams: Vec<RegionGrams>,
    cells: Option<CellPart>,
}

/// Inputs that all parts share.
struct Pass<'a> {
    rows: &'a Rows,
    segmentation: &'a Segmentation,
    preconditioner: &'a Preconditioner,
    wanted: &'a Wanted<'a>,
    /// Cells of every training set.
    cells: Vec<usize>,
    /// Of the one region, where its plan is one of moments.
    moments: Option<SystemPass<'a>>,
}

/// Scans all rows once for all partitions.
pub(crate) fn sum(
    rows: &Rows,
    segmentation: &Segmentation,
    preconditioner: &Preconditioner,
    source: &dyn Source,
    wanted: &Wanted<'_>,
    plan: &str,
    progress: &dyn Progress,
) -> Result<Scan, Error> {
    let cells: Vec<usize> = segmentation.lattices.iter().map(Lattice::count).collect();
    let mut cell_sums = (!cells.is_empty()).then(|| CellSums::new(&cells, (rows.regressors, rows.dimension())));
    let moments = wanted.plans.first().and_then(Option::as_ref).filter(|plan| plan.is_polynomial());
    let moments = moments.map(|plan| SystemPass::new(plan, source)).transpose()?;
    let pass = Pass { rows, segmentation, preconditioner, wanted, cells, moments };
    let (mut stats, mut ranges) = (Stats::new(plan), pass.start().ranges);
    let mut whole: Vec<Option<SystemSums>> =
        wanted.plans.iter().map(|plan| plan.as_ref().map(SystemPlan::empty)).collect();
    let assigner = Assigner::new(segmentation);
    reduce(
        source,
        &wanted.passed(source),
        rows.halo(),
        progress,
        || pass.start(),
        |part, chunk, block, range| {
            let episode = &source.episodes()[chunk.episode];
            if let (Some(pass), Some(sums)) = (&pass.moments, &mut part.moments) {
                pass.add(sums, episode, chunk, block, range.clone())?;
            }
            let mut evaluated = std::mem::take(&mut part.rows);
            let tile = rows.columns.evaluate(block, episode, range, &mut evaluated)?;
            part.counts.add(tile.counts());
            if !tile.is_empty() {
                part.add(&pass, &assigner, (chunk, block.first), &Tile::new(&tile));
            }
            part.rows = evaluated;
            Ok::<_, Error>(())
        },
        |chunk, mut part| {
            let episode = source.episodes()[chunk.episode].id;
            if let (Some(pass), Some(moments), Some(Some(sums))) =
                (&pass.moments, part.moments.take(), whole.first_mut())
            {
                pass.end(sums, episode, chunk, moments)?;
            }
            part.share(wanted.cuts.of(chunk).len());
            ranges.iter_mut().zip(&part.ranges).for_each(|(all, some)| all.merge(some));
            for piece in part.pieces {
                let chunk = &wanted.cuts.chunks[piece.chunk];
                if let (Some(all), Some(part)) = (&mut cell_sums, piece.cells) {
                    all.add(chunk.fold, part);
                }
                for (partition, grams) in piece.grams.into_iter().enumerate() {
                    for (region, gram) in grams.into_regions() {
                        let partition = partition as u16;
                        stats.add(Key { episode, chunk: chunk.index, fold: chunk.fold, partition, region }, gram);
                    }
                }
            }
            let unassigned = part.unassigned.into_iter().zip(part.ranges);
            for ((sums, grams), (unassigned, ranges)) in whole.iter_mut().zip(part.whole).zip(unassigned) {
                if let (Some(sums), Some(grams)) = (sums, grams) {
                    let episode_sums = EpisodeSums { counts: part.counts, unassigned, ranges };
                    sums.insert_chunk(episode, chunk, grams, part.also.clone(), episode_sums)?;
                }
            }
            Ok(())
        },
    )?;
    let gathered = wanted.plans.iter().zip(whole).map(|(plan, sums)| {
        plan.as_ref().zip(sums).map(|(plan, sums)| SystemScan::new(plan, &sums)).transpose().map_err(Error::from)
    });
    Ok(Scan { stats, whole: gathered.collect::<Result<_, Error>>()?, ranges, cells: cell_sums })
}

impl Pass<'_> {
    fn start(&self) -> Part {
        let partitions = 0..self.segmentation.partitions.len();
        // Regions that are made on all rows report the range of their training.
        let described = |p: usize| self.segmentation.candidates.iter().any(|candidate| candidate.full == p);
        let planned =
            |p: usize| self.wanted.plans.get(p).and_then(Option::as_ref).is_some_and(|plan| !plan.is_polynomial());
        let ranges = |p: usize| {
            RegionRanges::new(if described(p) || planned(p) { self.count(p) } else { 0 }, self.rows.regressors)
        };
        Part {
            whole: partitions.clone().map(|p| planned(p).then(|| RegionGrams::new(self.count(p)))).collect(),
            moments: self.moments.as_ref().map(SystemPass::start),
            counts: RowCounts::default(),
            rows: DesignRows::default(),
            unassigned: vec![0; partitions.len()],
            ranges: partitions.map(ranges).collect(),
            also: Gram::new(self.rows.targets + self.rows.states),
            pieces: Vec::new(),
            work: Vec::new(),
            regions: Vec::new(),
        }
    }

    /// Regions of a partition that are summed: those joined of cells have no separate sums.
    fn count(&self, partition: usize) -> usize {
        self.segmentation.partitions[partition].rule.count()
    }

    fn piece(&self, chunk: usize) -> Piece {
        let partitions = 0..self.segmentation.partitions.len();
        Piece {
            chunk,
            grams: partitions.map(|p| RegionGrams::new(if self.wanted.cut[p] { self.count(p) } else { 0 })).collect(),
            cells: (!self.cells.is_empty()).then(|| CellPart::new(&self.cells, self.rows.regressors)),
        }
    }

    /// The complete rows of a tile that are summed at once in a statistic of this plan.
    fn tiles(&self, partition: usize, tile: &Tile<'_>) -> Vec<Range<usize>> {
        let rows = self.wanted.plans.get(partition).and_then(Option::as_ref).map_or(TILE_ROWS, SystemPlan::tile_rows);
        let index = tile.index();
        let mut tiles = Vec::new();
        let mut from = 0;
        while from < index.len() {
            // Tiles begin at whole numbers of them in what was read.
            let end = index[from] / TILE_ROWS * TILE_ROWS + (index[from] % TILE_ROWS / rows + 1) * rows;
            let to = from + index[from..].partition_point(|&row| row < end);
            tiles.push(from..to);
            from = to;
        }
        tiles
    }
}

impl Part {
    fn add(&mut self, pass: &Pass<'_>, assigner: &Assigner<'_>, (chunk, first): (&Chunk, usize), tile: &Tile<'_>) {
        let one_piece = pass.wanted.cuts.of(chunk).len() == 1;
        let pieces = pass.wanted.cuts.pieces(chunk, first, tile.index());
        let pieces: Vec<(usize, Range<usize>)> =
            pieces.into_iter().map(|(chunk, rows)| (self.piece(pass, chunk), rows)).collect();
        let d = pass.rows.dimension();
        self.work.clear();
        self.work.extend_from_slice(tile.regression());
        pass.preconditioner.apply(MatMut::from_column_major_slice_mut(&mut self.work, tile.len(), d));
        let z = MatRef::from_column_major_slice(&self.work, tile.len(), d);
        let (assignment, regressors, weights) = (assigner.on(tile), tile.regressors(), tile.weights());
        let of =
            |rows: &Range<usize>| (z.subrows(rows.start, rows.len()), weights.map(|weights| &weights[rows.clone()]));
        for (at, rows) in &pieces {
            let piece = &mut self.pieces[*at];
            if let Some(cells) = &mut piece.cells {
                let ((z, weights), fold) = (of(rows), pass.wanted.cuts.chunks[piece.chunk].fold);
                let regressors = rows_of(&regressors, rows);
                cells.add((z, weights, fold), |set| &assignment.cells(set)[rows.clone()], &regressors);
            }
        }
        // The first partition is that of one region: the regions of another one can serve it.
        let mut summed = one_piece && self.whole.first().is_some_and(Option::is_some);
        for partition in (1..pass.segmentation.partitions.len()).filter(|&p| pass.count(p) > 0) {
            let one = pass.count(partition) == 1 && assigner.segmentation.labels[partition].is_none();
            if !one {
                assignment.assign(partition, &mut self.regions);
                self.unassigned[partition] += self.regions.iter().filter(|&&region| region == u32::MAX).count() as u64;
            }
            let regions = (!one).then_some(self.regions.as_slice());
            let region_of = |rows: &Range<usize>| regions.map(|regions| &regions[rows.clone()]);
            if let Some(grams) = &mut self.whole[partition] {
                for rows in pass.tiles(partition, tile) {
                    let (z, weights) = of(&rows);
                    grams.add(z, weights, region_of(&rows));
                }
            }
            if pass.wanted.cut[partition] && !(one_piece && self.whole[partition].is_some()) {
                for (at, rows) in &pieces {
                    let ((z, weights), Piece { grams, .. }) = (of(rows), &mut self.pieces[*at]);
                    let Some((whole, others)) = grams.split_first_mut() else { continue };
                    match region_of(rows).filter(|_| !summed) {
                        Some(regions) => others[partition - 1].add_with_whole(z, weights, regions, whole),
                        None => others[partition - 1].add(z, weights, region_of(rows)),
                    }
                }
                summed |= !one;
            }
            if !self.ranges[partition].0.is_empty() {
                self.ranges[partition].add(&regressors, regions);
            }
        }
        let also = tile.scales();
        for rows in pass.tiles(0, tile) {
            let (z, weights) = of(&rows);
            if let Some(Some(whole)) = self.whole.first_mut() {
                whole.add(z, weights, None);
            }
            self.also.merge(&Gram::of_columns(&rows_of(&also, &rows), weights));
        }
        if !summed {
            for (at, rows) in &pieces {
                let (z, weights) = of(rows);
                self.pieces[*at].grams[0].add(z, weights, None);
            }
        }
        if let Some(ranges) = self.ranges.first_mut().filter(|ranges| !ranges.0.is_empty()) {
            ranges.add(&regressors, None);
        }
    }

    /// The place of the piece in a chunk of the folds, which begins where it has rows.
    fn piece(&mut self, pass: &Pass<'_>, chunk: usize) -> usize {
        self.pieces.iter().position(|piece| piece.chunk == chunk).unwrap_or_else(|| {
            self.pieces.push(pass.piece(chunk));
            self.pieces.len() - 1
        })
    }

    /// A chunk that folds do not cut is its one piece.
    fn share(&mut self, pieces: usize) {
        let ([piece], 1) = (self.pieces.as_mut_slice(), pieces) else { return };
        for (gram, whole) in piece.grams.iter_mut().zip(&self.whole) {
            if let Some(whole) = whole.as_ref().filter(|_| gram.regions() > 0) {
                gram.clone_from(whole);
            }
        }
    }
}

//! The one pass over the rows.

use std::{
    collections::{BTreeSet, btree_map::Entry},
    ops::Range,
    sync::{Mutex, PoisonError},
};

use faer::{MatMut, MatRef};
use fleetfoot_data::{Block, Episode, EpisodeId, Halo, Progress, Source};
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_stats::{
    Chunk, Gram, Grid, Key, MergeError, PolynomialMoments, PolynomialScratch, reduce,
    scan::{RegionGrams, RowCounts, Tile},
};

use super::{
    EpisodeSums, System, SystemError, SystemPlan, SystemScan, SystemSums,
    columns::{Columns, REGRESSION, REGRESSORS, also, partition},
    plan::Coordinates,
    ranges::RangesScratch,
    weak::Weak,
    windows::WindowRows,
};

/// Rows of a chunk on which [`System::sampled`] is evaluated, its first ones.
const SAMPLED: usize = 128;

impl SystemPlan {
    /// Scans all rows of a source once, and gathers the sums for queries.
    ///
    /// The same rows give the same bits on any number of threads.
    ///
    /// # Errors
    /// Those of [`SystemPlan::sum_rows`] and [`SystemScan::new`].
    pub fn scan(&self, source: &dyn Source, progress: &dyn Progress) -> Result<SystemScan, SystemError> {
        SystemScan::new(self, &self.sum_rows(source, progress)?)
    }

    /// Scans all rows of a source once: sums that can be merged with those of other rows.
    ///
    /// # Errors
    /// As [`SystemPlan::sum_all`].
    pub fn sum_rows(&self, source: &dyn Source, progress: &dyn Progress) -> Result<SystemSums, SystemError> {
        Ok(Self::sum_all(&[self], source, progress)?.remove(0))
    }

    /// The sums of several plans. Plans of one chunk length share a pass over the rows; each gets the result of a
    /// separate pass, bit for bit.
    ///
    /// # Errors
    /// A column does not exist, the source cannot be read, a weight is negative, an episode is there twice, or the user stops it.
    pub fn sum_all(
        plans: &[&Self],
        source: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<Vec<SystemSums>, SystemError> {
        let mut sums: Vec<SystemSums> = plans.iter().map(|plan| plan.empty()).collect();
        let lengths: BTreeSet<usize> = plans.iter().map(|plan| plan.chunk_rows).collect();
        for chunk_rows in lengths {
            let places: Vec<usize> = (0..plans.len()).filter(|&at| plans[at].chunk_rows == chunk_rows).collect();
            let passes: Vec<SystemPass<'_>> =
                places.iter().map(|&at| SystemPass::new(plans[at], source)).collect::<Result<_, _>>()?;
            let chunks = Grid { chunk_rows }.chunks(source.episodes());
            reduce(
                source,
                &chunks,
                passes.iter().fold(Halo::default(), |halo, pass| widest(halo, pass.halo())),
                progress,
                || passes.iter().map(SystemPass::start).collect::<Vec<ChunkSums>>(),
                |parts, chunk, block, tile| {
                    let episode = &source.episodes()[chunk.episode];
                    let mut all = passes.iter().zip(parts);
                    all.try_for_each(|(pass, part)| pass.add(part, episode, chunk, block, tile.clone()))
                },
                |chunk, parts| {
                    let episode = source.episodes()[chunk.episode].id;
                    let mut all = places.iter().zip(&passes).zip(parts);
                    all.try_for_each(|((&at, pass), part)| pass.end(&mut sums[at], episode, chunk, part))
                        .map_err(SystemError::from)
                },
            )?;
        }
        Ok(sums)
    }
}

/// Halo that covers several designs.
fn widest(a: Halo, b: Halo) -> Halo {
    Halo { before: a.before.max(b.before), after: a.after.max(b.after) }
}

/// A plan on the columns of a source, chunk by chunk: for passes that sum more than it of the same rows.
pub struct SystemPass<'a> {
    plan: &'a SystemPlan,
    columns: Columns,
    sample: Sample,
    /// Memory of chunks that are done, for the next ones.
    spare: Mutex<Vec<Spare>>,
}

/// Working memory of a chunk, without meaning between calls.
#[derive(Default)]
struct Spare {
    moments: Option<(PolynomialScratch, RangesScratch)>,
    rows: DesignRows,
    windows: WindowRows,
    work: Vec<f64>,
}

impl<'a> SystemPass<'a> {
    /// Compiles the columns of a plan for a source.
    ///
    /// # Errors
    /// A column does not exist.
    pub fn new(plan: &'a SystemPlan, source: &dyn Source) -> Result<Self, SystemError> {
        let columns = Columns::compile(&plan.system, plan.regressors(), source)?;
        Ok(Self { plan, columns, sample: Sample::compile(&plan.system.sampled, source)?, spare: Mutex::default() })
    }

    /// Neighbouring rows that a row reaches for.
    pub fn halo(&self) -> Halo {
        widest(self.columns.halo(), self.sample.halo())
    }

    /// A chunk without rows.
    pub fn start(&self) -> ChunkSums {
        let spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
        ChunkSums::new(self.plan, &self.columns, spare.unwrap_or_default())
    }

    /// Adds a chunk that is done to the sums of the plan.
    ///
    /// # Errors
    /// A chunk that is there already.
    pub fn end(
        &self,
        sums: &mut SystemSums,
        episode: EpisodeId,
        chunk: &Chunk,
        mut part: ChunkSums,
    ) -> Result<(), MergeError> {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(std::mem::take(&mut part.spare));
        sums.insert(episode, chunk, part)
    }

    /// Adds the rows of a tile: core rows of a block.
    ///
    /// # Errors
    /// A negative weight, or a value whose squares overflow.
    pub fn add(
        &self,
        part: &mut ChunkSums,
        episode: &Episode,
        chunk: &Chunk,
        block: &Block,
        tile: Range<usize>,
    ) -> Result<(), SystemError> {
        if block.first + tile.start == chunk.rows.start {
            self.sample.add(&mut part.sampled, &mut part.spare.rows, block, tile.clone());
        }
        part.add_tile(self.plan, &self.columns, episode, block, tile)
    }
}

/// Expressions that are evaluated on the first rows of every chunk.
struct Sample(Option<Design>);

impl Sample {
    fn compile(expressions: &[Expr], source: &dyn Source) -> Result<Self, SystemError> {
        if expressions.is_empty() {
            return Ok(Self(None));
        }
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        Ok(Self(Some(Design::compile(expressions, &names)?)))
    }

    fn halo(&self) -> Halo {
        self.0.as_ref().map_or(Halo::default(), Design::halo)
    }

    /// Adds the first complete rows of the first tile of a chunk.
    fn add(&self, sampled: &mut Gram, rows: &mut DesignRows, block: &Block, tile: Range<usize>) {
        let Some(design) = &self.0 else { return };
        design.evaluate(block, tile.start..tile.end.min(tile.start + SAMPLED), rows);
        if rows.rows() > 0 {
            let values = MatRef::from_column_major_slice(&rows.values, rows.rows(), design.outputs());
            sampled.merge(&Gram::of_rows(values, None));
        }
    }
}

/// Sums of one chunk so far.
pub struct ChunkSums {
    sums: PartSums,
    also: Gram,
    sampled: Gram,
    summary: EpisodeSums,
    regions: Vec<u32>,
    spare: Spare,
}

/// The sums of a chunk.
enum PartSums {
    Grams(RegionGrams),
    Moments(PolynomialMoments),
}

impl ChunkSums {
    fn new(plan: &SystemPlan, columns: &Columns, spare: Spare) -> Self {
        let system = &plan.system;
        Self {
            sums: match &plan.coordinates {
                Coordinates::General(_) => PartSums::Grams(RegionGrams::new(system.regions())),
                Coordinates::Polynomial(polynomial) => PartSums::Moments(polynomial.plan.moments()),
            },
            also: Gram::new(system.also.len()),
            sampled: Gram::new(system.sampled.len()),
            summary: plan.no_rows(),
            regions: Vec::with_capacity(columns.tile_rows()),
            spare,
        }
    }

    /// Adds the rows of a tile, in parts that stay in cache.
    fn add_tile(
        &mut self,
        plan: &SystemPlan,
        columns: &Columns,
        episode: &Episode,
        block: &Block,
        tile: Range<usize>,
    ) -> Result<(), SystemError> {
        let tiles = tile.clone().step_by(columns.tile_rows());
        let mut tiles = tiles.map(|from| (from, (from + columns.tile_rows()).min(tile.end)));
        if let Some(weak) = &columns.weak {
            return tiles.try_for_each(|(from, to)| self.add_windows(plan, (columns, weak), episode, block, from..to));
        }
        let mut rows = std::mem::take(&mut self.spare.rows);
        for (from, to) in tiles {
            let tile = columns.rows.evaluate(block, episode, from..to, &mut rows)?;
            self.summary.counts.add(tile.counts());
            if !tile.is_empty() {
                self.add_rows(plan, columns, &mut rows);
            }
        }
        self.spare.rows = rows;
        Ok(())
    }

    fn add_rows(&mut self, plan: &SystemPlan, columns: &Columns, rows: &mut DesignRows) {
        let (n, d) = (rows.rows(), columns.dimension());
        let tile = columns.rows.tile(rows);
        self.assign(&plan.system, &tile);
        self.count_unassigned();
        let further = also(&tile);
        if !further.is_empty() {
            self.also.merge(&Gram::of_columns(&further, tile.weights()));
        }
        let regressors = tile.columns(REGRESSORS..REGRESSORS + 1);
        match (&plan.coordinates, &mut self.sums) {
            (Coordinates::Polynomial(polynomial), PartSums::Moments(moments)) => {
                let memory = || (polynomial.plan.scratch(), RangesScratch::default());
                let (scratch, ranges) = self.spare.moments.get_or_insert_with(memory);
                polynomial.add(moments, scratch, &tile.columns(REGRESSION), tile.weights());
                polynomial.ranges.add(&mut self.summary.ranges.0[0], &regressors, ranges);
            }
            (Coordinates::General(preconditioner), PartSums::Grams(_)) => {
                self.add_ranges(&regressors);
                // The tile is not needed in raw units any more.
                preconditioner.apply(MatMut::from_column_major_slice_mut(&mut rows.values[..d * n], n, d));
                let tile = columns.rows.tile(rows);
                self.add_products(MatRef::from_column_major_slice(tile.values(REGRESSION), n, d), tile.weights());
            }
            _ => unreachable!("a part sums what its plan says"),
        }
    }

    /// Adds the windows around the rows of a tile. Ranges and further moments are those of the rows.
    fn add_windows(
        &mut self,
        plan: &SystemPlan,
        (columns, weak): (&Columns, &Weak),
        episode: &Episode,
        block: &Block,
        tile: Range<usize>,
    ) -> Result<(), SystemError> {
        let mut windows = std::mem::take(&mut self.spare.windows);
        windows.evaluate((columns, weak), block, episode, tile)?;
        let n = windows.count();
        let counts = RowCounts { complete: n as u64, at_border: windows.at_border, incomplete: windows.incomplete };
        self.summary.counts.add(counts);
        let (rows, owned_windows) = (columns.rows.tile(&windows.rows), windows.of_tile.clone());
        let of_tile = |columns: Vec<&'_ [f64]>| -> Vec<Vec<f64>> {
            columns.into_iter().map(|column| column[owned_windows.clone()].to_vec()).collect()
        };
        let further = of_tile(also(&rows));
        if !further.is_empty() && !owned_windows.is_empty() {
            let further: Vec<&[f64]> = further.iter().map(Vec::as_slice).collect();
            self.also.merge(&Gram::of_columns(&further, rows.weights().map(|weights| &weights[owned_windows.clone()])));
        }
        self.assign(&plan.system, &rows);
        let of_rows = std::mem::take(&mut self.regions);
        self.regions = of_rows.get(owned_windows.clone()).map(<[u32]>::to_vec).unwrap_or_default();
        let functions: Vec<&[f64]> =
            rows.columns(REGRESSORS..REGRESSORS + 1).into_iter().map(|column| &column[owned_windows.clone()]).collect();
        self.add_ranges(&functions);
        self.regions = if of_rows.is_empty() { of_rows } else { windows.regions(weak, &of_rows) };
        self.count_unassigned();
        if let (Coordinates::General(preconditioner), 1..) = (&plan.coordinates, n) {
            let d = columns.dimension();
            preconditioner.apply(MatMut::from_column_major_slice_mut(&mut windows.values, n, d));
            let weights = Some(windows.weights.as_slice()).filter(|weights| !weights.is_empty());
            self.add_products(MatRef::from_column_major_slice(&windows.values, n, d), weights);
        }
        self.spare.windows = windows;
        Ok(())
    }

    fn add_products(&mut self, z: MatRef<'_, f64>, weights: Option<&[f64]>) {
        if let PartSums::Grams(grams) = &mut self.sums {
            grams.add(z, weights, regions(&self.regions));
        }
    }

    /// Names the region of every row; empty where there is only one.
    fn assign(&mut self, system: &System, tile: &Tile<'_>) {
        self.regions.clear();
        let Some(rule) = system.partition.as_ref().filter(|partition| !partition.columns.is_empty()) else {
            return;
        };
        self.regions.resize(tile.len(), 0);
        rule.assign(&partition(tile), &mut self.spare.work, &mut self.regions);
    }

    fn count_unassigned(&mut self) {
        self.summary.unassigned += self.regions.iter().filter(|&&region| region == u32::MAX).count() as u64;
    }

    fn add_ranges(&mut self, functions: &[&[f64]]) {
        self.summary.ranges.add(functions, regions(&self.regions));
    }
}

/// Regions of the rows; `None` if there is one region only.
fn regions(labels: &[u32]) -> Option<&[u32]> {
    (!labels.is_empty()).then_some(labels)
}

impl SystemSums {
    fn insert(&mut self, episode: EpisodeId, chunk: &Chunk, part: ChunkSums) -> Result<(), MergeError> {
        let key = |region: u32| Key { episode, chunk: chunk.index, fold: chunk.fold, partition: 0, region };
        if part.sampled.rows > 0 {
            self.sampled.insert(key(0), part.sampled)?;
        }
        match part.sums {
            PartSums::Moments(moments) => {
                if moments.rows() > 0 {
                    self.moments.insert(key(0), moments)?;
                }
                self.insert_chunk(episode, chunk, RegionGrams::new(0), part.also, part.summary)
            }
            PartSums::Grams(grams) => self.insert_chunk(episode, chunk, grams, part.also, part.summary),
        }
    }

    /// Adds the sums of a chunk that a pass of other columns has made beside its sums. They are Gram matrices of the
    /// regions, in the coordinates of the plan, and raw moments of [`System::also`].
    ///
    /// # Errors
    /// A chunk that is there already.
    pub fn insert_chunk(
        &mut self,
        episode: EpisodeId,
        chunk: &Chunk,
        grams: RegionGrams,
        also: Gram,
        summary: EpisodeSums,
    ) -> Result<(), MergeError> {
        let key = |region: u32| Key { episode, chunk: chunk.index, fold: chunk.fold, partition: 0, region };
        for (region, gram) in grams.into_regions().filter(|(_, gram)| gram.rows > 0) {
            self.grams.insert(key(region), gram)?;
        }
        self.also.insert(key(0), also)?;
        match self.episodes.entry(episode) {
            Entry::Occupied(mut all) => all.get_mut().add(&summary),
            Entry::Vacant(slot) => _ = slot.insert(summary),
        }
        Ok(())
    }
}

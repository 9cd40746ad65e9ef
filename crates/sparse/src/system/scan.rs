//! The one pass over the rows.

use std::{
    collections::{BTreeSet, btree_map::Entry},
    ops::Range,
};

use faer::{MatMut, MatRef};
use fleetfoot_data::{Block, EpisodeId, Halo, Progress, Source};
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_stats::{Chunk, Gram, Grid, Key, MergeError, PolynomialMoments, PolynomialScratch, reduce};

use super::{
    EpisodeSums, System, SystemError, SystemPlan, SystemScan, SystemSums,
    columns::{Columns, Tile, slices},
    plan::Coordinates,
    ranges::{RangesScratch, extremes},
    weak::Weak,
    windows::WindowRows,
};

/// Rows of a chunk on which [`System::sampled`] is evaluated, its first ones.
const SAMPLED: usize = 128;

impl SystemPlan {
    /// Scans all rows of a source once, and gathers what was found for questions.
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

    /// The sums of several plans. Plans of one chunk length share a pass over the rows; each finds what it finds alone, bit for bit.
    ///
    /// # Errors
    /// A column does not exist, the source cannot be read, a weight is negative, an episode is there twice, or the user stops it.
    pub fn sum_all(
        plans: &[&Self],
        source: &dyn Source,
        progress: &dyn Progress,
    ) -> Result<Vec<SystemSums>, SystemError> {
        let mut found: Vec<SystemSums> = plans.iter().map(|plan| plan.empty()).collect();
        let lengths: BTreeSet<usize> = plans.iter().map(|plan| plan.chunk_rows).collect();
        for chunk_rows in lengths {
            let places: Vec<usize> = (0..plans.len()).filter(|&at| plans[at].chunk_rows == chunk_rows).collect();
            let passes: Vec<Pass<'_>> =
                places.iter().map(|&at| Pass::new(plans[at], source)).collect::<Result<_, _>>()?;
            let chunks = Grid { chunk_rows }.chunks(source.episodes());
            reduce(
                source,
                &chunks,
                passes.iter().fold(Halo::default(), |halo, pass| widest(halo, pass.halo())),
                progress,
                || passes.iter().map(Pass::start).collect::<Vec<Part>>(),
                |parts, chunk, block, tile| {
                    let episode = &source.episodes()[chunk.episode].name;
                    let mut all = passes.iter().zip(parts);
                    all.try_for_each(|(pass, part)| pass.add(part, episode, chunk, block, tile.clone()))
                },
                |chunk, parts| {
                    let episode = source.episodes()[chunk.episode].id;
                    let mut all = places.iter().zip(parts);
                    all.try_for_each(|(&at, part)| found[at].insert(episode, chunk, part)).map_err(SystemError::from)
                },
            )?;
        }
        Ok(found)
    }
}

/// What several designs need.
fn widest(a: Halo, b: Halo) -> Halo {
    Halo { before: a.before.max(b.before), after: a.after.max(b.after) }
}

/// A plan on the columns of a source.
struct Pass<'a> {
    plan: &'a SystemPlan,
    columns: Columns,
    sample: Sample,
}

impl<'a> Pass<'a> {
    fn new(plan: &'a SystemPlan, source: &dyn Source) -> Result<Self, SystemError> {
        let columns = Columns::compile(&plan.system, plan.regressors(), source)?;
        Ok(Self { plan, columns, sample: Sample::compile(&plan.system.sampled, source)? })
    }

    fn halo(&self) -> Halo {
        widest(self.columns.halo(), self.sample.halo())
    }

    fn start(&self) -> Part {
        Part::new(self.plan, &self.columns)
    }

    fn add(
        &self,
        part: &mut Part,
        episode: &str,
        chunk: &Chunk,
        block: &Block,
        tile: Range<usize>,
    ) -> Result<(), SystemError> {
        if block.first + tile.start == chunk.rows.start {
            self.sample.add(&mut part.sampled, &mut part.rows, block, tile.clone());
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
            sampled.merge(&Gram::of_columns(&slices(&rows.values, design.outputs()), None));
        }
    }
}

/// What one chunk has found so far.
struct Part {
    sums: PartSums,
    also: Gram,
    sampled: Gram,
    told: EpisodeSums,
    rows: DesignRows,
    windows: WindowRows,
    regions: Vec<u32>,
}

/// The sums of a chunk.
enum PartSums {
    /// Gram matrix of every region that has rows.
    Grams(Vec<Option<Gram>>),
    Moments(Box<(PolynomialMoments, PolynomialScratch, RangesScratch)>),
}

impl Part {
    fn new(plan: &SystemPlan, columns: &Columns) -> Self {
        let system = &plan.system;
        Self {
            sums: match &plan.coordinates {
                Coordinates::General(_) => PartSums::Grams(vec![None; system.regions()]),
                Coordinates::Polynomial(polynomial) => PartSums::Moments(Box::new((
                    polynomial.plan.moments(),
                    polynomial.plan.scratch(),
                    RangesScratch::default(),
                ))),
            },
            also: Gram::new(system.also.len()),
            sampled: Gram::new(system.sampled.len()),
            told: plan.no_rows(),
            rows: DesignRows::default(),
            windows: WindowRows::default(),
            regions: Vec::with_capacity(columns.tile_rows()),
        }
    }

    /// Adds the rows of a tile, in parts that stay in cache.
    fn add_tile(
        &mut self,
        plan: &SystemPlan,
        columns: &Columns,
        episode: &str,
        block: &Block,
        tile: Range<usize>,
    ) -> Result<(), SystemError> {
        let tiles = tile.clone().step_by(columns.tile_rows());
        let mut tiles = tiles.map(|from| (from, (from + columns.tile_rows()).min(tile.end)));
        if let Some(weak) = &columns.weak {
            return tiles.try_for_each(|(from, to)| self.add_windows(plan, (columns, weak), episode, block, from..to));
        }
        let mut rows = std::mem::take(&mut self.rows);
        for (from, to) in tiles {
            columns.evaluate(block, episode, from..to, &mut rows)?;
            self.told.counts.complete += rows.rows() as u64;
            self.told.counts.at_border += rows.at_border;
            self.told.counts.incomplete += rows.incomplete;
            if rows.rows() > 0 {
                self.add_rows(plan, columns, &mut rows);
            }
        }
        self.rows = rows;
        Ok(())
    }

    fn add_rows(&mut self, plan: &SystemPlan, columns: &Columns, rows: &mut DesignRows) {
        let (n, d) = (rows.rows(), columns.dimension());
        let tile = columns.split(rows);
        self.assign(&plan.system, &tile, n);
        self.count_unassigned();
        if !tile.also.is_empty() {
            let also = slices(tile.also, plan.system.also.len());
            self.also.merge(&Gram::of_columns(&also, tile.weights));
        }
        let regression = slices(tile.regression, d);
        match (&plan.coordinates, &mut self.sums) {
            (Coordinates::Polynomial(polynomial), PartSums::Moments(sums)) => {
                let (moments, scratch, ranges) = &mut **sums;
                polynomial.add(moments, scratch, &regression, tile.weights);
                polynomial.ranges.add(&mut self.told.ranges[0], &regression[..columns.regressors], ranges);
            }
            (Coordinates::General(preconditioner), PartSums::Grams(_)) => {
                self.add_ranges(&regression[..columns.regressors]);
                // The tile is not needed in raw units any more.
                preconditioner.apply(MatMut::from_column_major_slice_mut(&mut rows.values[..d * n], n, d));
                let tile = columns.split(rows);
                self.add_products(MatRef::from_column_major_slice(tile.regression, n, d), tile.weights);
            }
            _ => unreachable!("a part sums what its plan says"),
        }
    }

    /// Adds the windows around the rows of a tile. Ranges and further moments are those of the rows.
    fn add_windows(
        &mut self,
        plan: &SystemPlan,
        (columns, weak): (&Columns, &Weak),
        episode: &str,
        block: &Block,
        tile: Range<usize>,
    ) -> Result<(), SystemError> {
        let mut windows = std::mem::take(&mut self.windows);
        windows.evaluate((columns, weak), block, episode, tile)?;
        let n = windows.count();
        self.told.counts.complete += n as u64;
        self.told.counts.at_border += windows.at_border;
        self.told.counts.incomplete += windows.incomplete;
        let (rows, own) = (columns.split(&windows.rows), windows.own.clone());
        let of_tile = |values: &[f64], count: usize| -> Vec<Vec<f64>> {
            slices(values, count).into_iter().map(|column| column[own.clone()].to_vec()).collect()
        };
        let also = of_tile(rows.also, plan.system.also.len());
        if !also.is_empty() && !own.is_empty() {
            let also: Vec<&[f64]> = also.iter().map(Vec::as_slice).collect();
            self.also.merge(&Gram::of_columns(&also, rows.weights.map(|weights| &weights[own.clone()])));
        }
        self.assign(&plan.system, &rows, windows.rows.rows());
        let of_rows = std::mem::take(&mut self.regions);
        self.regions = of_rows.get(own.clone()).map(<[u32]>::to_vec).unwrap_or_default();
        let functions = slices(rows.regression, columns.dimension());
        let functions: Vec<&[f64]> =
            functions[..columns.regressors].iter().map(|column| &column[own.clone()]).collect();
        self.add_ranges(&functions);
        self.regions = if of_rows.is_empty() { of_rows } else { windows.regions(weak, &of_rows) };
        self.count_unassigned();
        if let (Coordinates::General(preconditioner), 1..) = (&plan.coordinates, n) {
            let d = columns.dimension();
            preconditioner.apply(MatMut::from_column_major_slice_mut(&mut windows.values, n, d));
            let weights = Some(windows.weights.as_slice()).filter(|weights| !weights.is_empty());
            self.add_products(MatRef::from_column_major_slice(&windows.values, n, d), weights);
        }
        self.windows = windows;
        Ok(())
    }

    fn add_products(&mut self, z: MatRef<'_, f64>, weights: Option<&[f64]>) {
        let PartSums::Grams(grams) = &mut self.sums else {
            return;
        };
        if self.regions.is_empty() {
            merge(&mut grams[0], Gram::of_rows(z, weights));
        } else {
            for (region, gram) in Gram::by_region(z, weights, &self.regions, grams.len()) {
                merge(&mut grams[region as usize], gram);
            }
        }
    }

    /// Names the region of every row; empty where there is only one.
    fn assign(&mut self, system: &System, tile: &Tile<'_>, n: usize) {
        self.regions.clear();
        let Some(partition) = system.partition.as_ref().filter(|partition| !partition.columns.is_empty()) else {
            return;
        };
        self.regions.resize(n, 0);
        let mut z: Vec<Vec<f64>> =
            slices(tile.partition, partition.columns.len()).into_iter().map(<[f64]>::to_vec).collect();
        partition.standardise(&mut z.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>());
        partition.rule.assign(&z.iter().map(Vec::as_slice).collect::<Vec<_>>(), &mut self.regions);
    }

    fn count_unassigned(&mut self) {
        self.told.unassigned += self.regions.iter().filter(|&&region| region == u32::MAX).count() as u64;
    }

    fn add_ranges(&mut self, functions: &[&[f64]]) {
        if self.regions.is_empty() {
            extremes(functions, &mut self.told.ranges[0]);
            return;
        }
        for (function, values) in functions.iter().enumerate() {
            for (&region, &value) in self.regions.iter().zip(*values) {
                if let Some(ranges) = self.told.ranges.get_mut(region as usize) {
                    let range = &mut ranges[function];
                    *range = [range[0].min(value), range[1].max(value)];
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

impl SystemSums {
    fn insert(&mut self, episode: EpisodeId, chunk: &Chunk, part: Part) -> Result<(), MergeError> {
        let key =
            |region: usize| Key { episode, chunk: chunk.index, fold: chunk.fold, partition: 0, region: region as u32 };
        match part.sums {
            PartSums::Moments(sums) if sums.0.rows() > 0 => self.moments.insert(key(0), sums.0)?,
            PartSums::Moments(_) => {}
            PartSums::Grams(grams) => {
                for (region, gram) in grams.into_iter().enumerate() {
                    if let Some(gram) = gram.filter(|gram| gram.rows > 0) {
                        self.grams.insert(key(region), gram)?;
                    }
                }
            }
        }
        self.also.insert(key(0), part.also)?;
        if part.sampled.rows > 0 {
            self.sampled.insert(key(0), part.sampled)?;
        }
        match self.episodes.entry(episode) {
            Entry::Occupied(mut told) => told.get_mut().add(&part.told),
            Entry::Vacant(slot) => _ = slot.insert(part.told),
        }
        Ok(())
    }
}

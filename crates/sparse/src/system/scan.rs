//! The one pass over the rows.

use std::ops::Range;

use faer::{MatMut, MatRef};
use fleetfoot_data::{Block, Progress, Source};
use fleetfoot_library::DesignRows;
use fleetfoot_stats::{Bank, Chunk, Gram, Grid, PolynomialBank, PolynomialMoments, PolynomialScratch, reduce};

use crate::structured::RowCounts;

use super::{
    System, SystemError, SystemPlan, SystemScan, Unit,
    columns::{Columns, Tile, slices},
    plan::Coordinates,
    ranges::{EMPTY, RangesScratch, extremes, widen},
    statistic::{Region, Sums},
};

impl SystemPlan {
    /// Scans all rows of a source once.
    ///
    /// The same rows give the same bits on any number of threads.
    ///
    /// # Errors
    /// A column does not exist, the source cannot be read, a weight is negative, sums overflow, or the user stops it.
    pub fn scan(&self, source: &dyn Source, progress: &dyn Progress) -> Result<SystemScan, SystemError> {
        let columns = Columns::compile(&self.system, self.regressors(), source)?;
        let chunks = Grid { chunk_rows: self.chunk_rows }.chunks(source.episodes());
        let mut found = Found::new(&self.system);
        reduce(
            source,
            &chunks,
            columns.halo(),
            progress,
            || Part::new(self, &columns),
            |part, chunk, block, tile| {
                part.add_tile(self, &columns, &source.episodes()[chunk.episode].name, block, tile)
            },
            |chunk, part| {
                found.insert(source, chunk, part);
                Ok::<_, SystemError>(())
            },
        )?;
        found.finish(self)
    }
}

/// What one chunk has found so far.
struct Part {
    sums: PartSums,
    ranges: Vec<Vec<[f64; 2]>>,
    also: Gram,
    counts: RowCounts,
    unassigned: u64,
    rows: DesignRows,
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
            ranges: no_ranges(system),
            also: Gram::new(system.also.len()),
            counts: RowCounts::default(),
            unassigned: 0,
            rows: DesignRows::default(),
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
        let mut rows = std::mem::take(&mut self.rows);
        for from in tile.clone().step_by(columns.tile_rows()) {
            let to = (from + columns.tile_rows()).min(tile.end);
            columns.evaluate(block, episode, from..to, &mut rows)?;
            self.counts.complete += rows.rows() as u64;
            self.counts.at_border += rows.at_border;
            self.counts.incomplete += rows.incomplete;
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
        if !tile.also.is_empty() {
            let also = slices(tile.also, plan.system.also.len());
            self.also.merge(&Gram::of_columns(&also, tile.weights));
        }
        let regression = slices(tile.regression, d);
        match (&plan.coordinates, &mut self.sums) {
            (Coordinates::Polynomial(polynomial), PartSums::Moments(sums)) => {
                let (moments, scratch, ranges) = &mut **sums;
                polynomial.add(moments, scratch, &regression, tile.weights);
                polynomial.ranges.add(&mut self.ranges[0], &regression[..columns.regressors], ranges);
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
        self.unassigned += self.regions.iter().filter(|&&region| region == u32::MAX).count() as u64;
    }

    fn add_ranges(&mut self, functions: &[&[f64]]) {
        if self.regions.is_empty() {
            extremes(functions, &mut self.ranges[0]);
            return;
        }
        for (function, values) in functions.iter().enumerate() {
            for (&region, &value) in self.regions.iter().zip(*values) {
                if let Some(ranges) = self.ranges.get_mut(region as usize) {
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

fn no_ranges(system: &System) -> Vec<Vec<[f64; 2]>> {
    vec![vec![EMPTY; system.functions.len()]; system.regions()]
}

/// What all chunks have found, in their order.
struct Found {
    units: Vec<Unit>,
    /// Units and Gram matrices of every region.
    regions: Vec<(Vec<usize>, Vec<Gram>)>,
    /// Moments of every unit.
    moments: Vec<PolynomialMoments>,
    ranges: Vec<Vec<[f64; 2]>>,
    also: Gram,
    counts: RowCounts,
    unassigned: u64,
}

impl Found {
    fn new(system: &System) -> Self {
        Self {
            units: Vec::new(),
            regions: vec![(Vec::new(), Vec::new()); system.regions()],
            moments: Vec::new(),
            ranges: no_ranges(system),
            also: Gram::new(system.also.len()),
            counts: RowCounts::default(),
            unassigned: 0,
        }
    }

    fn insert(&mut self, source: &dyn Source, chunk: &Chunk, part: Part) {
        let rows = match &part.sums {
            PartSums::Grams(grams) => grams.iter().flatten().map(|gram| gram.rows).sum(),
            PartSums::Moments(sums) => sums.0.rows(),
        };
        if rows > 0 {
            let unit = self.units.len();
            self.units.push(Unit { episode: source.episodes()[chunk.episode].id, chunk: chunk.index, rows });
            match part.sums {
                PartSums::Moments(sums) => self.moments.push(sums.0),
                PartSums::Grams(grams) => {
                    for ((members, all), gram) in self.regions.iter_mut().zip(grams) {
                        if let Some(gram) = gram.filter(|gram| gram.rows > 0) {
                            members.push(unit);
                            all.push(gram);
                        }
                    }
                }
            }
        }
        self.ranges.iter_mut().zip(&part.ranges).for_each(|(all, some)| widen(all, some));
        self.also.merge(&part.also);
        self.counts.complete += part.counts.complete;
        self.counts.at_border += part.counts.at_border;
        self.counts.incomplete += part.counts.incomplete;
        self.unassigned += part.unassigned;
    }

    fn finish(self, plan: &SystemPlan) -> Result<SystemScan, SystemError> {
        let regions = match &plan.coordinates {
            Coordinates::General(_) => self
                .regions
                .into_iter()
                .zip(self.ranges)
                .map(|((members, grams), ranges)| Region { members, sums: Sums::Grams(Bank::new(&grams)), ranges })
                .collect(),
            Coordinates::Polynomial(polynomial) => vec![Region {
                members: (0..self.units.len()).collect(),
                sums: Sums::Moments(Box::new(polynomial.plan.clone()), PolynomialBank::new(&self.moments)),
                ranges: polynomial.ranges.in_order(&self.ranges[0]),
            }],
        };
        let scan = SystemScan {
            functions: plan.system.functions.len(),
            constant: None,
            units: self.units,
            regions,
            preconditioner: plan.coordinates.preconditioner().clone(),
            also: self.also,
            counts: self.counts,
            unassigned: self.unassigned,
        };
        match scan.widest_overflow() {
            Some((function, [least, most])) => {
                let function = plan.system.functions.get(function).unwrap_or(&plan.system.targets[0]).to_string();
                Err(SystemError::Overflow { function, least, most })
            }
            None => Ok(scan),
        }
    }
}

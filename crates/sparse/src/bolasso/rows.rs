//! Bootstrap of rows: one pass, in which the Grams of all replicates are one product a tile.

use std::sync::{Mutex, PoisonError};

use faer::{Accum, Mat, MatMut, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::{Progress, Source, packed, packed_row, parallel_map};
use fleetfoot_library::Expr;
use fleetfoot_stats::{
    Grid,
    scan::{self, Place, scan},
};

use super::{
    BolassoError, BootstrapOptions, Selection,
    counts::PoissonCounts,
    pairs::Pairs,
    resample::{Frame, Sums, scale, spread, triangle_of},
    tile::{Library, Pool, Tile},
};
use crate::{
    SparseError,
    kernel::Slab,
    structured::{Assembly, penalty},
};
use fleetfoot_sums::structured::{Plan, Regression, ScanError};

/// Bolasso with replicates of rows, drawn with replacement (Algorithm 1 of the block-sparse bolasso paper, equation (20); Bach 2008): Poisson(1) counts for
/// each row, so that n varies from replicate to replicate by sqrt(n), and the objective has the replicate's own n.
///
/// With E the products of pairs of columns (rows x q) and W the counts (rows x b), all replicates' Grams are E'W: one matrix product a tile, in one pass
/// whatever b is. Every latent's functions are first made near-orthonormal by the triangle of a QR of a sample (not centred), couplings multiply
/// afterwards: so the Grams do not lose the square of a library's condition number, which is 1e7 for powers of physical signals.
///
/// Rows with a missing value are left out, as in [`Plan::scan`]. Task weights are those of the whole, column scales are recomputed for each replicate. A
/// count is a function of seed, episode, row and replicate alone: neither chunks, nor files, nor threads, nor b change it. The rows of a log are
/// correlated; [`block_bootstrap`](crate::bolasso::block_bootstrap) resamples what is not.
///
/// # Errors
/// When an option is out of range, the assembly does not fit, the source cannot be read, a weight is negative, no row is complete, or the user stops it.
pub fn row_bootstrap(
    plan: &Plan,
    assembly: &Assembly,
    source: &dyn Source,
    options: &BootstrapOptions,
    progress: &dyn Progress,
) -> Result<Selection, BolassoError> {
    options.check()?;
    let penalty = penalty(&plan.regression.structure(), assembly)?;
    let columns = Columns::new(plan, assembly, source)?;
    let stride = PoissonCounts::stride(options.replicates);
    let sums = accumulate(plan, &columns, source, options.seed, stride, progress)?;
    let frame = columns.frame(assembly, penalty);
    let results = parallel_map(options.replicates, progress, |replicate| {
        let sums: Vec<f64> = (0..columns.outputs()).map(|column| sums[column * stride + replicate]).collect();
        columns
            .sums(&sums, assembly.raw)
            .map(|(products, weight, scale)| {
                Ok::<_, BolassoError>(frame.fit(&Sums { weight, products: &products, scale }, options.lambda, None)?)
            })
            .transpose()
    })?;
    Selection::of(&results, plan.regression.coefficients(), options.threshold)
}

/// A column whose square, and whose sum where it is centred, give a scale.
#[derive(Debug, Clone)]
struct Scaled {
    task: usize,
    column: usize,
    expression: Expr,
    /// Subtracted; 0 where scales are about zero.
    centre: f64,
}

/// Columns to evaluate, and their products.
struct Columns {
    pairs: Pairs,
    libraries: Vec<Library>,
    /// Task weight, prior or not, centred or not.
    tasks: Vec<(f64, bool, bool)>,
    /// Latents whose scales are not in the blocks: those that have priors beside measured tasks, or deviations about a mean.
    scaled: Vec<Scaled>,
    centres: Vec<f64>,
    /// First coefficient of every latent, and p.
    first: Vec<usize>,
    size: f64,
    rows: scan::Columns,
}

impl Columns {
    fn new(plan: &Plan, assembly: &Assembly, source: &dyn Source) -> Result<Self, BolassoError> {
        let regression = &plan.regression;
        let shape = regression.structure();
        // Raw coefficients have no use for scales.
        let mut scaled = if assembly.raw { Vec::new() } else { scaled_columns(regression) };
        let pilot = Pilot::read(regression, &scaled, source)?;
        let size = pilot.target_size(regression, assembly);
        for (at, scaled) in scaled.iter_mut().enumerate() {
            scaled.centre = if shape.tasks[scaled.task].centred { pilot.centre(regression, at) } else { 0.0 };
        }
        let pairs = Pairs::new(regression, assembly, size);
        let libraries = Library::sequence(pairs.libraries.iter().enumerate().map(|(library, functions)| {
            let latent = pairs.library_of.iter().position(|&of| of == library).unwrap_or(0);
            pilot.triangle(regression, latent, functions.len())
        }));
        // Memory of a complete row beside the products: every coefficient and target, and the needs of the scan.
        let terms = regression.tasks.iter().flat_map(|task| task.terms.iter().map(|term| &term.coefficient));
        let others = terms.chain(regression.tasks.iter().map(|task| &task.target)).chain(&plan.also);
        let expressions: Vec<Expr> = pairs.libraries[..pairs.libraries.len() - 1]
            .iter()
            .flatten()
            .chain(&pairs.coefficients)
            .chain(scaled.iter().map(|scaled| &scaled.expression))
            .chain(others)
            .cloned()
            .collect();
        let rows =
            scan::Columns::compile(&[&expressions], regression.weight.as_ref(), source).map_err(ScanError::from)?;
        Ok(Self {
            tasks: shape.tasks.iter().zip(&assembly.weights).map(|(task, &s)| (s, task.prior, task.centred)).collect(),
            first: (0..=regression.latents.len()).map(|latent| regression.first(latent)).collect(),
            pairs,
            libraries,
            centres: scaled.iter().map(|scaled| scaled.centre).collect(),
            scaled,
            size,
            rows,
        })
    }

    /// Columns of E: pairs, then squares, then values of the scaled columns.
    fn outputs(&self) -> usize {
        self.pairs.columns + 2 * self.scaled.len()
    }

    fn frame<'a>(&self, assembly: &'a Assembly, penalty: crate::Penalty) -> Frame<'a> {
        let latents = self.first.len() - 1;
        let p = self.first[latents];
        let mut triangle = Mat::zeros(p + 1, p + 1);
        let mut unit = vec![1.0; p];
        for latent in 0..latents {
            let library = &self.libraries[self.pairs.library_of[latent]];
            let first = self.first[latent];
            for j in 0..library.functions() {
                let column = library.column(j);
                unit[first + j] = crate::kernel::norm(column.iter().copied());
                column.iter().enumerate().for_each(|(i, t)| triangle[(first + i, first + j)] = t / unit[first + j]);
            }
        }
        triangle[(p, p)] = 1.0;
        Frame::new(triangle, unit, self.size, assembly, penalty)
    }

    /// Packed products, n and column scales from a replicate's sums; `None` when it has no rows.
    fn sums(&self, sums: &[f64], raw: bool) -> Option<(Vec<f64>, f64, Vec<f64>)> {
        let p = *self.first.last()?;
        let weight = sums[0];
        if weight.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let mut products = vec![0.0; packed_row(p + 1)];
        for block in &self.pairs.blocks {
            for &([k, l], factor) in &block.places {
                for i in 0..self.pairs.libraries[block.libraries[0]].len() {
                    for j in 0..self.pairs.libraries[block.libraries[1]].len() {
                        let (row, column) = (self.first[k] + i, self.first[l] + j);
                        let at = packed(row, column);
                        products[at] = factor * sums[self.pairs.column(block, i, j)];
                    }
                }
            }
        }
        let scale = if raw { vec![1.0; p] } else { self.scales(&products, sums, weight) };
        Some((products, weight, scale))
    }

    fn scales(&self, products: &[f64], sums: &[f64], weight: f64) -> Vec<f64> {
        let p = self.first[self.first.len() - 1];
        let (mut measured, mut believed) = (vec![0.0; p], vec![0.0; p]);
        for (latent, pair) in self.first.windows(2).enumerate() {
            let library = &self.libraries[self.pairs.library_of[latent]];
            for j in pair[0]..pair[1] {
                measured[j] = library.square(j - pair[0], |a, b| products[packed(pair[0] + a, pair[0] + b)]) / weight;
            }
        }
        // The scale of these latents does not come from the blocks.
        self.scaled.iter().for_each(|scaled| measured[scaled.column] = 0.0);
        let squares = self.pairs.columns;
        for (at, scaled) in self.scaled.iter().enumerate() {
            let (factor, prior, centred) = self.tasks[scaled.task];
            let (square, sum) = (sums[squares + at], sums[squares + self.scaled.len() + at]);
            let target = if prior { &mut believed } else { &mut measured };
            let square = if centred { spread(square, sum, weight, scaled.centre) } else { square / weight };
            target[scaled.column] += factor * square;
        }
        (0..p).map(|j| scale(measured[j], believed[j]).unwrap_or(1.0)).collect()
    }
}

/// The columns of latents whose scales the blocks do not hold.
fn scaled_columns(regression: &Regression) -> Vec<Scaled> {
    let shape = regression.structure();
    let mut scaled = Vec::new();
    for latent in 0..regression.latents.len() {
        let tasks: Vec<usize> =
            (0..shape.tasks.len()).filter(|&task| shape.tasks[task].latents.contains(&latent)).collect();
        let mixed = tasks.iter().any(|&task| shape.tasks[task].prior != shape.tasks[tasks[0]].prior);
        if !mixed && tasks.iter().all(|&task| !shape.tasks[task].centred) {
            continue;
        }
        for task in tasks {
            let columns = regression.columns(task);
            for (expression, column) in columns.into_iter().zip(shape.columns(task)) {
                if shape.range(latent).contains(&column) {
                    scaled.push(Scaled { task, column, expression, centre: 0.0 });
                }
            }
        }
    }
    scaled
}

/// A sample of complete rows: functions of all latents, targets, scaled columns.
struct Pilot {
    rows: usize,
    values: Vec<Vec<f64>>,
}

impl Pilot {
    fn read(regression: &Regression, scaled: &[Scaled], source: &dyn Source) -> Result<Self, BolassoError> {
        let functions = regression.latents.iter().flat_map(|latent| &latent.functions);
        let targets = regression.tasks.iter().map(|task| &task.target);
        let scaled = scaled.iter().map(|scaled| &scaled.expression);
        let expressions: Vec<Expr> = functions.chain(targets).chain(scaled).cloned().collect();
        let columns = scan::Columns::compile(&[&expressions], None, source).map_err(ScanError::from)?;
        let values = columns.pilot::<BolassoError>(0..1, source)?;
        Ok(Self { rows: values.first().map_or(0, Vec::len), values })
    }

    /// Root of the weighted mean square of the targets.
    fn target_size(&self, regression: &Regression, assembly: &Assembly) -> f64 {
        let targets = &self.values[regression.coefficients()..];
        let length = |(values, weight): (&Vec<f64>, &f64)| weight.sqrt() * crate::kernel::norm(values.iter().copied());
        let lengths: Vec<f64> = targets.iter().zip(&assembly.weights).map(length).collect();
        let size = crate::kernel::norm(lengths.iter().copied()) / (self.rows as f64).sqrt();
        if size > 0.0 && size.is_finite() { size } else { 1.0 }
    }

    /// The mean of a scaled column; its value, to the bit, where it is constant.
    fn centre(&self, regression: &Regression, at: usize) -> f64 {
        let values = &self.values[regression.coefficients() + regression.tasks.len() + at];
        match values.first() {
            Some(&first) if values.iter().all(|&value| value == first) => first,
            Some(_) => values.iter().map(|value| value / values.len() as f64).sum(),
            None => 0.0,
        }
    }

    /// The triangle of the functions of a latent; of the target's library, 1.
    fn triangle(&self, regression: &Regression, latent: usize, functions: usize) -> Mat<f64> {
        if latent == regression.latents.len() {
            return Mat::from_fn(1, 1, |_, _| 1.0);
        }
        let values = &self.values[regression.first(latent)..];
        triangle_of(Slab::from_fn(self.rows, functions, |i, j| values[j][i]), self.rows as f64)
    }
}

/// E'W over all rows: `stride` sums a column of E.
fn accumulate(
    plan: &Plan,
    columns: &Columns,
    source: &dyn Source,
    seed: u64,
    stride: usize,
    progress: &dyn Progress,
) -> Result<Vec<f64>, BolassoError> {
    let chunks = Grid { chunk_rows: plan.chunk_rows }.chunks(source.episodes());
    let mut total = vec![0.0; columns.outputs() * stride];
    // Tiles and sums of chunks that are done serve the next ones: they are written before they are read.
    let pool = Mutex::new(Vec::<Part>::new());
    let back = || pool.lock().unwrap_or_else(PoisonError::into_inner);
    scan(
        &columns.rows,
        source,
        &chunks,
        progress,
        || {
            let mut part = back().pop().unwrap_or_else(|| Part::new(columns, stride));
            part.sums.fill(0.0);
            part
        },
        |part, place, tile| {
            part.add(columns, place, tile, seed);
            Ok::<_, BolassoError>(())
        },
        |_, _, part| {
            total.iter_mut().zip(&part.sums).for_each(|(total, sum)| *total += sum);
            back().push(part);
            Ok(())
        },
    )?;
    if let Some(column) = (0..columns.outputs()).find(|&column| !total[column * stride].is_finite()) {
        // Finite columns whose products are not.
        return Err(SparseError::ColumnNotFinite { column: columns.owner(column) }.into());
    }
    Ok(total)
}

impl Columns {
    /// A coefficient that a column of E belongs to.
    fn owner(&self, column: usize) -> usize {
        let block = self.pairs.blocks.iter().rev().find(|block| block.first <= column);
        let latent = block.and_then(|block| block.places.first()).map_or(0, |([k, _], _)| *k);
        match column.checked_sub(self.pairs.columns) {
            Some(at) => self.scaled[at % self.scaled.len()].column,
            None => self.first[latent].min(self.first[self.first.len() - 1].saturating_sub(1)),
        }
    }
}

/// The sums of a chunk, and what is needed to make them.
struct Part {
    stride: usize,
    /// W'E (stride x q).
    sums: Vec<f64>,
    tile: Tile,
    counts: Vec<f64>,
}

impl Part {
    fn new(columns: &Columns, stride: usize) -> Self {
        Self { stride, sums: vec![0.0; columns.outputs() * stride], tile: Tile::default(), counts: Vec::new() }
    }

    fn add(&mut self, columns: &Columns, place: Place<'_>, tile: &scan::Tile<'_>, seed: u64) {
        let (rows, weights) = (tile.rows(), tile.weights());
        let counts = PoissonCounts::new(seed, place.episode);
        // Parts of equal length: a short last one would cost nearly as much as a whole one.
        let parts = rows.rows().div_ceil(MULTIPLIED).max(1);
        let pool = Pool { pairs: &columns.pairs, libraries: &columns.libraries, centres: &columns.centres };
        for part in 0..parts {
            let range = part * rows.rows() / parts..(part + 1) * rows.rows() / parts;
            if range.is_empty() {
                continue;
            }
            let n = range.len();
            self.tile.fill(&pool, rows, weights, range.clone());
            self.counts.resize(n * self.stride, 0.0);
            counts.fill(&rows.index[range], place.first, self.stride, &mut self.counts);
            let w = MatRef::from_column_major_slice(&self.counts, self.stride, n);
            let e = MatRef::from_column_major_slice(self.tile.values(), n, columns.outputs());
            let sums = MatMut::from_column_major_slice_mut(&mut self.sums, self.stride, columns.outputs());
            matmul(sums, Accum::Add, w, e, 1.0, Par::Seq);
        }
    }
}

/// Rows that are multiplied at once: E's share of them stays in the second-level cache.
const MULTIPLIED: usize = 320;

//! Simulation error over many coefficients, J'J never formed, near to the coefficients that it begins with.
//!
//! The objective over the coefficients theta, with theta_1 those of one step, is
//!
//! ```text
//! F(theta) = |r(theta)|^2 + tau |theta - theta_1|_H^2
//! ```
//!
//! with H the normal matrix of one step, by blocks of the coefficients that a latent has in a region. The second term
//! is tau times the growth of the one-step error. With more coefficients, more directions depend on few segments, and
//! there the model stays near that of one step. A path of falling tau begins each time at the end of the one before.
//!
//! A trial step minimises `|r + J s|^2 + tau |theta + s - theta_1|_H^2` over a Krylov subspace of `H^-1 J'J`, from the
//! gradient on, within a region of trust `|s|_H <= radius`. These are the steps of truncated conjugate gradients,
//! preconditioned by H (Steihaug, The conjugate gradient method and trust regions in large scale optimization, 1983). A
//! direction of the subspace is one product `J'J v`, one pass over the rows, for which a part of the segments suffices
//! (Byrd, Chin, Neveitt and Nocedal, On the use of stochastic Hessian information in optimization methods for machine
//! learning, 2011). A step that is refused is tried again, shorter, in the same subspace. H is the preconditioner, the
//! metric of trust and that of the prior.
//!
//! A model may have to keep within a convex set ([`Hold`]). The quadratic model is then minimised in the set by
//! spectral projected gradients in the metric H, one product `J'J v` a direction. A trial step goes towards their end
//! point, as far as the radius allows: all points on that way are of the set.

// Matrices are capitals.
#![allow(non_snake_case)]

mod plan;

use std::{collections::BTreeMap, ops::Range};

use faer::{Mat, Side};
use fleetfoot_data::{Block, Progress, Source};
use fleetfoot_dynamics::{Coefficient, NormalBlocks, Products, Shooting};
use fleetfoot_model::Model;
use fleetfoot_stats::{Chunk, Grid, kernel::norm, reduce};

use super::{Simulated, SimulationOptions, model_at};
use crate::{EstimateError, Status, descent::radius_after};

/// Numbers in the blocks of H, of which every chunk in flight has a copy in the first pass: 128 MiB.
pub const MOST_PRODUCTS: usize = 1 << 24;
/// Options of a fit of many coefficients.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ManyOptions {
    /// Weights tau of the one-step error, falling, in squares of the steps of a segment: the growth of an error over N
    /// steps.
    pub weights: Vec<f64>,
    /// Trial steps of every weight, at most.
    pub trials: usize,
    /// Directions from which a step is made, at most; each is one pass over the rows.
    pub directions: usize,
    /// Relative reduction of F below which a weight is done.
    pub reduction: f64,
    /// Residuals per coefficient that determine the curvature of a step, about. Of more segments one of so many is
    /// taken, and counts for them. The sum of squares and its derivative are those of all.
    pub sample: f64,
}

/// Largest thinning of the segments that determine the curvature.
const SPARSEST: f64 = 16.0;

impl Default for ManyOptions {
    fn default() -> Self {
        Self { weights: vec![0.1, 0.01, 0.001], trials: 3, directions: 8, reduction: 1e-3, sample: 200.0 }
    }
}

impl ManyOptions {
    /// Passes over the rows, at most.
    pub fn passes(&self) -> usize {
        1 + self.weights.len() * self.trials * (self.directions + 1)
    }
}

/// A convex set of models.
pub trait Hold: Sync {
    /// The model of the set that is nearest by the normal matrix of one step, which has a row more for every block.
    /// `None` without such a model.
    fn nearest(&self, model: &Model, normal: &NormalBlocks) -> Option<Model>;
}

/// The models of least simulation error and prior, one a weight, the heaviest first.
pub(super) fn path(
    model: &Model,
    source: &dyn Source,
    options: &SimulationOptions,
    hold: Option<&dyn Hold>,
    progress: &dyn Progress,
) -> Result<Vec<Simulated>, EstimateError> {
    let coefficients = match hold {
        None => Coefficient::support(model),
        Some(_) => in_use(model),
    };
    let blocks = NormalBlocks::new(&coefficients);
    let products = blocks.blocks().map(|(range, _)| range.len().pow(2)).sum();
    if products > MOST_PRODUCTS {
        return Err(EstimateError::TooManyCoefficients { count: products, most: MOST_PRODUCTS });
    }
    let mut rows = Rows { model, coefficients, source, options, progress, passes: 0, every: 1 };
    let start: Vec<f64> = rows.coefficients.iter().map(|coefficient| coefficient.value(model)).collect();
    let (before, normal) = rows.begin(&start, blocks)?;
    if before.sums.residuals < start.len() as u64 {
        return Err(EstimateError::TooFewRows { residuals: before.sums.residuals, parameters: start.len() });
    }
    if let Some((episode, row)) = before.broken {
        return Err(EstimateError::NotFinite { episode: source.episodes()[episode].name.clone(), row });
    }
    let residuals = before.sums.residuals as f64 / start.len() as f64;
    rows.every = (residuals / options.many.sample).clamp(1.0, SPARSEST) as usize;
    let normal = raised(normal, &rows.coefficients, before.sums.segments * options.shooting.steps as u64);
    let metric = Metric::new(&normal).ok_or(EstimateError::Overflow)?;
    let first = before.sums.clone();
    let radius = options.descent.radius * norm(metric.up(&start)).max(f64::MIN_POSITIVE);
    let held = hold.map(|hold| (hold, &normal));
    let mut descent =
        Near { rows, metric: &metric, held, theta: start.clone(), start: &start, at: before.sums, tau: 0.0, radius };
    let mut solutions = Vec::with_capacity(options.many.weights.len());
    for weight in &options.many.weights {
        descent.tau = weight * (options.shooting.steps as f64).powi(2);
        let status = descent.run()?;
        let at = &descent.at;
        solutions.push(Simulated {
            model: model_at(model, &descent.rows.coefficients, &descent.theta),
            coefficients: descent.rows.coefficients.clone(),
            segments: first.segments,
            missing: before.missing,
            ended: [first.ended, at.ended],
            cost: [first.square, at.square],
            residuals: first.residuals,
            gradient: descent.certificate(),
            weight: Some(*weight),
            status,
            passes: descent.rows.passes,
        });
    }
    Ok(solutions)
}

/// The numbers of functions that a model uses somewhere, zeros among them: a member of the set may have other zeros.
fn in_use(model: &Model) -> Vec<Coefficient> {
    let used = |coefficient: &Coefficient| {
        let library = model.latents[coefficient.latent].library;
        coefficient
            .function
            .is_none_or(|j| model.latents.iter().any(|latent| latent.library == library && latent.map.has(j)))
    };
    Coefficient::all(model).into_iter().filter(used).collect()
}

/// The segments of a source, read pass by pass.
struct Rows<'a> {
    model: &'a Model,
    coefficients: Vec<Coefficient>,
    source: &'a dyn Source,
    options: &'a SimulationOptions,
    progress: &'a dyn Progress,
    passes: usize,
    /// Thinning of the segments that determine the curvature.
    every: usize,
}

/// One pass.
#[derive(Clone)]
struct Pass {
    sums: Products,
    normal: Option<NormalBlocks>,
    missing: u64,
    /// The episode and first row of a tile in which a number is not finite.
    broken: Option<(usize, usize)>,
}

impl Rows<'_> {
    /// Sums over the segments, and the normal matrix of one step.
    fn begin(&mut self, theta: &[f64], blocks: NormalBlocks) -> Result<(Pass, NormalBlocks), EstimateError> {
        let mut sums = self.pass(theta, None, Some(&blocks))?;
        let normal = sums.normal.take().unwrap_or(blocks);
        Ok((sums, normal))
    }

    /// `J'r` and `r'r`; `None` where a number is not finite.
    fn residuals(&mut self, theta: &[f64]) -> Result<Option<Products>, EstimateError> {
        let sums = self.pass(theta, None, None)?;
        Ok(sums.broken.is_none().then_some(sums.sums))
    }

    /// `J'J v` and `|J v|^2`, of as many segments as there are in all.
    fn along(&mut self, theta: &[f64], direction: &[f64], segments: u64) -> Result<Products, EstimateError> {
        let mut sums = self.pass(theta, Some(direction), None)?.sums;
        let share = segments as f64 / sums.segments.max(1) as f64;
        sums.back.iter_mut().for_each(|value| *value *= share);
        sums.square *= share;
        Ok(sums)
    }

    fn pass(
        &mut self,
        theta: &[f64],
        direction: Option<&[f64]>,
        blocks: Option<&NormalBlocks>,
    ) -> Result<Pass, EstimateError> {
        self.passes += 1;
        let model = model_at(self.model, &self.coefficients, theta);
        let shooting = Shooting::new(&model, self.source, &self.coefficients, &self.options.shooting)?;
        let every = if direction.is_some() { self.every } else { 1 };
        let chunks = Grid { chunk_rows: self.options.descent.chunk_rows }.chunks(self.source.episodes());
        let empty = || Pass { sums: Products::new(theta.len()), normal: blocks.cloned(), missing: 0, broken: None };
        let mut total = empty();
        reduce(
            self.source,
            &chunks,
            shooting.halo(),
            self.progress,
            empty,
            |pass, chunk, block, tile| {
                pass.add(&shooting, chunk, block, (tile, every), direction);
                Ok::<_, EstimateError>(())
            },
            |_, pass| {
                total.merge(&pass);
                Ok(())
            },
        )?;
        Ok(total)
    }
}

impl Pass {
    fn add(
        &mut self,
        shooting: &Shooting<'_>,
        chunk: &Chunk,
        block: &Block,
        (tile, every): (Range<usize>, usize),
        direction: Option<&[f64]>,
    ) {
        if let Some(normal) = &mut self.normal {
            shooting.normal(chunk.episode, block, tile.clone(), normal);
        }
        let place = (chunk.episode, block.first + tile.start);
        self.missing += shooting.products(chunk.episode, block, (tile, every), direction, &mut self.sums);
        if !self.sums.finite || !self.sums.back.iter().all(|value| value.is_finite()) {
            self.broken.get_or_insert(place);
        }
    }

    fn merge(&mut self, other: &Self) {
        self.sums.merge(&other.sums);
        if let (Some(normal), Some(other)) = (&mut self.normal, &other.normal) {
            normal.merge(other);
        }
        self.missing += other.missing;
        self.broken = self.broken.or(other.broken);
    }
}

/// The normal matrix with a row more for every block, in which every function stands at the root of its mean square
/// over all rows. In a region with fewer values than that, coefficients stay.
fn raised(normal: NormalBlocks, coefficients: &[Coefficient], rows: u64) -> NormalBlocks {
    let name = |at: usize| (coefficients[at].latent, coefficients[at].function);
    let mut totals = BTreeMap::new();
    for (range, values) in normal.blocks() {
        let m = range.len();
        range.enumerate().for_each(|(i, at)| *totals.entry(name(at)).or_insert(0.0) += values[i * (m + 1)]);
    }
    normal.raised(|at| Some(totals[&name(at)] / rows as f64).filter(|&square| square > 0.0).unwrap_or(1.0))
}

/// H, by its factors: `H = L L'`, block by block.
struct Metric {
    blocks: Vec<(Range<usize>, Mat<f64>)>,
}

impl Metric {
    /// `None` where a number is not finite.
    fn new(normal: &NormalBlocks) -> Option<Self> {
        let factor = |(range, values): (Range<usize>, &[f64])| {
            let block = Mat::from_fn(range.len(), range.len(), |i, j| values[i * range.len() + j]);
            Some((range, block.llt(Side::Lower).ok()?.L().to_owned()))
        };
        Some(Self { blocks: normal.blocks().map(factor).collect::<Option<_>>()? })
    }

    fn each(&self, values: &[f64], of: impl Fn(&Mat<f64>, &mut Mat<f64>)) -> Vec<f64> {
        let mut out = vec![0.0; values.len()];
        for (range, L) in &self.blocks {
            let mut part = Mat::from_fn(range.len(), 1, |i, _| values[range.start + i]);
            of(L, &mut part);
            out[range.clone()].copy_from_slice(part.col_as_slice(0));
        }
        out
    }

    /// `L' x`: the vector whose length is that of x by H.
    fn up(&self, x: &[f64]) -> Vec<f64> {
        self.each(x, |L, x| *x = L.transpose() * &*x)
    }

    /// `L^-T z`, back.
    fn down(&self, z: &[f64]) -> Vec<f64> {
        self.each(z, |L, z| L.transpose().solve_upper_triangular_in_place(z.as_mut()))
    }

    /// `L^-1 g`, of a gradient.
    fn slope(&self, g: &[f64]) -> Vec<f64> {
        self.each(g, |L, g| L.solve_lower_triangular_in_place(g.as_mut()))
    }

    /// `H x`.
    fn times(&self, x: &[f64]) -> Vec<f64> {
        self.each(x, |L, x| *x = L * (L.transpose() * &*x))
    }
}

/// State of a descent.
struct Near<'a> {
    rows: Rows<'a>,
    metric: &'a Metric,
    held: Option<(&'a dyn Hold, &'a NormalBlocks)>,
    start: &'a [f64],
    theta: Vec<f64>,
    /// The sums at theta.
    at: Products,
    tau: f64,
    radius: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Near<'_> {
    fn options(&self) -> &super::ManyOptions {
        &self.rows.options.many
    }

    /// F.
    fn cost(&self, theta: &[f64], at: &Products) -> f64 {
        let moved: Vec<f64> = theta.iter().zip(self.start).map(|(now, start)| now - start).collect();
        at.square + self.tau * self.metric.up(&moved).iter().map(|value| value * value).sum::<f64>()
    }

    /// Half the derivative of F.
    fn gradient(&self) -> Vec<f64> {
        let moved: Vec<f64> = self.theta.iter().zip(self.start).map(|(now, start)| now - start).collect();
        let pull = self.metric.times(&moved);
        self.at.back.iter().zip(pull).map(|(entry, pull)| entry + self.tau * pull).collect()
    }

    /// A bound of the certificate: the cosine of the angle between the residual of F and any direction of the
    /// coefficients that a latent has in a region. The length of the Jacobian along it is at least that of the prior.
    /// For a held model the step of projected gradients takes the place of the gradient.
    fn certificate(&self) -> f64 {
        let (gradient, cost) = (self.gradient(), self.cost(&self.theta, &self.at));
        let mut slope = self.metric.slope(&gradient);
        if self.held.is_some() {
            let step = self.metric.down(&slope);
            let there: Vec<f64> = self.theta.iter().zip(&step).map(|(now, step)| now - step / self.tau).collect();
            let Some(there) = self.nearest(&there) else { return 1.0 };
            let moved: Vec<f64> = self.theta.iter().zip(&there).map(|(now, there)| self.tau * (now - there)).collect();
            slope = self.metric.up(&moved);
        }
        let largest = |(range, _): &(Range<usize>, Mat<f64>)| norm(slope[range.clone()].iter().copied());
        let length = (self.tau * cost).sqrt();
        let greatest = self.metric.blocks.iter().map(largest).fold(0.0, f64::max);
        if length > 0.0 { (greatest / length).min(1.0) } else { 0.0 }
    }

    /// The nearest coefficients that are allowed.
    fn nearest(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let Some((hold, normal)) = self.held else { return Some(theta.to_vec()) };
        let coefficients = &self.rows.coefficients;
        let projected = hold.nearest(&model_at(self.rows.model, coefficients, theta), normal)?;
        Some(coefficients.iter().map(|coefficient| coefficient.value(&projected)).collect())
    }

    /// Steps until F falls by less than the tolerance.
    fn run(&mut self) -> Result<Status, EstimateError> {
        let mut trials = 0;
        loop {
            if trials == self.options().trials {
                return Ok(Status::Iterations);
            }
            let gradient = self.gradient();
            if gradient.iter().all(|&slope| slope == 0.0) {
                return Ok(Status::Gradient);
            }
            let cost = self.cost(&self.theta, &self.at);
            let plan = self.plan(&gradient)?;
            loop {
                fleetfoot_data::checkpoint();
                if trials == self.options().trials {
                    return Ok(Status::Iterations);
                }
                let (step, trial) = plan.step(self.metric, self.tau, self.radius)?;
                if trial.predicted.is_nan() || trial.predicted <= self.least() * cost {
                    return Ok(Status::Reduction);
                }
                trials += 1;
                let theta: Vec<f64> = self.theta.iter().zip(&step).map(|(now, step)| now + step).collect();
                let Some(after) = self.rows.residuals(&theta)? else {
                    self.radius = 0.25 * self.radius.min(trial.length);
                    continue;
                };
                let actual = 1.0 - self.cost(&theta, &after) / cost;
                let ratio = actual * cost / trial.predicted;
                let slope = (dot(&gradient, &step) / cost).min(0.0);
                self.radius = radius_after(self.radius, &trial, (ratio, actual), slope);
                if ratio >= 1e-4 {
                    (self.theta, self.at) = (theta, after);
                    if actual <= self.least() {
                        return Ok(Status::Reduction);
                    }
                    break;
                }
            }
        }
    }

    /// Relative reduction of F below which it is rounding.
    fn least(&self) -> f64 {
        self.options().reduction.max(4.0 * f64::EPSILON)
    }
}

//! Coefficients by simulation error: a model that runs free for some steps stays nearest to the recording.
//!
//! A model of least error one step ahead is not the one of least error many steps ahead: noise in the states that it is
//! fitted on shrinks its coefficients, and errors of steps add up. Here the coefficients minimise the sum of squares of
//! [`Shooting`]: segments of N steps, each from its measured beginning. Coefficients that are zero stay zero.
//!
//! A pass over the rows is a reduction of the segments' residuals r and their exact derivatives J into J'J, J'r and
//! r'r. The steps are those of every other least squares of this crate. J'J is made of the columns of J scaled to unit
//! length, and J'r is summed separately. Squaring costs digits of a step, which the next one takes back, and none of
//! the minimum.
//!
//! Beyond [`WHOLE_COEFFICIENTS`], and where a model has to keep within a set, J'J is never formed: `simulation/many.rs`.

mod many;

use std::ops::Range;

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::triangular::BlockStructure};
use fleetfoot_data::{Block, Progress, Source};
use fleetfoot_dynamics::{Coefficient, Segment, Shooting, ShootingOptions};
use fleetfoot_model::Model;
use fleetfoot_stats::{Chunk, Grid, reduce};

use crate::{
    EstimateError, Options, Status,
    descent::Descent,
    evaluate::{Evaluation, Objective, Pass},
    products::compressed,
};

pub use many::{Hold, MOST_PRODUCTS, ManyOptions};

/// Coefficients up to which J'J, of which every chunk in flight has one, is held whole: it takes 32 MiB at most.
pub const WHOLE_COEFFICIENTS: usize = 2_000;

/// Options of a fit by simulation error.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SimulationOptions {
    /// The segments.
    pub shooting: ShootingOptions,
    /// When the iteration ends; a trial step is one pass.
    pub descent: Options,
    /// Options of a fit of more coefficients than [`WHOLE_COEFFICIENTS`], or of a model that has to keep within a set.
    pub many: ManyOptions,
}

impl SimulationOptions {
    /// Segments of `steps` steps, 20 trial steps at most.
    pub fn new(steps: usize) -> Self {
        let descent = Options { gradient: 1e-8, step: 1e-8, cost: 1e-8, max_iterations: 20, ..Options::default() };
        Self { shooting: ShootingOptions::new(steps), descent, many: ManyOptions::default() }
    }

    /// Passes over the rows, at most, of so many coefficients; `held`: of a model that has to keep within a set.
    pub fn passes(&self, coefficients: usize, held: bool) -> usize {
        if held || coefficients > WHOLE_COEFFICIENTS { self.many.passes() } else { 1 + self.descent.max_iterations }
    }
}

/// A model of least simulation error.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Simulated {
    /// The model, with new coefficients; its training statistics are those of the model before.
    pub model: Model,
    /// The coefficients that were fitted.
    pub coefficients: Vec<Coefficient>,
    /// Segments.
    pub segments: u64,
    /// Segments left out because a value that they need is missing.
    pub missing: u64,
    /// Segments that ended early, of the model before and after.
    pub ended: [u64; 2],
    /// The sum of squares, of the model before and after.
    pub cost: [f64; 2],
    /// Numbers that were compared.
    pub residuals: u64,
    /// The certificate: the largest cosine of the angle between the residual and a column of the Jacobian. Of many
    /// coefficients it is a bound, over all directions of the coefficients that a latent has in a region, the prior
    /// among the residuals.
    pub gradient: f64,
    /// The weight of the prior ([`ManyOptions::weights`]); `None` of few coefficients, which have none.
    pub weight: Option<f64>,
    /// Why the iteration ended.
    pub status: Status,
    /// Passes over the rows.
    pub passes: usize,
}

/// Fits the coefficients of a model that are not zero to its simulations through segments of a source, whose columns are the model's.
///
/// Of more than [`WHOLE_COEFFICIENTS`] the model of the lightest prior. The same bits on any number of threads.
///
/// # Errors
/// Those of [`Shooting::new`]; a model without coefficients, or with too many that one latent has in one region; fewer residuals than coefficients; those of reading.
pub fn simulation_error(
    model: &Model,
    source: &dyn Source,
    options: &SimulationOptions,
    progress: &dyn Progress,
) -> Result<Simulated, EstimateError> {
    simulation_errors(model, source, options, None, progress)?.pop().ok_or(EstimateError::NoParameters)
}

/// [`simulation_error`] with a path of priors, the heaviest first, each from the end of the one before. With many
/// coefficients, or with `hold`, it gives one model a weight of [`ManyOptions::weights`], else one without a prior.
/// `passes` are those from the beginning of the path. A model that has to keep within a set begins in it.
///
/// # Errors
/// Those of [`simulation_error`].
pub fn simulation_errors(
    model: &Model,
    source: &dyn Source,
    options: &SimulationOptions,
    hold: Option<&dyn Hold>,
    progress: &dyn Progress,
) -> Result<Vec<Simulated>, EstimateError> {
    options.descent.check()?;
    let coefficients = Coefficient::support(model);
    match coefficients.len() {
        0 => Err(EstimateError::NoParameters),
        count if count > WHOLE_COEFFICIENTS || hold.is_some() => many::path(model, source, options, hold, progress),
        _ => Ok(vec![whole(model, coefficients, source, options, progress)?]),
    }
}

/// By J'J.
fn whole(
    model: &Model,
    coefficients: Vec<Coefficient>,
    source: &dyn Source,
    options: &SimulationOptions,
    progress: &dyn Progress,
) -> Result<Simulated, EstimateError> {
    let bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; coefficients.len()];
    let objective = Segments { model, coefficients, bounds, source, options, progress };
    let theta = objective.coefficients.iter().map(|coefficient| coefficient.value(model)).collect::<Vec<f64>>();
    let before = objective.sums(&theta)?;
    let at = objective.evaluation(&before)?.ok_or_else(|| before.not_finite(source))?;
    let mut descent = Descent::from(&objective, theta, at, &options.descent)?;
    let (status, steps) = descent.run()?;
    let gradient = descent.gradient(&descent.at, &descent.room());
    let (cost, after) = ([before.cost, descent.at.cost], objective.model_at(&descent.theta));
    let ended = [before.ended, descent.at.ended];
    Ok(Simulated {
        model: after,
        segments: before.segments,
        missing: before.missing,
        ended,
        cost,
        residuals: before.residuals,
        gradient,
        weight: None,
        status,
        passes: 1 + steps,
        coefficients: objective.coefficients,
    })
}

/// A model with other coefficients.
fn model_at(model: &Model, coefficients: &[Coefficient], theta: &[f64]) -> Model {
    let mut model = model.clone();
    coefficients.iter().zip(theta).for_each(|(coefficient, &value)| coefficient.set(&mut model, value));
    model
}

/// The segments of a source as a sum of squares over the coefficients of a model.
struct Segments<'a> {
    model: &'a Model,
    coefficients: Vec<Coefficient>,
    bounds: Vec<[f64; 2]>,
    source: &'a dyn Source,
    options: &'a SimulationOptions,
    progress: &'a dyn Progress,
}

impl Segments<'_> {
    fn model_at(&self, theta: &[f64]) -> Model {
        model_at(self.model, &self.coefficients, theta)
    }

    /// One pass.
    fn sums(&self, theta: &[f64]) -> Result<Sums, EstimateError> {
        let model = self.model_at(theta);
        let shooting = Shooting::new(&model, self.source, &self.coefficients, &self.options.shooting)?;
        let chunks = Grid { chunk_rows: self.options.descent.chunk_rows }.chunks(self.source.episodes());
        let mut total = Sums::new(theta.len());
        reduce(
            self.source,
            &chunks,
            shooting.halo(),
            self.progress,
            || Sums::new(theta.len()),
            |sums, chunk, block, tile| {
                sums.add(&shooting, chunk, block, tile);
                Ok::<_, EstimateError>(())
            },
            |_, sums| {
                total.merge(sums);
                Ok(())
            },
        )?;
        Ok(total)
    }

    /// Evaluation for a descent; `None` if a number is not finite.
    fn evaluation(&self, sums: &Sums) -> Result<Option<Evaluation>, EstimateError> {
        if sums.broken.is_some() {
            return Ok(None);
        }
        let (jacobian, rhs) = compressed(&sums.products, &sums.slope).ok_or(EstimateError::Overflow)?;
        Ok(Some(Evaluation {
            jacobian,
            rhs,
            cost: sums.cost,
            targets: sums.size,
            rows: sums.residuals,
            scores: Vec::new(),
            linear: Vec::new(),
            shares: Vec::new(),
            ended: sums.ended,
        }))
    }
}

impl Objective for Segments<'_> {
    fn bounds(&self) -> &[[f64; 2]] {
        &self.bounds
    }

    /// The sums count residuals.
    fn residuals(&self) -> usize {
        1
    }

    fn unknowns(&self) -> usize {
        self.coefficients.len()
    }

    fn evaluate(&self, theta: &[f64]) -> Result<Pass, EstimateError> {
        let sums = self.sums(theta)?;
        let evaluation = self.evaluation(&sums)?;
        Ok(evaluation.map_or_else(|| Pass::Refused(sums.not_finite(self.source)), Pass::Finite))
    }
}

/// Segments, summed.
struct Sums {
    /// J'J (p x p); the lower triangle counts.
    products: Mat<f64>,
    /// J'r (p).
    slope: Vec<f64>,
    /// r'r.
    cost: f64,
    size: f64,
    residuals: u64,
    segments: u64,
    ended: u64,
    missing: u64,
    /// The episode and first row of a tile in which a number is not finite.
    broken: Option<(usize, usize)>,
}

impl Sums {
    fn new(coefficients: usize) -> Self {
        Self {
            products: Mat::zeros(coefficients, coefficients),
            slope: vec![0.0; coefficients],
            cost: 0.0,
            size: 0.0,
            residuals: 0,
            segments: 0,
            ended: 0,
            missing: 0,
            broken: None,
        }
    }

    fn add(&mut self, shooting: &Shooting<'_>, chunk: &Chunk, block: &Block, tile: Range<usize>) {
        let place = (chunk.episode, block.first + tile.start);
        let missing = shooting.segments(chunk.episode, block, tile, |segment| {
            if segment.is_finite() {
                self.push(&segment);
            } else {
                self.broken.get_or_insert(place);
            }
        });
        self.missing += missing;
    }

    fn push(&mut self, segment: &Segment) {
        let (p, n) = (segment.active.len(), segment.residuals.len());
        self.segments += 1;
        self.ended += u64::from(segment.ended);
        self.residuals += n as u64;
        self.size += segment.size;
        self.cost += segment.residuals.iter().map(|r| r * r).sum::<f64>();
        if p * n == 0 {
            return;
        }
        let slopes = MatRef::from_column_major_slice(&segment.slopes, n, p);
        let mut products = Mat::<f64>::zeros(p, p);
        faer::linalg::matmul::triangular::matmul(
            products.as_mut(),
            BlockStructure::TriangularLower,
            Accum::Replace,
            slopes.transpose(),
            BlockStructure::Rectangular,
            slopes,
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
        for (b, &to) in segment.active.iter().enumerate() {
            let column = slopes.col(b);
            self.slope[to] += column.iter().zip(&segment.residuals).map(|(slope, r)| slope * r).sum::<f64>();
            let into = self.products.col_as_slice_mut(to);
            for (a, &from) in segment.active.iter().enumerate().skip(b) {
                into[from] += products[(a, b)];
            }
        }
    }

    fn merge(&mut self, other: Self) {
        for j in 0..self.slope.len() {
            let column = self.products.col_as_slice_mut(j)[j..].iter_mut();
            column.zip(&other.products.col_as_slice(j)[j..]).for_each(|(sum, value)| *sum += value);
        }
        self.slope.iter_mut().zip(&other.slope).for_each(|(sum, value)| *sum += value);
        self.cost += other.cost;
        self.size += other.size;
        self.residuals += other.residuals;
        self.segments += other.segments;
        self.ended += other.ended;
        self.missing += other.missing;
        self.broken = self.broken.or(other.broken);
    }

    fn not_finite(&self, source: &dyn Source) -> EstimateError {
        let (episode, row) = self.broken.unwrap_or_default();
        EstimateError::NotFinite { episode: source.episodes()[episode].name.clone(), row }
    }
}

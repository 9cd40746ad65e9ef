//! Levenberg-Marquardt with a region of trust (More, The Levenberg-Marquardt algorithm: implementation and theory, 1978).

use fleetfoot_stats::kernel::norm;

use crate::{
    EstimateError,
    evaluate::{Evaluation, Objective, Pass},
    search::search,
    step::{Region, Step, step},
};

/// When the iteration ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Largest cosine of the angle between the residual and a column of the Jacobian at a minimum.
    pub gradient: f64,
    /// Least step, relative to the parameters, both in units of their columns' lengths.
    pub step: f64,
    /// Relative reduction of the cost below which it is the gradient that decides.
    pub cost: f64,
    /// Trial steps at most; each is one pass over the rows.
    pub max_iterations: usize,
    /// Evaluations of a global search before the first step; 0 to begin at the initial values. Each is one pass over the
    /// rows. Ranges of the search are the bounds; without them it is centred at the initial values.
    pub search: usize,
    /// First radius of trust, relative to the initial parameters, both in units of their columns' lengths.
    pub radius: f64,
    /// Rows of a chunk, at most: the clustered covariance allows correlation within it.
    pub chunk_rows: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            gradient: 1e-12,
            step: 1e-13,
            cost: 1e-13,
            max_iterations: 500,
            search: 0,
            radius: 1.0,
            chunk_rows: 65_536,
        }
    }
}

/// Why the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// The residual is orthogonal to the columns of the Jacobian.
    Gradient,
    /// Neither the cost nor the gradient can be lowered any further: rounding.
    Cost,
    /// The step is as small as the option allows.
    Step,
    /// The residuals are zero up to the rounding of the targets.
    Zero,
    /// Another step lowers the cost by less than the share of the option.
    Reduction,
    /// As many steps as were allowed: this is not a minimum.
    Iterations,
}

impl Status {
    /// Returns true for a minimum.
    pub fn converged(self) -> bool {
        self != Self::Iterations
    }
}

impl Options {
    pub(crate) fn check(&self) -> Result<(), EstimateError> {
        let allowed = "it must be at least 0 and below 1";
        for (option, value) in [
            ("the gradient tolerance", self.gradient),
            ("the step tolerance", self.step),
            ("the cost tolerance", self.cost),
        ] {
            if !(0.0..1.0).contains(&value) {
                return Err(EstimateError::Option { option, value, allowed });
            }
        }
        if !(self.radius > 0.0 && self.radius.is_finite()) {
            let allowed = "it must be positive and finite";
            return Err(EstimateError::Option { option: "the radius", value: self.radius, allowed });
        }
        Ok(())
    }
}

/// The best point of a global search.
fn searched(objective: &dyn Objective, theta: Vec<f64>, evaluations: usize) -> Result<Vec<f64>, EstimateError> {
    let inside = |theta: &[f64]| objective.limits().map_or(theta.to_vec(), |limits| limits.pulled(theta));
    let found = search(objective.bounds(), theta, evaluations, |theta| {
        fleetfoot_data::checkpoint();
        Ok::<_, EstimateError>(match objective.evaluate(&inside(theta))? {
            Pass::Finite(at) => at.cost,
            Pass::Refused(_) => f64::INFINITY,
        })
    })?;
    Ok(inside(&found))
}

/// A gradient is lower when it is below this share of the one before. The iteration converges linearly if residuals are
/// large, and rounding does not go on falling.
const LOWER_GRADIENT: f64 = 0.95;

/// State of the iteration.
pub(crate) struct Descent<'a> {
    objective: &'a dyn Objective,
    options: &'a Options,
    pub(crate) theta: Vec<f64>,
    pub(crate) at: Evaluation,
    /// Lengths of the columns of the Jacobian, half of their remembered values (p).
    scale: Vec<f64>,
    radius: f64,
    /// True once a step was tried.
    started: bool,
}

impl<'a> Descent<'a> {
    /// # Errors
    /// When the parameters are refused, or there are fewer residuals than unknowns.
    pub(crate) fn new(
        objective: &'a dyn Objective,
        theta: Vec<f64>,
        options: &'a Options,
    ) -> Result<Self, EstimateError> {
        let theta = match options.search {
            0 => theta,
            evaluations => searched(objective, theta, evaluations)?,
        };
        match objective.evaluate(&theta)? {
            Pass::Finite(at) => Self::from(objective, theta, at, options),
            Pass::Refused(error) => Err(error),
        }
    }

    /// From parameters that are evaluated, without a search.
    pub(crate) fn from(
        objective: &'a dyn Objective,
        theta: Vec<f64>,
        at: Evaluation,
        options: &'a Options,
    ) -> Result<Self, EstimateError> {
        let residuals = at.rows * objective.residuals() as u64;
        if residuals < objective.unknowns() as u64 {
            return Err(EstimateError::TooFewRows { residuals, parameters: objective.unknowns() });
        }
        let scale = vec![0.0; theta.len()];
        let mut descent = Self { objective, options, scale, radius: 0.0, started: false, theta, at };
        descent.rescale();
        let size = descent.size();
        descent.radius = options.radius * if size > 0.0 { size } else { 1.0 };
        Ok(descent)
    }

    /// Steps until one of the reasons to end; the reason, and how many steps were tried.
    pub(crate) fn run(&mut self) -> Result<(Status, usize), EstimateError> {
        let mut iterations = 0;
        loop {
            if let Some(status) = self.done() {
                return Ok((status, iterations));
            }
            if iterations == self.options.max_iterations {
                return Ok((Status::Iterations, iterations));
            }
            iterations += 1;
            fleetfoot_data::checkpoint();
            if let Some(status) = self.advance()? {
                return Ok((status, iterations));
            }
        }
    }

    /// `|D theta|`.
    fn size(&self) -> f64 {
        norm(self.theta.iter().zip(&self.scale).map(|(theta, scale)| theta * scale))
    }

    /// Marquardt's scaling, with a memory that fades. To forget at once lets steps diverge at a plateau, where a column
    /// vanishes. Never to forget (as in MINPACK) holds back parameters whose columns were long far from the minimum.
    fn rescale(&mut self) {
        for (j, scale) in self.scale.iter_mut().enumerate() {
            *scale = (0.5 * *scale).max(norm(self.at.jacobian.col_as_slice(j).iter().copied()));
            if *scale == 0.0 || !scale.is_finite() {
                *scale = 1.0;
            }
        }
    }

    /// Least and greatest step of every parameter: none out of a bound that the gradient pushes against.
    pub(crate) fn room(&self) -> Vec<[f64; 2]> {
        let room = |(j, &[low, high]): (usize, &[f64; 2])| {
            let (theta, slope) = (self.theta[j], self.slope(&self.at, j));
            let pushed = (theta <= low && slope > 0.0) || (theta >= high && slope < 0.0);
            if pushed { [0.0; 2] } else { [low - theta, high - theta] }
        };
        self.objective.bounds().iter().enumerate().map(room).collect()
    }

    /// Half the derivative of the cost.
    fn slope(&self, at: &Evaluation, j: usize) -> f64 {
        at.jacobian.col_as_slice(j).iter().zip(&at.rhs).map(|(a, r)| a * r).sum()
    }

    /// The directions of the free parameters in which limits of matrices let nothing move.
    pub(crate) fn held(&self, lengths: &[f64], free: &[usize]) -> Vec<Vec<f64>> {
        let slopes: Vec<f64> = (0..self.theta.len()).map(|j| self.slope(&self.at, j)).collect();
        self.objective.limits().map_or_else(Vec::new, |limits| limits.pushed(&self.theta, &slopes, lengths, free).1)
    }

    /// The largest cosine between the residual and the columns of free parameters, without the part that limits push
    /// against.
    pub(crate) fn gradient(&self, at: &Evaluation, room: &[[f64; 2]]) -> f64 {
        self.gradient_at(&self.theta, at, room)
    }

    fn gradient_at(&self, theta: &[f64], at: &Evaluation, room: &[[f64; 2]]) -> f64 {
        if let Some(limits) = self.objective.limits() {
            let lengths: Vec<f64> =
                (0..room.len()).map(|j| norm(at.jacobian.col_as_slice(j).iter().copied())).collect();
            let free: Vec<usize> = (0..room.len()).filter(|&j| room[j][0] < room[j][1] && lengths[j] > 0.0).collect();
            let slopes: Vec<f64> = (0..room.len()).map(|j| self.slope(at, j)).collect();
            let (left, _) = limits.pushed(theta, &slopes, &lengths, &free);
            return left.iter().map(|slope| slope.abs()).fold(0.0, f64::max) / at.cost.sqrt();
        }
        let cosine = |j: usize| {
            let length = norm(at.jacobian.col_as_slice(j).iter().copied()) * at.cost.sqrt();
            if length > 0.0 { self.slope(at, j).abs() / length } else { 0.0 }
        };
        (0..room.len()).filter(|&j| room[j][0] < room[j][1]).map(cosine).fold(0.0, f64::max)
    }

    fn done(&self) -> Option<Status> {
        // 4 eps of every target.
        if self.at.cost <= (4.0 * f64::EPSILON).powi(2) * self.at.targets {
            return Some(Status::Zero);
        }
        (self.gradient(&self.at, &self.room()) <= self.options.gradient).then_some(Status::Gradient)
    }

    /// One trial step: taken or not, or the end.
    fn advance(&mut self) -> Result<Option<Status>, EstimateError> {
        let room = self.room();
        let region = Region { scale: &self.scale, radius: self.radius, room: &room };
        let mut trial = step(&self.at.jacobian, &self.at.rhs, &region)?;
        if let Some(limits) = self.objective.limits() {
            let theta: Vec<f64> = self.theta.iter().zip(&trial.step).map(|(theta, s)| theta + s).collect();
            if !limits.kept(&theta) {
                trial = limits.step(&self.at, &self.theta, &region, &trial);
            }
        }
        if !self.started {
            self.radius = self.radius.min(trial.reach.max(f64::MIN_POSITIVE));
            self.started = true;
        }
        let bounds = self.objective.bounds();
        let theta = self.theta.iter().zip(&trial.step).zip(bounds);
        let theta: Vec<f64> = theta.map(|((theta, s), [low, high])| (theta + s).clamp(*low, *high)).collect();
        let after = match self.objective.evaluate(&theta)? {
            Pass::Finite(after) if after.cost.is_finite() => after,
            _ => {
                self.radius = 0.25 * self.radius.min(trial.reach);
                return Ok((self.radius <= self.options.step * self.size()).then_some(Status::Step));
            }
        };
        let (predicted, actual) = (trial.predicted / self.at.cost, 1.0 - after.cost / self.at.cost);
        if predicted <= self.options.cost && actual.abs() <= 10.0 * self.options.cost {
            // Costs are equal up to rounding: a step is as good as the gradient that it leaves.
            let better = self.gradient_at(&theta, &after, &room) <= LOWER_GRADIENT * self.gradient(&self.at, &room);
            if better {
                self.accept(theta, after);
            }
            return Ok((!better).then_some(Status::Cost));
        }
        let ratio = if predicted > 0.0 { actual / predicted } else { 0.0 };
        self.adjust_radius(&trial, ratio, actual);
        let small = trial.length <= self.options.step * self.size();
        if ratio >= 1e-4 {
            self.accept(theta, after);
        }
        Ok((small || self.radius <= self.options.step * self.size()).then_some(Status::Step))
    }

    fn adjust_radius(&mut self, trial: &Step, ratio: f64, actual: f64) {
        let slope = if ratio <= 0.25 { norm_slope(self, trial) } else { 0.0 };
        self.radius = radius_after(self.radius, trial, (ratio, actual), slope);
    }

    fn accept(&mut self, theta: Vec<f64>, at: Evaluation) {
        (self.theta, self.at) = (theta, at);
        self.rescale();
    }
}

/// Shrinks the region where the model was poor, to where a parabola through both costs has its minimum; widens it where it was good. `actual` is the relative reduction of the cost,
/// `ratio` that over the predicted one, `slope` the relative slope of the cost along the step.
pub(crate) fn radius_after(radius: f64, trial: &Step, (ratio, actual): (f64, f64), slope: f64) -> f64 {
    if ratio <= 0.25 {
        let factor = if actual >= 0.0 { 0.5 } else { 0.5 * slope / (slope + 0.5 * actual) };
        factor.clamp(0.1, 0.5) * radius.min(10.0 * trial.reach)
    } else if ratio >= 0.75 || !trial.bounded {
        2.0 * trial.reach
    } else {
        radius
    }
}

/// Relative slope of the cost along the step, not positive: `r'J s / r'r`.
fn norm_slope(descent: &Descent<'_>, trial: &Step) -> f64 {
    let along: f64 = trial.step.iter().enumerate().map(|(j, s)| s * descent.slope(&descent.at, j)).sum();
    (along / descent.at.cost).min(0.0)
}

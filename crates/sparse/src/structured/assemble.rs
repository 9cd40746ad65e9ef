//! The surrogate single-task problem (equations (20) and (25)) from the statistics of its tasks; the block matrix is never formed.

use faer::Mat;
use fleetfoot_stats::SquareRoot;
use fleetfoot_sums::structured::Structure;

use crate::{
    Penalty, Quadratic, Sign, Solution, SparseError,
    kernel::{Slab, norm},
    penalty::check_strength,
    rows::compress,
};

/// Generalised Tikhonov regularisation: `lambda_t |Gamma (theta - prior)|^2` beside the sum of squares (equation (24), Q = Gamma' Gamma).
///
/// It is worth the rows `sqrt(lambda_t) Gamma` with the targets `sqrt(lambda_t) Gamma prior`. (Proposition 7.1 prints `lambda_t Gamma`, whose square would
/// weigh `lambda_t^2`.)
#[derive(Debug, Clone, PartialEq)]
pub struct Tikhonov {
    /// lambda_t.
    pub strength: f64,
    /// Gamma (m x p).
    pub gamma: Mat<f64>,
    /// Prior mean of the coefficients (p).
    pub prior: Vec<f64>,
}

/// Weights and penalties by which tasks are combined.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Assembly {
    /// Weight s_t of the squared errors of every task (tasks): 1 over the square of its scale; of a prior, lambda_t over that.
    pub weights: Vec<f64>,
    /// Penalty factor of every latent relative to lambda (latents; empty: 1): lambda_k / lambda_s of Proposition 6.1; 0 is not penalised.
    pub latents: Vec<f64>,
    /// Penalty factor of every coefficient (p; empty: 1), times that of its latent.
    pub factors: Vec<f64>,
    /// Signs (p; empty: free).
    pub signs: Vec<Sign>,
    /// Penalise coefficients in raw units instead of in those of their columns' scale over the measured tasks.
    pub raw: bool,
    /// Prior on the coefficients themselves.
    pub tikhonov: Option<Tikhonov>,
}

/// The surrogate problem `1/(2n) |Y - B theta|^2`, n = rows (all tasks of a row are one row), no intercept.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Assembled {
    /// In the coefficients `theta_j scale_j`.
    pub problem: Quadratic,
    /// Factors and signs for the solvers.
    pub penalty: Penalty,
    /// Scale of every coefficient's column (p): root mean square over the measured tasks with their weights (about the mean where tasks have a
    /// constant; the constant's is its own size), over those of priors for a latent that no measured task has; 1 for columns that are zero.
    pub scale: Vec<f64>,
}

impl Assembled {
    /// Coefficients theta (p) of a solution of [`Assembled::problem`].
    pub fn coefficients(&self, solution: &Solution) -> Vec<f64> {
        let mut theta = vec![0.0; self.scale.len()];
        solution.support.iter().zip(&solution.coefficients).for_each(|(&j, &value)| theta[j] = value / self.scale[j]);
        theta
    }
}

/// The surrogate problem of tasks known by their square-root forms, in raw units: one a task, with the columns of [`Structure::columns`] and one target.
///
/// # Errors
/// When lengths disagree, a weight is negative, there are no rows, or a statistic is not finite.
pub fn assemble(structure: &Structure, roots: &[SquareRoot], assembly: &Assembly) -> Result<Assembled, SparseError> {
    let penalty = penalty(structure, assembly)?;
    check(structure, roots)?;
    let p = structure.coefficients();
    let n = roots.iter().map(|root| root.weight).fold(0.0, f64::max);
    if n.is_nan() || n <= 0.0 {
        return Err(SparseError::NoRows);
    }
    let scale = if assembly.raw { vec![1.0; p] } else { scales(structure, roots, &assembly.weights) };
    let mut stack = Stack::new(p);
    for (task, root) in roots.iter().enumerate() {
        let factor = assembly.weights[task].sqrt();
        if factor > 0.0 {
            stack.add_task(&structure.columns(task), root, factor, &scale);
        }
    }
    if let Some(tikhonov) = &assembly.tikhonov {
        stack.add_tikhonov(tikhonov, &scale);
    }
    let problem = stack.finish(n);
    Ok(Assembled { problem: problem?, penalty, scale })
}

/// Scale of every coefficient's column ([`Assembled::scale`]).
pub(crate) fn scales(structure: &Structure, roots: &[SquareRoot], weights: &[f64]) -> Vec<f64> {
    let p = structure.coefficients();
    let (mut measured, mut believed) = (vec![0.0; p], vec![0.0; p]);
    for (task, root) in roots.iter().enumerate() {
        let shape = &structure.tasks[task];
        let squares = if shape.prior { &mut believed } else { &mut measured };
        let deviation = root.deviation();
        let divisor = root.weight.sqrt().max(f64::MIN_POSITIVE);
        for (column, &j) in structure.columns(task).iter().enumerate() {
            // The constant itself has no deviation but what rounding makes: its size is its own.
            let varies = deviation[column] > root.noise * root.magnitude[column] / divisor;
            let mean = if shape.centred && varies { 0.0 } else { root.mean_x[column] };
            squares[j] += weights[task] * (deviation[column] * deviation[column] + mean * mean);
        }
    }
    let scale = |j: usize| {
        let square = if measured[j] > 0.0 { measured[j] } else { believed[j] };
        if square > 0.0 && square.is_finite() { square.sqrt() } else { 1.0 }
    };
    (0..p).map(scale).collect()
}

/// Factors and signs for the solvers, once the options are those of this structure.
///
/// # Errors
/// When lengths disagree, or a weight, a factor or a strength is out of range.
pub(crate) fn penalty(structure: &Structure, assembly: &Assembly) -> Result<Penalty, SparseError> {
    let (p, latents) = (structure.coefficients(), structure.functions.len());
    let optional = |length: usize, expected: usize| if length == 0 { expected } else { length };
    let tikhonov = assembly.tikhonov.as_ref();
    for (what, length, expected) in [
        ("the task weights", assembly.weights.len(), structure.tasks.len()),
        ("the penalty factors of the latents", optional(assembly.latents.len(), latents), latents),
        ("the penalty factors", optional(assembly.factors.len(), p), p),
        ("the signs", optional(assembly.signs.len(), p), p),
        ("a row of Gamma", tikhonov.map_or(p, |tikhonov| tikhonov.gamma.ncols()), p),
        ("the prior", tikhonov.map_or(p, |tikhonov| tikhonov.prior.len()), p),
    ] {
        if length != expected {
            return Err(SparseError::Length { what, actual: length, expected });
        }
    }
    let weights = assembly.weights.iter().map(|&weight| ("a task weight", weight));
    let latents = assembly.latents.iter().map(|&factor| ("a latent's penalty factor", factor));
    let tikhonov = tikhonov.map(|tikhonov| ("the Tikhonov strength", tikhonov.strength));
    for (name, value) in weights.chain(latents).chain(tikhonov) {
        check_strength(name, value)?;
    }
    let latent_of = structure.latent_of();
    let latent = |j: usize| assembly.latents.get(latent_of[j]).copied().unwrap_or(1.0);
    let factor = |j: usize| assembly.factors.get(j).copied().unwrap_or(1.0) * latent(j);
    let factors: Vec<f64> = (0..p).map(factor).collect();
    if let Some(column) = factors.iter().position(|factor| factor.is_nan() || *factor < 0.0) {
        return Err(SparseError::PenaltyFactor { column, value: factors[column] });
    }
    Ok(Penalty { standardise: false, factors, signs: assembly.signs.clone() })
}

fn check(structure: &Structure, roots: &[SquareRoot]) -> Result<(), SparseError> {
    let (count, expected) = (roots.len(), structure.tasks.len());
    if count != expected {
        return Err(SparseError::Length { what: "the list of the tasks' statistics", actual: count, expected });
    }
    for (task, root) in roots.iter().enumerate() {
        let (regressors, expected) = (root.regressors(), structure.columns(task).len());
        if regressors != expected {
            return Err(SparseError::Length { what: "a task's statistic", actual: regressors, expected });
        }
    }
    Ok(())
}

/// Compressed rows of B theta = Y, gathered task by task.
struct Stack {
    p: usize,
    /// Rows of p + 1 numbers, the target last.
    rows: Vec<Vec<f64>>,
    /// Squared length of the target that no row has.
    beyond: f64,
    /// Squared rounding of every column.
    noise: Vec<f64>,
}

impl Stack {
    fn new(p: usize) -> Self {
        Self { p, rows: Vec::new(), beyond: 0.0, noise: vec![0.0; p] }
    }

    /// The rows of a task, not centred: `sqrt(n) mean` is the row that centring took away.
    fn add_task(&mut self, columns: &[usize], root: &SquareRoot, factor: f64, scale: &[f64]) {
        let d = columns.len();
        let n = root.weight.sqrt();
        let mut mean = vec![0.0; self.p + 1];
        for (column, &j) in columns.iter().enumerate() {
            mean[j] = factor * n * root.mean_x[column] / scale[j];
            self.noise[j] += (factor * root.noise * root.magnitude[column] / scale[j]).powi(2);
        }
        mean[self.p] = factor * n * root.mean_y[0];
        self.rows.push(mean);
        for i in 0..d {
            let mut row = vec![0.0; self.p + 1];
            for column in i..d {
                row[columns[column]] = factor * root.r[(i, column)] / scale[columns[column]];
            }
            row[self.p] = factor * root.z[(i, 0)];
            self.rows.push(row);
        }
        self.beyond += factor * factor * root.residual[0].max(0.0);
    }

    fn add_tikhonov(&mut self, tikhonov: &Tikhonov, scale: &[f64]) {
        let factor = tikhonov.strength.sqrt();
        for i in 0..tikhonov.gamma.nrows() {
            let mut row: Vec<f64> = (0..self.p).map(|j| factor * tikhonov.gamma[(i, j)] / scale[j]).collect();
            let target: f64 = (0..self.p).map(|j| factor * tikhonov.gamma[(i, j)] * tikhonov.prior[j]).sum();
            row.push(target);
            self.rows.push(row);
        }
    }

    fn finish(mut self, n: f64) -> Result<Quadratic, SparseError> {
        if let Some(column) = (0..self.p).find(|&j| !self.rows.iter().all(|row| row[j].is_finite())) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        if !(self.beyond.is_finite() && self.rows.iter().all(|row| row[self.p].is_finite())) {
            return Err(SparseError::TargetNotFinite);
        }
        self.rows.retain(|row| row.iter().any(|&value| value != 0.0));
        let mut rows = Slab::from_fn(self.rows.len(), self.p, |i, j| self.rows[i][j]);
        let mut z: Vec<f64> = self.rows.iter().map(|row| row[self.p]).collect();
        z.resize(rows.stride(), 0.0);
        let size = norm(z.iter().copied().chain([self.beyond.sqrt()]));
        let more = if self.rows.len() > self.p { compress(&mut rows, &mut z) } else { 0.0 };
        z.truncate(rows.rows());
        let noise = self.noise.iter().map(|square| square.sqrt()).collect();
        Ok(Quadratic::of_compressed(n, None, rows, z, self.beyond.sqrt().hypot(more), (size, 0.0), noise))
    }
}

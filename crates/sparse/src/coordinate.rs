//! Coordinate descent over a grid of penalties, for libraries of thousands of columns.

use crate::{
    Penalty, Quadratic, Solution, SparseError, Strength,
    descent::{Small, violation},
    grid::{check_grid, equal_factors},
    kernel::Slab,
    penalty::{Weights, check_ratio, check_strength, check_tolerance},
    pivoting::{MANY, Pivots},
    products::{Products, mirror},
    residual::Residual,
    solution::{Point, finish},
};

pub use crate::solution::Descended;

/// Columns that join the working set at once, at least.
const JOIN: usize = 32;
/// One in this many columns of a working set may be there for nothing.
const SPARE: usize = 4;
/// Exchanges of blocks before sweeps are the way.
const EXCHANGES: usize = 500;
/// The least violation, as a correlation, that is more than rounding.
const MOST_EXACT: f64 = 1e-14;
/// Share of its limit that rounding may leave a column below it.
const TIED: f64 = 1e-6;

/// Options of coordinate descent.
#[derive(Debug, Clone, PartialEq)]
pub struct CoordinateOptions {
    /// Share of the l1 penalty: 1 is the lasso, 0 is ridge.
    pub l1_ratio: f64,
    /// Tolerance on the violation of the optimality conditions, as a correlation
    /// ([`Certificate::kkt`](crate::Certificate)). If the penalty is smaller than a hundred times that, the tolerance
    /// is a hundredth of the penalty.
    pub tolerance: f64,
    /// The most sweeps over the working set, a lambda.
    pub max_epochs: usize,
}

impl Default for CoordinateOptions {
    fn default() -> Self {
        Self { l1_ratio: 1.0, tolerance: 1e-9, max_epochs: 10_000 }
    }
}

/// The minimisers of the objective of this crate at every lambda, in the order given, each started from the one before (so descending is fastest).
///
/// Cyclic coordinate descent on the Gram matrix (Friedman, Hastie, Tibshirani 2010) of a working set: the columns that the sequential strong rule
/// (Tibshirani et al. 2012) cannot discard, and then those that break the optimality conditions, until none does: the rule costs time where it
/// errs, never the answer. From square-root form only the Gram columns of the working set are ever formed, and from rows only their products with each other;
/// there the working set begins with what breaks the conditions. A solution that did not meet the
/// tolerance is marked by [`Solution::converged`], not refused; its certificate says how far it is.
///
/// # Errors
/// When the penalty, an option or a lambda is out of range.
pub fn coordinate_descent(
    problem: &Quadratic,
    penalty: &Penalty,
    lambdas: &[f64],
    options: &CoordinateOptions,
) -> Result<Vec<Solution>, SparseError> {
    let path = descend(problem, penalty, lambdas, options, None)?;
    Ok(path.into_iter().map(|point| point.solution).collect())
}

/// As [`coordinate_descent`], the first lambda started from the coefficients `start` (p, raw units) instead of zeros. Where a coefficient may not have its
/// value, or its column takes no part, it starts from zero.
///
/// # Errors
/// As [`coordinate_descent`], and when `start` does not have one finite value a column.
pub fn coordinate_descent_from(
    problem: &Quadratic,
    penalty: &Penalty,
    lambdas: &[f64],
    options: &CoordinateOptions,
    start: &[f64],
) -> Result<Vec<Descended>, SparseError> {
    let p = problem.columns();
    if start.len() != p {
        return Err(SparseError::Length { what: "the start", actual: start.len(), expected: p });
    }
    if let Some(column) = start.iter().position(|value| !value.is_finite()) {
        return Err(SparseError::ColumnNotFinite { column });
    }
    descend(problem, penalty, lambdas, options, Some(start))
}

pub(crate) fn descend(
    problem: &Quadratic,
    penalty: &Penalty,
    lambdas: &[f64],
    options: &CoordinateOptions,
    start: Option<&[f64]>,
) -> Result<Vec<Descended>, SparseError> {
    check_ratio(options.l1_ratio)?;
    check_tolerance(options.tolerance)?;
    for &lambda in lambdas {
        check_strength("lambda", lambda)?;
    }
    let weights = Weights::new(problem, penalty)?;
    let mut descent = Descent::new(problem, &weights);
    if let Some(start) = start {
        descent.start(start);
    }
    let (mut points, mut epochs) = (Vec::with_capacity(lambdas.len()), Vec::with_capacity(lambdas.len()));
    for &lambda in lambdas {
        let strength = Strength::elastic_net(lambda, options.l1_ratio);
        let (converged, used) = descent.solve(strength.l1 / weights.tau, strength.l2, options);
        let delta = descent.left.delta.iter().copied().enumerate().filter(|(_, value)| *value != 0.0).collect();
        points.push(Point { l1: strength.l1, l2: strength.l2, delta, converged });
        epochs.push(used);
    }
    // Products of thousands of columns are not kept beside those of the certificates.
    drop(descent);
    let solutions = finish(problem, &weights, points).into_iter().zip(epochs);
    Ok(solutions.map(|(solution, epochs)| Descended { solution, epochs }).collect())
}

/// The smallest lambda at which every penalised coefficient is zero; 0 when none ever differs from zero.
///
/// # Errors
/// When the penalty is not valid, or `l1_ratio` is not between 0.001 and 1.
pub fn lambda_max(problem: &Quadratic, penalty: &Penalty, l1_ratio: f64) -> Result<f64, SparseError> {
    check_ratio(l1_ratio)?;
    if l1_ratio < 1e-3 {
        return Err(SparseError::NoLambdaMax { value: l1_ratio });
    }
    let weights = Weights::new(problem, penalty)?;
    let mut descent = Descent::new(problem, &weights);
    descent.solve(f64::INFINITY, 0.0, &CoordinateOptions::default());
    let entry = |j: usize| {
        let push = weights.signs[j].sides().iter().map(|side| side * descent.left.gradient[j]).fold(0.0, f64::max);
        if weights.omega[j] > 0.0 && push > problem.noise[j] { push / weights.omega[j] } else { 0.0 }
    };
    let used = (0..problem.columns()).filter(|&j| weights.used(j));
    let largest = used.map(entry).fold(0.0, f64::max) * weights.tau / l1_ratio;
    Ok(if problem.target_deviation() > 0.0 { largest } else { 0.0 })
}

/// `count` lambdas from [`lambda_max`] down to `ratio` of it, in equal factors.
///
/// # Errors
/// As [`lambda_max`], and when `count` is 0 or `ratio` is not between 0 and 1.
pub fn lambda_grid(
    problem: &Quadratic,
    penalty: &Penalty,
    l1_ratio: f64,
    count: usize,
    ratio: f64,
) -> Result<Vec<f64>, SparseError> {
    check_grid(count, ratio)?;
    Ok(equal_factors(lambda_max(problem, penalty, l1_ratio)?, count, ratio))
}

/// Coefficients that are carried from lambda to lambda, in correlation form.
struct Descent<'a> {
    weights: &'a Weights,
    left: Residual<'a>,
    pivots: Pivots,
    /// Products of the columns of the last working set, where they have no such matrix of their own.
    formed: Formed,
    /// Strength of the solution that the coefficients are.
    l1: f64,
}

/// The Gram matrix of a working set, and what it was made for, where products are not made pair by pair. It stays where it is while columns join; the weight of
/// the squares is on its diagonal alone.
#[derive(Default)]
struct Formed {
    working: Vec<usize>,
    matrix: Slab,
}

impl Formed {
    /// Forgets all columns but those that are kept.
    fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let kept: Vec<usize> = (0..self.working.len()).filter(|&at| keep(self.working[at])).collect();
        self.working = kept.iter().map(|&at| self.working[at]).collect();
        self.matrix.retain(&kept);
    }

    /// The matrix of a working set, which is the last one with other columns behind it or another one; `ridge` is added to the diagonal.
    fn of(&mut self, products: &Products<'_>, working: &[usize], ridge: impl Fn(usize) -> f64) -> Slab {
        let known = self.working.iter().zip(working).take_while(|(a, b)| a == b).count();
        let mut matrix = std::mem::take(&mut self.matrix);
        matrix.resize(known, known);
        matrix.resize(working.len(), working.len());
        for (at, &j) in working.iter().enumerate() {
            let column = matrix.column_mut(at);
            if at >= known {
                products.with(j, working, column);
            }
            column[at] = products.pair(j, j) + ridge(j);
        }
        // Known products of the others stand in the new columns.
        mirror(&mut matrix, known, working.len());
        self.working.clear();
        self.working.extend_from_slice(working);
        matrix
    }
}

impl<'a> Descent<'a> {
    fn new(problem: &'a Quadratic, weights: &'a Weights) -> Self {
        Self {
            weights,
            left: Residual::new(problem),
            pivots: Pivots::default(),
            formed: Formed::default(),
            l1: f64::INFINITY,
        }
    }

    /// Goes on from these coefficients, in raw units.
    fn start(&mut self, raw: &[f64]) {
        let size = self.left.problem.target_length();
        let mut delta = vec![0.0; raw.len()];
        for (j, &value) in raw.iter().enumerate() {
            let used = value != 0.0 && self.weights.used(j) && self.weights.signs[j].allows(value);
            delta[j] = if used { value * (self.left.problem.length[j] / size) } else { 0.0 };
        }
        self.left.start(delta);
    }

    /// The minimiser at these strengths, from the present coefficients on; whether it meets the tolerance, and the sweeps that it took.
    fn solve(&mut self, l1: f64, l2: f64, options: &CoordinateOptions) -> (bool, usize) {
        let p = self.left.problem.columns();
        let limit: Vec<f64> =
            self.weights.omega.iter().map(|&omega| if omega == 0.0 { 0.0 } else { l1 * omega }).collect();
        // A column may have risen by as much as the penalty fell. Where a pair of columns costs all rows, those are taken that break their limits as it is, and
        // the others when they do.
        let fell = if self.left.products.joined().is_some() { 0.0 } else { (self.l1 - l1).max(0.0) };
        // If nothing is penalised any more, the solution is the path's limit among the many that fewer rows than columns may have: of the columns that were at
        // their limits.
        let bound = |j: usize| match (limit[j] == 0.0, self.weights.omega[j]) {
            (true, omega) => self.l1 * omega * (1.0 - TIED),
            (false, omega) => limit[j] - fell * omega,
        };
        let strong = |j: &usize| {
            let gradient = self.left.gradient[*j] - l2 * self.weights.rho[*j] * self.left.delta[*j];
            self.weights.used(*j) && (self.left.delta[*j] != 0.0 || gradient.abs() >= bound(*j))
        };
        let mut working: Vec<usize> = if self.l1.is_finite() {
            (0..p).filter(strong).collect()
        } else {
            (0..p).filter(|&j| self.weights.used(j) && (limit[j] == 0.0 || self.left.delta[j] != 0.0)).collect()
        };
        self.keep(&mut working, l1 > 0.0);
        self.l1 = l1;
        let mut works = vec![false; p];
        working.iter().for_each(|&j| works[j] = true);
        // A violation as large as the penalty itself would be no solution.
        let least = limit.iter().copied().filter(|limit| *limit > 0.0).fold(f64::INFINITY, f64::min);
        let tolerance = options.tolerance.min((0.01 * least).max(MOST_EXACT));
        let (mut epochs, mut idle) = (options.max_epochs, 0);
        loop {
            let small = self.small(&working, &limit, l2);
            let mut delta: Vec<f64> = working.iter().map(|&j| self.left.delta[j]).collect();
            let exchanged = match working.len() > MANY {
                true => {
                    self.pivots.minimise(&small, (&working, l2), &mut delta, 0.5 * tolerance, epochs.min(EXCHANGES))
                }
                false => None,
            };
            let used = exchanged.unwrap_or_else(|| small.minimise(&mut delta, 0.5 * tolerance, epochs).1);
            if let Some(matrix) = self.left.products.bring_back(small.matrix) {
                self.formed.matrix = matrix;
            }
            working.iter().zip(&delta).for_each(|(&j, &delta)| self.left.delta[j] = delta);
            self.left.refresh();
            epochs -= used.min(epochs);
            let mut broken: Vec<(f64, usize)> = (0..p)
                .filter(|&j| self.weights.used(j))
                .map(|j| {
                    let gradient = self.left.gradient[j] - l2 * self.weights.rho[j] * self.left.delta[j];
                    (violation(self.weights.signs[j], limit[j], self.left.delta[j], gradient), j)
                })
                .filter(|&(violation, _)| violation > tolerance)
                .collect();
            if broken.is_empty() {
                return (true, options.max_epochs - epochs);
            }
            broken.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let before = working.len();
            for (_, j) in broken {
                if working.len() - before < before.max(JOIN) && !works[j] {
                    works[j] = true;
                    working.push(j);
                }
            }
            // Nothing joined: what is broken lies in the working set, and sweeping again mends rounding at best.
            idle += usize::from(working.len() == before);
            if epochs == 0 || idle > 2 {
                return (false, options.max_epochs - epochs);
            }
        }
    }

    /// The last working set with the new columns behind it, unless many of it are not wanted any more: their products are then forgotten. More columns than are
    /// needed do no harm where they are penalised (`spare`), and the matrix of the others need not be made anew.
    fn keep(&mut self, working: &mut Vec<usize>, spare: bool) {
        let products = &mut self.left.products;
        if products.joined().is_none() && working.len() <= MANY {
            return;
        }
        let mut wanted = vec![false; self.left.problem.columns()];
        working.iter().for_each(|&j| wanted[j] = true);
        let last = products.joined().unwrap_or(&self.formed.working);
        let unwanted = last.iter().filter(|&&j| !wanted[j]).count();
        if unwanted * SPARE > last.len() || (unwanted > 0 && !spare) {
            products.retain(|j| wanted[j]);
            self.formed.retain(|j| wanted[j]);
        }
        let last = products.joined().unwrap_or(&self.formed.working);
        last.iter().for_each(|&j| wanted[j] = false);
        working.retain(|&j| wanted[j]);
        working.splice(0..0, last.iter().copied());
    }

    /// The problem in the columns of the working set; all others are zero.
    fn small(&mut self, working: &[usize], limit: &[f64], l2: f64) -> Small {
        let products = &mut self.left.products;
        products.form(working);
        let matrix = match products.lend() {
            Some(mut matrix) => {
                debug_assert_eq!(matrix.columns(), working.len());
                working.iter().enumerate().for_each(|(at, &j)| {
                    matrix.column_mut(at)[at] = products.pair(j, j) + l2 * self.weights.rho[j];
                });
                matrix
            }
            None => self.formed.of(products, working, |j| l2 * self.weights.rho[j]),
        };
        let mut target: Vec<f64> = working.iter().map(|&j| self.left.target[j]).collect();
        target.resize(matrix.stride(), 0.0);
        Small {
            matrix,
            target,
            limit: working.iter().map(|&j| limit[j]).collect(),
            signs: working.iter().map(|&j| self.weights.signs[j]).collect(),
        }
    }
}

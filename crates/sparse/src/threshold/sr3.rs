//! Sparse relaxed regularised regression.

use fleetfoot_data::checkpoint;
use fleetfoot_stats::Compressed;

use super::{
    Scaling, Status, Step, Terms, ThresholdError, Trail,
    error::{not_negative, positive},
    prepared::{Prepared, Solved},
    run::Run,
    triangle::Triangle,
};
use crate::{SparseError, kernel::norm};

/// Penalty of the sparse copy of the coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Regularizer {
    /// The number of coefficients: hard thresholding at `sqrt(2 lambda nu)`.
    #[default]
    L0,
    /// The sum of |coefficient|: soft thresholding at `lambda nu`.
    L1,
    /// The sum of squares: shrinking by `1 / (1 + 2 lambda nu)`.
    L2,
}

/// Sparse relaxed regularised regression (Zheng et al. 2019; Champion et al. 2020): alternately minimises over w (dense) and v (sparse)
///
/// `1/2 sum s (y - x'w)^2 + lambda R(u v) + 1/(2 nu) sum_j u_j^2 (w_j - v_j)^2`
///
/// with s the row weights and u the units of [`Scaling`]. The model is v. Defaults and stopping rule are those of pysindy's `SR3`.
#[derive(Debug, Clone, PartialEq)]
pub struct Sr3 {
    /// lambda.
    pub lambda: f64,
    /// Factors of lambda, one a column (p); `None`: all 1.
    pub factors: Option<Vec<f64>>,
    /// R.
    pub regularizer: Regularizer,
    /// nu, the relaxation: the smaller, the nearer w is to v.
    pub nu: f64,
    /// The iteration ends when `|u (v - v before)| / nu` is below it.
    pub tolerance: f64,
    /// The most iterations.
    pub max_iterations: usize,
    /// Units of the coefficients. With [`Scaling::Share`] they are relative to the target's length, and so are the threshold and the tolerance.
    pub scaling: Scaling,
    /// True if the terms of v are refitted by least squares.
    pub unbias: bool,
    /// First value of v (p, raw units); `None`: least squares.
    pub initial: Option<Vec<f64>>,
}

impl Default for Sr3 {
    fn default() -> Self {
        Self {
            lambda: 0.005,
            factors: None,
            regularizer: Regularizer::L0,
            nu: 1.0,
            tolerance: 1e-5,
            max_iterations: 30,
            scaling: Scaling::Physical,
            unbias: false,
            initial: None,
        }
    }
}

impl Sr3 {
    /// The lambda at which the l0 penalty removes coefficients up to `threshold` (Champion et al. 2020, appendix S1).
    pub fn lambda_of_threshold(threshold: f64, nu: f64) -> f64 {
        threshold * threshold / (2.0 * nu)
    }

    pub(super) fn trail(&self, problem: &Compressed, target: usize, terms: &Terms) -> Result<Trail, ThresholdError> {
        let prepared = self.prepared(problem, terms)?;
        prepared.check_target(target)?;
        Ok(Trail::single(self.run(&prepared, target, self.lambda).step))
    }

    /// The problem with its relaxation as a ridge, and the options checked.
    pub(super) fn prepared<'a>(&self, problem: &'a Compressed, terms: &Terms) -> Result<Prepared<'a>, ThresholdError> {
        not_negative("lambda", self.lambda)?;
        positive("nu, the relaxation,", self.nu)?;
        terms.refuse_bounds("sr3")?;
        positive("the tolerance", self.tolerance)?;
        if self.max_iterations == 0 {
            return Err(ThresholdError::NotPositive { name: "max_iterations", value: 0.0 });
        }
        let expected = problem.columns();
        let lists = [("the factors of lambda", &self.factors), ("the first guess", &self.initial)];
        for (what, list) in lists.into_iter().filter_map(|(what, list)| list.as_ref().map(|list| (what, list))) {
            if list.len() != expected {
                return Err(SparseError::Length { what, actual: list.len(), expected }.into());
            }
        }
        for &factor in self.factors.iter().flatten() {
            not_negative("a factor of lambda", factor)?;
        }
        let relaxed = Terms { allowed: terms.allowed.clone(), ..Terms::all() };
        let fixed = terms.checked(problem)?.fixed;
        let mut prepared = Prepared::new(problem, &relaxed, self.scaling, self.nu.recip())?;
        // Relaxed like the others, and never removed.
        prepared.fixed = fixed;
        Ok(prepared)
    }

    /// One lambda on a prepared problem.
    pub(super) fn run(&self, prepared: &Prepared<'_>, target: usize, lambda: f64) -> Run {
        self.watched(prepared, target, lambda, |_, _, _| {})
    }

    /// The same; `watch` sees v and w of the open columns after each iteration, and the length of v's step in the units of the tolerance.
    pub(super) fn watched(
        &self,
        prepared: &Prepared<'_>,
        target: usize,
        lambda: f64,
        mut watch: impl FnMut(&[f64], &[f64], f64),
    ) -> Run {
        let open = &prepared.open;
        let state = Relaxed::new(prepared, target);
        let size = if self.scaling == Scaling::Share { prepared.target_length(target) } else { 1.0 };
        let start = self.start(prepared, target);
        let (mut sparse, mut dense): (Vec<f64>, Vec<f64>) = (start.clone(), start);
        let (mut iterations, mut status) = (0, Status::MaxIterations);
        let (mut dropped, mut kept, mut least) = (0.0_f64, f64::INFINITY, f64::INFINITY);
        let mut pulled = sparse.clone();
        while iterations < self.max_iterations {
            checkpoint();
            pulled.clone_from(&sparse);
            state.improve(&mut dense, &sparse);
            iterations += 1;
            (dropped, kept) = (0.0, f64::INFINITY);
            let mut moved = Vec::with_capacity(open.len());
            for ((&j, dense), sparse) in open.iter().zip(&dense).zip(&mut sparse) {
                let factor = self.factors.as_ref().map_or(1.0, |factors| factors[j]);
                let level = if prepared.fixed[j] { 0.0 } else { lambda * factor };
                let scaled = dense * prepared.unit[j] / size;
                let (value, ratio) = self.proximal(scaled, level);
                if value != 0.0 && !prepared.fixed[j] {
                    least = least.min(scaled.abs() / factor.sqrt());
                }
                if value == 0.0 {
                    dropped = dropped.max(ratio)
                } else {
                    kept = kept.min(ratio)
                }
                let value = value * size / prepared.unit[j];
                moved.push((value - *sparse) * prepared.unit[j] / size);
                *sparse = value;
            }
            let step = norm(moved) / self.nu;
            watch(&sparse, &dense, step);
            if step < self.tolerance {
                status = Status::Converged;
                break;
            }
        }
        let correlation = state.correlation(&dense, &pulled);
        let places: Vec<usize> =
            (0..open.len()).filter(|&place| sparse[place] != 0.0 || prepared.fixed[open[place]]).collect();
        let support: Vec<usize> = places.iter().map(|&place| open[place]).collect();
        if support.iter().all(|&j| prepared.fixed[j]) && !open.iter().all(|&j| prepared.fixed[j]) {
            status = Status::Empty;
        }
        let solved = match self.unbias {
            true => prepared.refit(&support, target),
            false => Solved { values: places.iter().map(|&place| sparse[place]).collect(), confounded: Vec::new() },
        };
        let mut step = prepared.step(target, support, solved, false);
        if !self.unbias {
            step.certificate.correlation = correlation;
        }
        (step.certificate.dropped, step.certificate.kept) = (dropped, kept);
        Run { step: Step { iterations, status, parameter: lambda, ..step }, least, most: f64::INFINITY }
    }

    /// w of the first iteration, on the open columns.
    pub(super) fn first(&self, prepared: &Prepared<'_>, target: usize) -> Vec<f64> {
        let mut dense = self.start(prepared, target);
        let sparse = dense.clone();
        Relaxed::new(prepared, target).improve(&mut dense, &sparse);
        dense
    }

    pub(super) fn start(&self, prepared: &Prepared<'_>, target: usize) -> Vec<f64> {
        match &self.initial {
            Some(initial) => prepared.open.iter().map(|&j| initial[j]).collect(),
            None => prepared.refit(&prepared.open, target).values,
        }
    }

    /// The proximal map of `lambda nu R` and |x| over its threshold.
    fn proximal(&self, x: f64, lambda: f64) -> (f64, f64) {
        let cut = match self.regularizer {
            Regularizer::L0 => (2.0 * lambda * self.nu).sqrt(),
            Regularizer::L1 => lambda * self.nu,
            Regularizer::L2 => return (x / (1.0 + 2.0 * lambda * self.nu), f64::INFINITY),
        };
        let ratio = if cut > 0.0 { x.abs() / cut } else { f64::INFINITY };
        match self.regularizer {
            _ if x.abs() <= cut => (0.0, ratio),
            Regularizer::L1 => (x - cut.copysign(x), ratio),
            _ => (x, ratio),
        }
    }
}

/// The quadratic in w.
struct Relaxed<'a> {
    prepared: &'a Prepared<'a>,
    target: usize,
    plain: Triangle,
    ridged: Triangle,
}

impl<'a> Relaxed<'a> {
    fn new(prepared: &'a Prepared<'a>, target: usize) -> Self {
        let plain = prepared.plain(&prepared.open, target);
        let ridged = prepared.ridged(&prepared.open, target);
        Self { prepared, target, plain, ridged }
    }

    /// Minus the gradient, `P'(z - P w) + (u^2 / nu) (v - w)`, raw units.
    fn gradient(&self, dense: &[f64], sparse: &[f64]) -> Vec<f64> {
        let k = dense.len();
        let mut left = self.plain.z(0).to_vec();
        for (j, dense) in dense.iter().enumerate() {
            (0..=j).for_each(|i| left[i] -= self.plain.r(i, j) * dense);
        }
        let with = |j: usize| (0..=j).map(|i| self.plain.r(i, j) * left[i]).sum::<f64>();
        let pull = |j: usize| self.prepared.ridge(self.prepared.open[j]) * (sparse[j] - dense[j]);
        (0..k).map(|j| with(j) + pull(j)).collect()
    }

    /// The minimiser over w, as a correction of the one before: the equations are normal ones, and a correction does not see their condition.
    fn improve(&self, dense: &mut [f64], sparse: &[f64]) {
        for _ in 0..2 {
            let mut step = self.gradient(dense, sparse);
            self.ridged.solve_transposed(&mut step);
            self.ridged.solve(&mut step);
            dense.iter_mut().zip(&step).for_each(|(dense, step)| *dense += step);
        }
    }

    /// The largest entry of the gradient, as a correlation.
    fn correlation(&self, dense: &[f64], sparse: &[f64]) -> f64 {
        let size = self.prepared.target_length(self.target);
        let gradient = self.gradient(dense, sparse).into_iter().zip(&self.prepared.open);
        let share = gradient.map(|(value, &j)| value.abs() / (self.prepared.length[j] * size));
        if size > 0.0 { share.fold(0.0, f64::max) } else { 0.0 }
    }
}

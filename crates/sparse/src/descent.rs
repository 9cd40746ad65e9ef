//! Coordinate descent on a small dense Gram matrix, and the exact steps that finish it.

use faer::Mat;
use pulp::{Simd, WithSimd};

use crate::{
    cholesky,
    kernel::{Slab, add_scaled_in},
    penalty::Sign,
};

/// `1/2 d'M d - b'd + sum limit_j |d_j|` under sign constraints, in k columns.
pub(crate) struct Small {
    /// M, ridge included (k x k).
    pub(crate) matrix: Slab,
    /// b, padded.
    pub(crate) target: Vec<f64>,
    /// l1 limits.
    pub(crate) limit: Vec<f64>,
    pub(crate) signs: Vec<Sign>,
}

impl Small {
    fn columns(&self) -> usize {
        self.limit.len()
    }

    /// b - M d, padded.
    fn gradient(&self, delta: &[f64]) -> Vec<f64> {
        let mut gradient = self.target.clone();
        self.matrix.subtract(delta, &mut gradient);
        gradient
    }

    /// Largest violation of the optimality conditions.
    fn violation(&self, delta: &[f64], gradient: &[f64]) -> f64 {
        let violation = |j: usize| violation(self.signs[j], self.limit[j], delta[j], gradient[j]);
        (0..self.columns()).map(violation).fold(0.0, f64::max)
    }

    /// Minimises from `delta` on until the violation is below `tolerance`; whether it is, and the epochs that it took.
    ///
    /// Cyclic coordinate descent finds the signs; once they stand still, Newton steps on the support find the coefficients
    /// (feature-sign search, Lee, Battle, Raina, Ng 2006): the last digits do not depend on the condition number.
    pub(crate) fn minimise(&self, delta: &mut [f64], tolerance: f64, max_epochs: usize) -> (bool, usize) {
        let mut gradient = self.gradient(delta);
        if self.violation(delta, &gradient) <= tolerance {
            return (true, 0);
        }
        let mut signs: Vec<f64> = Vec::new();
        let mut due = 8;
        for epoch in 1..=max_epochs {
            pulp::Arch::new().dispatch(Epoch { problem: self, delta, gradient: &mut gradient });
            if self.violation(delta, &gradient) <= tolerance {
                // The gradient was updated along the way: the verdict is that of a fresh one.
                gradient = self.gradient(delta);
                let found = self.violation(delta, &gradient);
                if found <= tolerance {
                    self.finish(delta, found);
                    return (true, epoch);
                }
            }
            let now: Vec<f64> = delta.iter().map(|&value| if value == 0.0 { 0.0 } else { value.signum() }).collect();
            let still = now == signs;
            signs = now;
            if still || epoch >= due {
                due = 2 * epoch.max(8);
                self.polish(delta);
                gradient = self.gradient(delta);
                signs.clear();
                if self.violation(delta, &gradient) <= tolerance {
                    return (true, epoch);
                }
            }
        }
        (false, max_epochs)
    }

    /// Brings a solution that is good enough to the last digits, where Newton steps can.
    fn finish(&self, delta: &mut [f64], violation: f64) {
        let before = delta.to_vec();
        self.polish(delta);
        if self.violation(delta, &self.gradient(delta)) > violation {
            delta.copy_from_slice(&before);
        }
    }

    /// Whether column j keeps its sign in a Newton step.
    fn watched(&self, j: usize) -> bool {
        self.limit[j] > 0.0 || self.signs[j] != Sign::Free
    }

    /// Newton steps on the support, each to the first coefficient that reaches zero, until none does.
    fn polish(&self, delta: &mut [f64]) {
        loop {
            let support: Vec<usize> = (0..self.columns()).filter(|&j| delta[j] != 0.0 || !self.watched(j)).collect();
            let gradient = self.gradient(delta);
            let wanted: Vec<f64> = support.iter().map(|&j| gradient[j] - self.limit[j] * sign_of(delta[j])).collect();
            let matrix = Mat::from_fn(support.len(), support.len(), |i, k| self.matrix.column(support[k])[support[i]]);
            let step = cholesky::solve(&matrix, &wanted, 8.0 * f64::EPSILON * (self.columns() + 1) as f64);
            let crossing = |(&j, step): (&usize, &f64)| {
                let crosses = self.watched(j) && (delta[j] + step) * delta[j] <= 0.0;
                crosses.then(|| (j, delta[j] / (delta[j] - (delta[j] + step))))
            };
            let first = support.iter().zip(&step).filter_map(crossing).min_by(|a, b| a.1.total_cmp(&b.1));
            let share = first.map_or(1.0, |(_, share)| share);
            support.iter().zip(&step).for_each(|(&j, step)| delta[j] += share * step);
            match first {
                Some((j, _)) => delta[j] = 0.0,
                None => return,
            }
        }
    }
}

/// Violation of the optimality conditions of one column.
pub(crate) fn violation(sign: Sign, limit: f64, delta: f64, gradient: f64) -> f64 {
    if delta != 0.0 {
        return (gradient - limit * delta.signum()).abs();
    }
    let push = sign.sides().iter().map(|side| side * gradient).fold(0.0, f64::max);
    (push - limit).max(0.0)
}

fn sign_of(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value.signum() }
}

/// One sweep over the coordinates; the gradient follows.
struct Epoch<'a> {
    problem: &'a Small,
    delta: &'a mut [f64],
    gradient: &'a mut [f64],
}

impl WithSimd for Epoch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { problem, delta, gradient } = self;
        for j in 0..delta.len() {
            let column = problem.matrix.column(j);
            let square = column[j];
            let pull = gradient[j] + square * delta[j];
            let shrunk = (pull.abs() - problem.limit[j]).max(0.0).copysign(pull) / square;
            let next = if shrunk == 0.0 || !problem.signs[j].allows(shrunk) { 0.0 } else { shrunk };
            if next != delta[j] {
                add_scaled_in(simd, delta[j] - next, column, gradient);
                delta[j] = next;
            }
        }
    }
}

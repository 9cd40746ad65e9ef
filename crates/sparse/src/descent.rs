//! Coordinate descent on a small dense Gram matrix, and the exact steps that finish it.

use faer::Mat;
use fleetfoot_data::checkpoint;
use pulp::{Simd, WithSimd};

use crate::{
    cholesky::{Factor, flat, solve_dependent},
    kernel::{Slab, add_scaled_in},
    penalty::Sign,
};

/// Columns up to which a factorisation is as cheap as going on with the one before.
const FEW: usize = 64;
/// One in this many columns may leave a factorisation before the next one.
const SHARE: usize = 8;
/// Sweeps before the first Newton step where signs do not stand still before, at least, and columns a sweep: a factorisation costs as much as many of them.
const SWEEPS: usize = 8;
const COLUMNS_A_SWEEP: usize = 64;

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
    pub(crate) fn columns(&self) -> usize {
        self.limit.len()
    }

    /// b - M d, padded.
    pub(crate) fn gradient(&self, delta: &[f64]) -> Vec<f64> {
        let mut gradient = self.target.clone();
        if self.columns() <= FEW {
            self.matrix.subtract(delta, &mut gradient);
            return gradient;
        }
        // Most coefficients of many are zero.
        let active: Vec<usize> = (0..self.columns()).filter(|&j| delta[j] != 0.0).collect();
        let values: Vec<f64> = active.iter().map(|&j| delta[j]).collect();
        self.matrix.subtract_columns(&active, &values, &mut gradient);
        gradient
    }

    /// Largest violation of the optimality conditions.
    pub(crate) fn violation(&self, delta: &[f64], gradient: &[f64]) -> f64 {
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
        let first = SWEEPS.max(self.columns() / COLUMNS_A_SWEEP);
        let mut due = first;
        for epoch in 1..=max_epochs {
            checkpoint();
            fleetfoot_data::arch().dispatch(Epoch { problem: self, delta, gradient: &mut gradient });
            if self.violation(delta, &gradient) <= tolerance {
                // The gradient was updated along the way: the verdict is that of a fresh one.
                gradient = self.gradient(delta);
                let violation = self.violation(delta, &gradient);
                if violation <= tolerance {
                    self.finish(delta, violation);
                    return (true, epoch);
                }
            }
            let now: Vec<f64> = delta.iter().map(|&value| if value == 0.0 { 0.0 } else { value.signum() }).collect();
            let still = now == signs;
            signs = now;
            if still || epoch >= due {
                due = 2 * epoch.max(first);
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

    /// Returns true if column j keeps its sign in a Newton step.
    pub(crate) fn watched(&self, j: usize) -> bool {
        self.limit[j] > 0.0 || self.signs[j] != Sign::Free
    }

    /// M in some columns, both triangles.
    fn matrix_of(&self, support: &[usize]) -> Mat<f64> {
        let mut matrix = Mat::zeros(support.len(), support.len());
        for (k, &j) in support.iter().enumerate() {
            let column = self.matrix.column(j);
            matrix.col_as_slice_mut(k).iter_mut().zip(support).for_each(|(entry, &i)| *entry = column[i]);
        }
        matrix
    }

    /// Newton steps on the support, each to the first coefficient that reaches zero, until none does.
    fn polish(&self, delta: &mut [f64]) {
        loop {
            checkpoint();
            let support: Vec<usize> = (0..self.columns()).filter(|&j| delta[j] != 0.0 || !self.watched(j)).collect();
            let wanted = self.wanted(delta, &support);
            let level = 8.0 * f64::EPSILON * (self.columns() + 1) as f64;
            let factor = Factor::of(self.matrix_of(&support), level);
            let step = match &factor {
                Some(factor) => factor.solve(&wanted),
                None => self.dependent_step(delta, &support, &wanted, level),
            };
            let factor = factor.filter(|_| support.len() > FEW);
            let mut walk = Walk { problem: self, support: &support, factor, dropped: Vec::new() };
            if walk.go(delta, &step) {
                return;
            }
        }
    }

    /// A step in columns that depend on each other: along a direction in which only the penalty falls, where there is one, beyond the first coefficient that
    /// reaches zero.
    fn dependent_step(&self, delta: &[f64], support: &[usize], wanted: &[f64], level: f64) -> Vec<f64> {
        let matrix = self.matrix_of(support);
        let step = solve_dependent(&matrix, wanted, level);
        let Some(flat) = flat(&matrix, wanted, &step, level) else { return step };
        let far: Vec<f64> = flat.iter().map(|entry| entry * (0.5 / f64::EPSILON)).collect();
        let ends = |(&j, far): (&usize, &f64)| self.watched(j) && delta[j] * (delta[j] + far) < 0.0;
        if support.iter().zip(&far).any(ends) { far } else { step }
    }

    /// Remaining gradient of the optimality conditions in the columns of the support.
    fn wanted(&self, delta: &[f64], support: &[usize]) -> Vec<f64> {
        let gradient = self.gradient(delta);
        support.iter().map(|&j| gradient[j] - self.limit[j] * sign_of(delta[j])).collect()
    }
}

/// The way from coefficients to the solution of the problem with their signs.
struct Walk<'a> {
    problem: &'a Small,
    support: &'a [usize],
    /// M in the columns of the support; `None` where a new factor is as cheap as going on with it, or there is none.
    factor: Option<Factor>,
    /// Places in the support that reached zero, each with its column of the inverse without the ones before.
    dropped: Vec<(usize, Vec<f64>)>,
}

impl Walk<'_> {
    /// Goes by `step` (of the support), and from where a coefficient reaches zero on to the solution without that one; whether it got there.
    fn go(&mut self, delta: &mut [f64], step: &[f64]) -> bool {
        let mut goal: Vec<f64> = self.support.iter().zip(step).map(|(&j, step)| delta[j] + step).collect();
        let most = self.support.len() / SHARE;
        loop {
            let crossing = |(place, &j): (usize, &usize)| {
                let stays = !self.problem.watched(j) || self.dropped.iter().any(|(dropped, _)| *dropped == place);
                let crosses = !stays && goal[place] * delta[j] <= 0.0;
                let share = if delta[j] == 0.0 { 0.0 } else { delta[j] / (delta[j] - goal[place]) };
                crosses.then_some((place, share))
            };
            let first = self.support.iter().enumerate().filter_map(crossing).min_by(|a, b| a.1.total_cmp(&b.1));
            let share = first.map_or(1.0, |(_, share)| share);
            for (place, &j) in self.support.iter().enumerate() {
                let left = if self.dropped.is_empty() { step[place] } else { goal[place] - delta[j] };
                delta[j] += share * left;
            }
            let Some((place, _)) = first else {
                self.refine(delta);
                return true;
            };
            delta[self.support[place]] = 0.0;
            match &self.factor {
                Some(factor) if self.dropped.len() < most => {
                    let mut unit = vec![0.0; goal.len()];
                    unit[place] = 1.0;
                    let inverse = factor.solve(&unit);
                    self.drop(place, inverse, &mut goal);
                }
                _ => return false,
            }
        }
    }

    /// Takes out what rounding of the drops has left, by the same factor.
    fn refine(&self, delta: &mut [f64]) {
        let Some(factor) = self.factor.as_ref().filter(|_| !self.dropped.is_empty()) else { return };
        let mut step = factor.solve(&self.problem.wanted(delta, self.support));
        for (place, u) in &self.dropped {
            let share = step[*place] / u[*place];
            step.iter_mut().zip(u).for_each(|(step, u)| *step -= share * u);
        }
        let kept = |place: usize| self.dropped.iter().all(|(dropped, _)| *dropped != place);
        for (place, &j) in self.support.iter().enumerate().filter(|(place, _)| kept(*place)) {
            delta[j] += step[place];
        }
    }

    /// Takes a column out of the solution `goal`, given its column of the inverse: with u what is left of that beside the ones that were dropped before,
    /// the inverse becomes `M^-1 - u u' / u_j`, and the solution `x - u x_j / u_j`.
    fn drop(&mut self, place: usize, mut u: Vec<f64>, goal: &mut [f64]) {
        let subtract = |u: &mut [f64], share: f64, v: &[f64]| u.iter_mut().zip(v).for_each(|(u, v)| *u -= share * v);
        for (before, v) in &self.dropped {
            let share = v[place] / v[*before];
            subtract(&mut u, share, v);
        }
        let share = goal[place] / u[place];
        subtract(goal, share, &u);
        self.dropped.push((place, u));
        self.dropped.iter().for_each(|(place, _)| goal[*place] = 0.0);
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

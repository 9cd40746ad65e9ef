//! Projected Newton steps until the residual is rounding.

mod direction;
mod interior;

use direction::{Direction, Fixed};
use interior::Interior;
pub use interior::{CENTRED, INSIDE, MOST_ITERATIONS, UNLIMITED};

use super::program::{Instance, Program, dot};

/// Most Newton steps before the interior-point method.
pub const FIRST_STEPS: usize = 6;
/// Most Newton steps behind it.
pub const LAST_STEPS: usize = 20;
/// Largest residual of a solved program.
pub const SOLVED: f64 = 1e-9;
/// Share of the linear decrease that a step has to reach (Armijo).
pub const DECREASE: f64 = 1e-4;
/// Inputs nearer to a limit than this, or than the residual, count as at it while the gradient pushes them there.
pub const NEAR: f64 = 0.01;
/// Most halvings of a step.
pub const MOST_HALVINGS: usize = 30;

/// Result of a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// The residual is at most [`SOLVED`].
    Solved,
    /// All steps are spent, or no step decreases the objective. The plan is within the limits.
    Unfinished,
}

/// Certificate of a solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    /// Result.
    pub status: Status,
    /// Largest entry of `v - P(v - g / d)`: g is the gradient, d the program's curvature, P the projection onto the
    /// limits. It is zero at the minimum alone (Karush, Kuhn, Tucker).
    pub residual: f64,
    /// Newton steps.
    pub steps: usize,
}

/// The plan, and the memory of the solver.
///
/// A Newton step solves the program with the inputs at a limit fixed, and with the violated bounds as quadratic costs.
/// It takes Riccati's recursion, O(N (n + m)^3). The step is projected onto the limits and halved until the objective
/// decreases (Bertsekas, "Projected Newton methods for optimization problems with simple constraints", SIAM J. Control
/// Optim. 20, 1982). The objective is piecewise quadratic, so that the step from a plan with the right fixed inputs and
/// violated bounds is exact. Where few steps do not suffice, an interior-point method takes the plan near to the
/// minimum, and Newton steps the rest of the way. Inputs that a gradient step takes to a limit are tried there first (Hintermueller, Ito,
/// Kunisch, "The primal-dual active set strategy as a semismooth Newton method", SIAM J. Optim. 13, 2002).
#[derive(Debug, Clone)]
pub struct Solver {
    plan: Vec<f64>,
    path: Vec<f64>,
    /// Gradient of the costs of each state of the path.
    slopes: Vec<f64>,
    gradient: Vec<f64>,
    direction: Direction,
    interior: Interior,
    /// The move of a trial, and that of its path.
    change: Vec<f64>,
    displacement: Vec<f64>,
}

impl Solver {
    /// A solver whose plan is zero.
    pub fn new(program: &Program) -> Self {
        let (n, m, horizon) = (program.states(), program.inputs(), program.horizon);
        Self {
            plan: vec![0.0; horizon * m],
            path: vec![0.0; (horizon + 1) * n],
            slopes: vec![0.0; (horizon + 1) * n],
            gradient: vec![0.0; horizon * m],
            direction: Direction::new(n, m, horizon, program.bounds.len()),
            interior: Interior::new(program),
            change: vec![0.0; horizon * m],
            displacement: vec![0.0; (horizon + 1) * n],
        }
    }

    /// Inputs of all samples (N x m).
    pub fn plan(&self) -> &[f64] {
        &self.plan
    }

    /// The same, to begin with.
    pub fn plan_mut(&mut self) -> &mut [f64] {
        &mut self.plan
    }

    /// States of the plan of the last solution ((N + 1) x n).
    pub fn path(&self) -> &[f64] {
        &self.path
    }

    /// Improves the plan, projected onto the limits, to the minimum.
    ///
    /// # Panics
    /// If shapes disagree.
    pub fn solve(&mut self, program: &Program, instance: &Instance<'_>) -> Certificate {
        self.limit(instance);
        let first = self.descend(program, instance, FIRST_STEPS);
        if first.status == Status::Solved {
            return first;
        }
        let interior = self.approach(program, instance);
        self.limit(instance);
        let last = self.descend(program, instance, LAST_STEPS);
        Certificate { steps: first.steps + interior + last.steps, ..last }
    }

    /// Projects the plan onto the limits.
    fn limit(&mut self, instance: &Instance<'_>) {
        for (at, v) in self.plan.iter_mut().enumerate() {
            *v = project(*v, instance.limits[at % instance.limits.len()]);
        }
    }

    /// Newton steps, at most so many.
    fn descend(&mut self, program: &Program, instance: &Instance<'_>, most: usize) -> Certificate {
        let mut steps = 0;
        loop {
            program.path(instance, &self.plan, &mut self.path);
            self.differentiate(program, instance);
            let residual = self.residual(program, instance);
            if residual <= SOLVED {
                return Certificate { status: Status::Solved, residual, steps };
            }
            if steps == most || !self.improve(program, instance, residual) {
                return Certificate { status: Status::Unfinished, residual, steps };
            }
            steps += 1;
        }
    }

    fn residual(&self, program: &Program, instance: &Instance<'_>) -> f64 {
        let m = program.inputs();
        let mut largest = 0.0;
        for (at, (v, g)) in self.plan.iter().zip(&self.gradient).enumerate() {
            let j = at % m;
            let off = (v - project(v - g / program.curvature[j], instance.limits[j])).abs();
            // A number that is none is the largest.
            if off > largest || off.is_nan() {
                largest = off;
            }
        }
        largest
    }

    /// A step that decreases the objective; false if there is none.
    fn improve(&mut self, program: &Program, instance: &Instance<'_>, residual: f64) -> bool {
        self.find(program, instance, Fixed::Predicted);
        if self.takes(program, instance, 1.0) {
            return true;
        }
        self.find(program, instance, Fixed::Held { near: residual.min(NEAR) });
        let mut share = 1.0;
        for _ in 0..MOST_HALVINGS {
            if self.takes(program, instance, share) {
                return true;
            }
            share *= 0.5;
        }
        false
    }

    /// Moves the plan by a share of the direction, projected, if that decreases the objective enough.
    fn takes(&mut self, program: &Program, instance: &Instance<'_>, share: f64) -> bool {
        let m = program.inputs();
        for (at, change) in self.change.iter_mut().enumerate() {
            let v = self.plan[at];
            *change = project(v + share * self.direction.step[at], instance.limits[at % m]) - v;
        }
        let slope = dot(&self.gradient, &self.change);
        let difference = slope + self.curving(program, instance);
        let decreases = slope < 0.0 && difference <= DECREASE * slope;
        if !decreases {
            return false;
        }
        for (at, v) in self.plan.iter_mut().enumerate() {
            *v = project(*v + share * self.direction.step[at], instance.limits[at % m]);
        }
        true
    }

    /// The objective's change by `change` without the linear part. It is a sum of terms that are not negative, so that
    /// nothing cancels near the minimum.
    fn curving(&mut self, program: &Program, instance: &Instance<'_>) -> f64 {
        let (n, m, last) = (program.states(), program.inputs(), program.horizon);
        let mut sum = 0.0;
        for (at, change) in self.change.iter().enumerate() {
            sum += program.input_weights[at % m] * change * change;
        }
        for k in 0..last {
            let step = &program.steps[instance.sequence[k]];
            let (now, next) = self.displacement[n * k..].split_at_mut(n);
            for i in 0..n {
                next[i] = dot(&step.a[n * i..][..n], now) + dot(&step.b[m * i..][..m], &self.change[m * k..][..m]);
            }
            for i in 0..n {
                sum += next[i]
                    * if k + 1 < last {
                        program.weights[i] * next[i]
                    } else {
                        dot(&program.terminal[n * i..][..n], &next[..n])
                    };
            }
            for bound in &program.bounds {
                let (x, change) = (self.path[n * (k + 1) + bound.state], next[bound.state]);
                let (before, after) = (bound.violation(x), bound.violation(x + change));
                sum += bound.weight * (after * after - before * before - 2.0 * before * change);
            }
        }
        0.5 * sum
    }
}

/// The nearest value within limits.
pub(crate) fn project(v: f64, [lowest, highest]: [f64; 2]) -> f64 {
    if v < lowest {
        lowest
    } else if v > highest {
        highest
    } else {
        v
    }
}

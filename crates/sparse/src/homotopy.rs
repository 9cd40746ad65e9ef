//! Steps of the path: ties at a knot, direction of the coefficients, and the next knot.
//!
//! In correlation form, with the active set S and signs s, the coefficients at lambda are `x - lambda y`, x = U^-1 q
//! and y = U^-1 t. All correlations with the residual are `e + lambda a` ([`Factor`]). An inactive column j meets the
//! bound on side s where `s (e_j + lambda a_j) = lambda omega_j`, so at `lambda = s e_j / (omega_j - s a_j)`. An active
//! one reaches zero at `x_j / y_j`.

use fleetfoot_data::checkpoint;

use crate::{
    factor::Factor,
    penalty::{Sign, Weights},
    quadratic::Quadratic,
};

/// The outcome of [`Homotopy::settle`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Settled {
    /// The active set is right just below this lambda.
    Done,
    /// One more column would have to enter than is allowed.
    Full,
    /// Rounding made the columns go in and out in circles.
    Stalled,
}

/// Solution by which the tied columns are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Aim {
    /// `x`: least squares of the target itself, for the columns that are not penalised.
    Target,
    /// `y`: the direction of the path.
    Direction,
}

/// A tied column, one of its sides, and by how much it would break its bound per unit of lambda.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    column: usize,
    side: f64,
    violation: f64,
}

/// The state of a path at one lambda.
pub(crate) struct Homotopy<'a> {
    problem: &'a Quadratic,
    weights: &'a Weights,
    factor: Factor<'a>,
    /// True if coefficients must keep their signs (lasso).
    watch: bool,
    max_features: usize,
    /// Sign of every active column; 0 for those that are free to change it.
    side: Vec<f64>,
    /// Columns whose remainder beyond the active set was rounding; cleared when the active set shrinks.
    refused: Vec<bool>,
    /// Lambda at which rounding made a column come and go; it waits until the path has moved on.
    barred: Vec<f64>,
    /// x and y for the present active set.
    solutions: (Vec<f64>, Vec<f64>),
}

impl<'a> Homotopy<'a> {
    pub(crate) fn new(problem: &'a Quadratic, weights: &'a Weights, l2: f64, watch: bool, max_features: usize) -> Self {
        let p = problem.columns();
        Self {
            problem,
            weights,
            factor: Factor::new(problem, weights, l2),
            watch,
            max_features,
            side: vec![0.0; p],
            refused: vec![false; p],
            barred: vec![f64::NAN; p],
            solutions: (Vec::new(), Vec::new()),
        }
    }

    /// Number of active columns.
    pub(crate) fn active(&self) -> usize {
        self.factor.order.len()
    }

    /// Fits the columns that are not penalised: the solution at any lambda where no penalised column is active.
    pub(crate) fn start(&mut self) -> Settled {
        for j in 0..self.problem.columns() {
            let free = self.weights.omega[j] == 0.0 && self.weights.signs[j] == Sign::Free;
            if free && !self.factor.append(j, 0.0) {
                self.refused[j] = true;
            }
        }
        let unpenalised: Vec<usize> = (0..self.problem.columns())
            .filter(|&j| self.weights.omega[j] == 0.0 && self.weights.signs[j] != Sign::Free)
            .collect();
        let settled = if unpenalised.is_empty() { Settled::Done } else { self.choose(Aim::Target, f64::INFINITY) };
        self.solutions = self.factor.solutions();
        settled
    }

    /// The largest lambda at which a penalised column is at its bound, after [`Homotopy::start`]; 0 when none ever is.
    pub(crate) fn lambda_max(&self) -> f64 {
        let entry = |j: usize| {
            let omega = self.weights.omega[j];
            let push = self.sides(j).iter().map(|side| side * self.factor.left(j)).fold(0.0, f64::max);
            if omega > 0.0 && push > self.noise(j) && !self.factor.is_active(j) { push / omega } else { 0.0 }
        };
        (0..self.problem.columns()).filter(|&j| self.weights.used(j)).map(entry).fold(0.0, f64::max)
    }

    fn sides(&self, j: usize) -> &'static [f64] {
        self.weights.signs[j].sides()
    }

    /// Rounding of the correlation of column j with the residual.
    fn noise(&self, j: usize) -> f64 {
        self.factor.noise() + self.problem.noise[j]
    }

    /// Coefficients at lambda, those that reach zero exactly zero.
    pub(crate) fn coefficients(&self, lambda: f64) -> Vec<(usize, f64)> {
        self.factor.order.iter().enumerate().map(|(place, &j)| (j, self.coefficient(place, j, lambda))).collect()
    }

    fn coefficient(&self, place: usize, j: usize, lambda: f64) -> f64 {
        let (x, y) = (self.solutions.0[place], self.solutions.1[place]);
        // Unpenalised columns alone do not move, and lambda may be infinite.
        let delta = if y == 0.0 { x } else { x - lambda * y };
        let rounding = 32.0 * f64::EPSILON * (x.abs() + (x - delta).abs());
        if self.watch && self.side[j] != 0.0 && self.side[j] * delta <= rounding { 0.0 } else { delta }
    }

    /// Takes the columns out whose coefficients are zero at lambda; [`Homotopy::settle`] brings those back that grow from there.
    pub(crate) fn drop_zeros(&mut self, lambda: f64) {
        if !self.watch {
            return;
        }
        let zero = |&(_, delta): &(usize, f64)| delta == 0.0;
        let coefficients = self.coefficients(lambda);
        for (j, _) in coefficients.iter().filter(|pair| zero(pair)) {
            if self.side[*j] != 0.0 {
                self.remove(*j);
            }
        }
    }

    fn remove(&mut self, j: usize) {
        if let Some(place) = self.factor.order.iter().position(|&i| i == j) {
            self.factor.remove(place);
            self.side[j] = 0.0;
            self.refused.fill(false);
        }
    }

    /// Brings in the tied columns that belong to the active set just below lambda.
    pub(crate) fn settle(&mut self, lambda: f64) -> Settled {
        let settled = self.choose(Aim::Direction, lambda);
        self.solutions = self.factor.solutions();
        settled
    }

    /// The active set among the tied columns, by the algorithm of Lawson and Hanson (1974, chapter 23) for non-negative least squares.
    ///
    /// With the columns whose coefficients are not zero free, the direction y minimises `1/2 |A y|^2 - (omega s)'y` subject to
    /// `s_j y_j >= 0` for the tied columns, whose coefficients are zero: each step takes in the column that would break its bound fastest.
    fn choose(&mut self, aim: Aim, lambda: f64) -> Settled {
        // Columns that came in here, with their present coefficients in the direction of their sides.
        let mut fresh: Vec<(usize, f64)> = Vec::new();
        let mut removals = vec![0_u8; self.problem.columns()];
        for _ in 0..20 * (self.problem.columns() + 10) {
            checkpoint();
            let Some(Candidate { column, side, .. }) = self.worst(aim, lambda) else {
                return Settled::Done;
            };
            if self.active() >= self.max_features {
                return Settled::Full;
            }
            if !fresh.is_empty() {
                let goal = self.goal(aim);
                fresh.iter_mut().for_each(|(j, now)| *now = goal[*j]);
            }
            if !self.factor.append(column, side) {
                self.refused[column] = true;
                continue;
            }
            if !self.watch {
                continue;
            }
            self.side[column] = side;
            fresh.push((column, 0.0));
            // A single column is the last of U: its coefficient needs no substitution.
            if fresh.len() == 1 && side * self.factor.last(aim == Aim::Target) > 0.0 {
                continue;
            }
            for removed in self.shrink(aim, &mut fresh) {
                removals[removed] = removals[removed].saturating_add(1);
                if removed == column || removals[removed] > 1 {
                    self.barred[removed] = lambda;
                }
            }
        }
        Settled::Stalled
    }

    /// Coefficients of the active columns at the aim, in the direction of their sides (p).
    fn goal(&self, aim: Aim) -> Vec<f64> {
        let (x, y) = self.factor.solutions();
        let solution = if aim == Aim::Target { x } else { y };
        let mut goal = vec![0.0; self.problem.columns()];
        self.factor.order.iter().zip(&solution).for_each(|(&j, value)| goal[j] = self.side[j] * value);
        goal
    }

    /// Moves the fresh coefficients towards the new solution and takes out those that would change sign, until none would; those taken out.
    fn shrink(&mut self, aim: Aim, fresh: &mut Vec<(usize, f64)>) -> Vec<usize> {
        let mut removed = Vec::new();
        loop {
            let goal = self.goal(aim);
            let blocking = fresh.iter().filter(|(j, _)| goal[*j] <= 0.0);
            let share = |(j, now): &(usize, f64)| if *now > 0.0 { now / (now - goal[*j]) } else { 0.0 };
            let Some(step) = blocking.map(share).min_by(f64::total_cmp) else {
                return removed;
            };
            let leaves = |(j, now): &(usize, f64)| goal[*j] <= 0.0 && share(&(*j, *now)) <= step;
            let leaving: Vec<usize> = fresh.iter().filter(|pair| leaves(pair)).map(|(j, _)| *j).collect();
            fresh.retain(|(j, _)| !leaving.contains(j));
            fresh.iter_mut().for_each(|(j, now)| *now += step * (goal[*j] - *now));
            leaving.iter().for_each(|&j| self.remove(j));
            removed.extend(leaving);
        }
    }

    /// The tied column that would break its bound fastest.
    fn worst(&self, aim: Aim, lambda: f64) -> Option<Candidate> {
        let floor = self.factor.noise();
        let mut worst: Option<Candidate> = None;
        for j in 0..self.problem.columns() {
            if !self.may_enter(j, lambda) {
                continue;
            }
            let (omega, e, a) = (self.weights.omega[j], self.factor.left(j), self.factor.rate(j));
            let noise = floor + self.problem.noise[j];
            for &side in self.sides(j) {
                let violation = match aim {
                    Aim::Target if omega > 0.0 => 0.0,
                    Aim::Target => side * e,
                    Aim::Direction => {
                        let rate = omega - side * a;
                        let slack = lambda * rate - side * e;
                        if slack <= 4.0 * noise + 32.0 * f64::EPSILON * lambda * omega { rate } else { 0.0 }
                    }
                };
                let beyond = side * e > noise && violation > 0.0;
                if beyond && worst.is_none_or(|worst| violation > worst.violation) {
                    worst = Some(Candidate { column: j, side, violation });
                }
            }
        }
        worst
    }

    fn may_enter(&self, j: usize, lambda: f64) -> bool {
        let waits = lambda > self.barred[j] * (1.0 - 1e-10) || (lambda.is_infinite() && self.barred[j].is_infinite());
        self.weights.used(j) && !self.factor.is_active(j) && !self.refused[j] && !waits
    }

    /// The next knot below lambda: the first entry or the first coefficient that reaches zero; 0 when there is none.
    pub(crate) fn next(&self, lambda: f64) -> f64 {
        let floor = self.factor.noise();
        let mut next = 0.0_f64;
        for j in 0..self.problem.columns() {
            if !self.may_enter(j, lambda) {
                continue;
            }
            for &side in self.sides(j) {
                let rate = self.weights.omega[j] - side * self.factor.rate(j);
                let push = side * self.factor.left(j);
                // A push of the size of rounding meets the bound at lambda = 0, or rides along it with the column that it duplicates.
                if rate > 0.0 && push > floor + self.problem.noise[j] {
                    next = next.max(push / rate);
                }
            }
        }
        if self.watch {
            for (place, &j) in self.factor.order.iter().enumerate() {
                let (x, y) = (self.solutions.0[place], self.solutions.1[place]);
                if self.side[j] * y < 0.0 {
                    next = next.max(x / y);
                }
            }
        }
        next.min(lambda)
    }

    /// Inactive columns that the active ones explain up to rounding.
    pub(crate) fn collinear(&self) -> Vec<usize> {
        let least = 8.0 * self.factor.least_remainder();
        let explained = |&j: &usize| {
            let noise = self.factor.order.iter().map(|&i| self.problem.noise[i]).fold(self.problem.noise[j], f64::max);
            self.refused[j] || self.factor.remainder(j) <= least.max(noise * noise)
        };
        (0..self.problem.columns())
            .filter(|&j| self.weights.used(j) && !self.factor.is_active(j))
            .filter(explained)
            .collect()
    }
}

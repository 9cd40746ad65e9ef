//! An interior-point method, for programs whose active limits and bounds the Newton steps do not find.

use super::Solver;
use crate::predictive::program::{Instance, Program};

/// Most iterations.
pub const MOST_ITERATIONS: usize = 30;
/// Mean complementarity at which the method ends, in units of the first.
pub const CENTRED: f64 = 1e-9;
/// Share of the way to the border that a step goes.
pub const INSIDE: f64 = 0.995;

/// Slacks and multipliers of all inequalities: for every input of every sample, then every bound behind every sample,
/// that of the lowest value and that of the highest.
#[derive(Debug, Clone)]
pub(super) struct Interior {
    slack: Vec<f64>,
    multiplier: Vec<f64>,
    slack_move: Vec<f64>,
    multiplier_move: Vec<f64>,
    /// Wanted change of the complementarity.
    centring: Vec<f64>,
    /// Gradients without the inequalities: of states, of inputs.
    slopes: Vec<f64>,
    input_slopes: Vec<f64>,
}

impl Interior {
    pub(super) fn new(program: &Program) -> Self {
        let (m, n, horizon) = (program.inputs(), program.states(), program.horizon);
        let count = 2 * horizon * (m + program.bounds.len());
        Self {
            slack: vec![0.0; count],
            multiplier: vec![0.0; count],
            slack_move: vec![0.0; count],
            multiplier_move: vec![0.0; count],
            centring: vec![0.0; count],
            slopes: vec![0.0; (horizon + 1) * n],
            input_slopes: vec![0.0; horizon * m],
        }
    }
}

/// An inequality `sign y <= sign limit + softness multiplier`.
struct Inequality {
    /// Index of y: of inputs, or of states of the path.
    y: usize,
    is_input: bool,
    limit: f64,
    sign: f64,
    softness: f64,
}

/// The inequality of an index; `None` of a value without a limit.
fn inequality(program: &Program, instance: &Instance<'_>, at: usize) -> Option<Inequality> {
    let (m, n, count) = (program.inputs(), program.states(), program.bounds.len());
    let (pair, side) = (at / 2, at % 2);
    let sign = if side == 0 { -1.0 } else { 1.0 };
    let (limit, y, is_input, softness) = if pair < program.horizon * m {
        (instance.limits[pair % m][side], pair, true, 0.0)
    } else {
        let pair = pair - program.horizon * m;
        let bound = &program.bounds[pair % count];
        let limit = if side == 0 { bound.lowest } else { bound.highest };
        (limit, n * (pair / count + 1) + bound.state, false, 1.0 / bound.weight)
    };
    (limit.abs() < UNLIMITED).then_some(Inequality { y, is_input, limit, sign, softness })
}

/// Limits from here on are none.
pub const UNLIMITED: f64 = 1e30;

impl Solver {
    /// Moves the plan near to the minimum, by Mehrotra's predictor and corrector with Riccati's recursion (Rao, Wright,
    /// Rawlings, "Application of interior-point methods to model predictive control", J. Optim. Theory Appl. 99, 1998).
    /// A soft bound is an inequality whose slack grows with its multiplier. Returns the number of iterations.
    pub(super) fn approach(&mut self, program: &Program, instance: &Instance<'_>) -> usize {
        let size = program.curvature.iter().copied().fold(0.0, f64::max);
        program.path(instance, &self.plan, &mut self.path);
        for at in 0..self.interior.slack.len() {
            let Some(inequality) = inequality(program, instance, at) else { continue };
            let room = inequality.sign * (inequality.limit - self.value(&inequality));
            self.interior.slack[at] = if room > 1.0 { room } else { 1.0 };
            self.interior.multiplier[at] = size;
        }
        self.direction.fixed.fill(false);
        let mut first = 0.0;
        for iteration in 0..MOST_ITERATIONS {
            program.path(instance, &self.plan, &mut self.path);
            self.differentiate(program, instance);
            self.interior.slopes.copy_from_slice(&self.slopes);
            // Bounds are inequalities here: their penalties are no costs.
            for k in 1..=program.horizon {
                for bound in &program.bounds {
                    let at = program.states() * k + bound.state;
                    self.interior.slopes[at] -= bound.weight * bound.violation(self.path[at]);
                }
            }
            self.interior.input_slopes.copy_from_slice(&self.direction.input_slopes);
            let (mean, count) = self.complementarity(program, instance, 0.0);
            if iteration == 0 {
                first = mean;
            }
            if count == 0 || mean <= CENTRED * first {
                return iteration;
            }
            for at in 0..self.interior.slack.len() {
                self.interior.centring[at] = -self.interior.slack[at] * self.interior.multiplier[at];
            }
            let share = self.step_inside(program, instance, true);
            let ratio = self.complementarity(program, instance, share).0 / mean;
            let centre = ratio * ratio * ratio * mean;
            for at in 0..self.interior.slack.len() {
                self.interior.centring[at] += centre - self.interior.slack_move[at] * self.interior.multiplier_move[at];
            }
            let share = INSIDE * self.step_inside(program, instance, false);
            for (v, step) in self.plan.iter_mut().zip(&self.direction.step) {
                *v += share * step;
            }
            for at in 0..self.interior.slack.len() {
                self.interior.slack[at] += share * self.interior.slack_move[at];
                self.interior.multiplier[at] += share * self.interior.multiplier_move[at];
            }
        }
        MOST_ITERATIONS
    }

    fn value(&self, inequality: &Inequality) -> f64 {
        if inequality.is_input { self.plan[inequality.y] } else { self.path[inequality.y] }
    }

    /// Mean product of slacks and multipliers after a share of their moves, and the number of inequalities.
    fn complementarity(&self, program: &Program, instance: &Instance<'_>, share: f64) -> (f64, usize) {
        let Interior { slack, multiplier, slack_move, multiplier_move, .. } = &self.interior;
        let (mut sum, mut count) = (0.0, 0);
        for at in 0..slack.len() {
            if inequality(program, instance, at).is_some() {
                sum += (slack[at] + share * slack_move[at]) * (multiplier[at] + share * multiplier_move[at]);
                count += 1;
            }
        }
        (if count > 0 { sum / count as f64 } else { 0.0 }, count)
    }

    /// Moves of plan, slacks and multipliers for the wanted centring; the longest share up to 1 that keeps slacks and
    /// multipliers positive. `fresh` is that of [`Solver::minimise`].
    fn step_inside(&mut self, program: &Program, instance: &Instance<'_>, fresh: bool) -> f64 {
        self.slopes.copy_from_slice(&self.interior.slopes);
        self.direction.input_slopes.copy_from_slice(&self.interior.input_slopes);
        self.direction.input_curvature.fill(0.0);
        self.direction.bound_curvature.fill(0.0);
        let inputs = 2 * self.plan.len();
        for at in 0..self.interior.slack.len() {
            let Some(inequality) = inequality(program, instance, at) else { continue };
            let (slack, multiplier) = (self.interior.slack[at], self.interior.multiplier[at]);
            let width = slack + multiplier * inequality.softness;
            let miss = self.miss(&inequality, at);
            let slope = inequality.sign * (multiplier + (self.interior.centring[at] - multiplier * miss) / width);
            if inequality.is_input {
                self.direction.input_curvature[at / 2] += multiplier / width;
                self.direction.input_slopes[inequality.y] += slope;
            } else {
                self.direction.bound_curvature[(at - inputs) / 2] += multiplier / width;
                self.slopes[inequality.y] += slope;
            }
        }
        self.minimise(program, instance, fresh);
        let mut share = 1.0;
        for at in 0..self.interior.slack.len() {
            let Some(inequality) = inequality(program, instance, at) else { continue };
            let moved = match inequality.is_input {
                true => self.direction.step[inequality.y],
                false => self.direction.displacement[inequality.y],
            };
            let (slack, multiplier) = (self.interior.slack[at], self.interior.multiplier[at]);
            let miss = self.miss(&inequality, at);
            let width = slack + multiplier * inequality.softness;
            let multiplier_move = (self.interior.centring[at] + multiplier * (inequality.sign * moved - miss)) / width;
            let slack_move = miss - inequality.sign * moved + inequality.softness * multiplier_move;
            if slack + share * slack_move < 0.0 {
                share = -slack / slack_move;
            }
            if multiplier + share * multiplier_move < 0.0 {
                share = -multiplier / multiplier_move;
            }
            self.interior.slack_move[at] = slack_move;
            self.interior.multiplier_move[at] = multiplier_move;
        }
        share
    }

    /// Residual of the equation that defines the slack of an inequality.
    fn miss(&self, inequality: &Inequality, at: usize) -> f64 {
        inequality.sign * (inequality.limit - self.value(inequality))
            + inequality.softness * self.interior.multiplier[at]
            - self.interior.slack[at]
    }
}

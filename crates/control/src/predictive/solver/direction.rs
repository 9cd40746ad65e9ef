//! Gradient and Newton direction of a program, by recursions backwards in time.

use super::Solver;
use crate::predictive::program::{Instance, Program};

/// Inputs that a direction fixes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Fixed {
    /// Inputs that a step along the gradient takes to a limit go there (primal-dual active set).
    Predicted,
    /// Inputs this near to a limit, to which the gradient pushes them, go there (projected Newton).
    Held {
        /// The distance.
        near: f64,
    },
}

/// The direction, and the memory of its recursion; matrices by rows.
#[derive(Debug, Clone)]
pub(super) struct Direction {
    /// The move of every input (N x m).
    pub(super) step: Vec<f64>,
    /// True if the input is fixed (N x m).
    pub(super) fixed: Vec<bool>,
    /// Gradient of the costs of every input (N x m).
    pub(super) input_slopes: Vec<f64>,
    /// Curvature added to that of every input (N x m), and of the bounded states behind every sample (N x bounds).
    pub(super) input_curvature: Vec<f64>,
    pub(super) bound_curvature: Vec<f64>,
    /// The displaced path ((N + 1) x n).
    pub(super) displacement: Vec<f64>,
    /// Feedback of displacements (N x m x n) and its constant (N x m).
    gain: Vec<f64>,
    constant: Vec<f64>,
    /// Second derivative of the later cost by the state (n x n), and its gradient (n).
    cost: Vec<f64>,
    slope: Vec<f64>,
    /// P A (n x n), P B (n x m).
    cost_a: Vec<f64>,
    cost_b: Vec<f64>,
    /// Cholesky factor of B'P B + R (N x m x m), B'P A (N x m x n).
    factor: Vec<f64>,
    cross: Vec<f64>,
    /// Vectors of n.
    driven: Vec<f64>,
    later: Vec<f64>,
}

impl Direction {
    pub(super) fn new(n: usize, m: usize, horizon: usize, bounds: usize) -> Self {
        Self {
            step: vec![0.0; horizon * m],
            fixed: vec![false; horizon * m],
            input_slopes: vec![0.0; horizon * m],
            input_curvature: vec![0.0; horizon * m],
            bound_curvature: vec![0.0; horizon * bounds],
            displacement: vec![0.0; (horizon + 1) * n],
            gain: vec![0.0; horizon * m * n],
            constant: vec![0.0; horizon * m],
            cost: vec![0.0; n * n],
            slope: vec![0.0; n],
            cost_a: vec![0.0; n * n],
            cost_b: vec![0.0; n * m],
            factor: vec![0.0; horizon * m * m],
            cross: vec![0.0; horizon * m * n],
            driven: vec![0.0; n],
            later: vec![0.0; n],
        }
    }
}

impl Solver {
    /// The gradient of the objective by the inputs: `B' l_(k+1) + R (v_k - v*)` with the adjoint
    /// `l_k = s_k + A' l_(k+1)`, s being the gradient of the costs of a state.
    pub(super) fn differentiate(&mut self, program: &Program, instance: &Instance<'_>) {
        let (n, m, last) = (program.states(), program.inputs(), program.horizon);
        for k in 1..=last {
            let x = &self.path[n * k..][..n];
            let slope = &mut self.slopes[n * k..][..n];
            for (i, slope) in slope.iter_mut().enumerate() {
                *slope = if k < last {
                    program.weights[i] * (x[i] - instance.target[i])
                } else {
                    let row = &program.terminal[n * i..][..n];
                    let mut sum = 0.0;
                    for ((p, x), target) in row.iter().zip(x).zip(instance.target) {
                        sum += p * (x - target);
                    }
                    sum
                };
            }
            for bound in &program.bounds {
                slope[bound.state] += bound.weight * bound.violation(x[bound.state]);
            }
        }
        let Direction { slope: adjoint, later, input_slopes, .. } = &mut self.direction;
        for (at, slope) in input_slopes.iter_mut().enumerate() {
            *slope = program.input_weights[at % m] * (self.plan[at] - instance.input_target[at % m]);
        }
        adjoint.copy_from_slice(&self.slopes[n * last..]);
        for k in (0..last).rev() {
            let step = &program.steps[instance.sequence[k]];
            for j in 0..m {
                let mut sum = input_slopes[m * k + j];
                for (i, adjoint) in adjoint.iter().enumerate() {
                    sum += step.b[m * i + j] * adjoint;
                }
                self.gradient[m * k + j] = sum;
            }
            for (j, later) in later.iter_mut().enumerate() {
                let mut sum = self.slopes[n * k + j];
                for (i, adjoint) in adjoint.iter().enumerate() {
                    sum += step.a[n * i + j] * adjoint;
                }
                *later = sum;
            }
            adjoint.copy_from_slice(later);
        }
    }

    /// The Newton direction with some inputs fixed, behind [`Solver::differentiate`].
    pub(super) fn find(&mut self, program: &Program, instance: &Instance<'_>, fixed: Fixed) {
        let (n, count) = (program.states(), program.bounds.len());
        self.fix(program, instance, fixed);
        self.direction.input_curvature.fill(0.0);
        for (at, curvature) in self.direction.bound_curvature.iter_mut().enumerate() {
            let bound = &program.bounds[at % count];
            let x = self.path[n * (at / count + 1) + bound.state];
            *curvature = if x > bound.highest || x < bound.lowest { bound.weight } else { 0.0 };
        }
        self.minimise(program, instance, true);
    }

    /// The move of the free inputs that minimises the second-order model of slopes and curvatures. If only slopes are
    /// other than before, `fresh` is false, no input is fixed, and the factors are those of before.
    pub(super) fn minimise(&mut self, program: &Program, instance: &Instance<'_>, fresh: bool) {
        self.backward(program, instance, fresh);
        self.forward(program, instance);
    }

    /// Decides the fixed inputs, and their moves.
    fn fix(&mut self, program: &Program, instance: &Instance<'_>, fixed: Fixed) {
        let m = program.inputs();
        for at in 0..self.plan.len() {
            let (v, g, [lowest, highest]) = (self.plan[at], self.gradient[at], instance.limits[at % m]);
            let (to, near) = match fixed {
                Fixed::Predicted => (v - g / program.curvature[at % m], 0.0),
                Fixed::Held { near } => (v, near),
            };
            let limit = if g < 0.0 && to >= highest - near {
                Some(highest)
            } else if g > 0.0 && to <= lowest + near {
                Some(lowest)
            } else {
                None
            };
            self.direction.fixed[at] = limit.is_some();
            self.direction.step[at] = limit.map_or(0.0, |limit| limit - v);
        }
    }

    /// Riccati's recursion: the second-order model of the later cost, and the best feedback of the free inputs.
    fn backward(&mut self, program: &Program, instance: &Instance<'_>, fresh: bool) {
        let (n, m, last) = (program.states(), program.inputs(), program.horizon);
        let Direction {
            step: moves,
            fixed,
            input_slopes,
            input_curvature,
            bound_curvature,
            gain,
            constant,
            cost,
            slope,
            cost_a,
            cost_b,
            factor,
            cross,
            driven,
            later,
            ..
        } = &mut self.direction;
        cost.copy_from_slice(&program.terminal);
        slope.copy_from_slice(&self.slopes[n * last..]);
        for k in (0..last).rev() {
            let step = &program.steps[instance.sequence[k]];
            let (fixed, moves) = (&fixed[m * k..][..m], &moves[m * k..][..m]);
            let (gain, constant) = (&mut gain[n * m * k..][..n * m], &mut constant[m * k..][..m]);
            let (factor, cross) = (&mut factor[m * m * k..][..m * m], &mut cross[n * m * k..][..n * m]);
            if fresh {
                for (b, bound) in program.bounds.iter().enumerate() {
                    cost[(n + 1) * bound.state] += bound_curvature[program.bounds.len() * k + b];
                }
                // What fixed inputs do to the later state.
                if fixed.contains(&true) {
                    for i in 0..n {
                        driven[i] = 0.0;
                        for j in 0..m {
                            driven[i] += step.b[m * i + j] * moves[j];
                        }
                    }
                    for i in 0..n {
                        for l in 0..n {
                            slope[i] += cost[n * i + l] * driven[l];
                        }
                    }
                }
                product(cost, &step.a, n, cost_a);
                product(cost, &step.b, m, cost_b);
                for j in 0..m {
                    for l in 0..=j {
                        let mut sum = if l == j { program.input_weights[j] + input_curvature[m * k + j] } else { 0.0 };
                        for i in 0..n {
                            sum += step.b[m * i + j] * cost_b[m * i + l];
                        }
                        factor[m * j + l] = match (fixed[j] || fixed[l], j == l) {
                            (false, _) => sum,
                            (true, true) => 1.0,
                            (true, false) => 0.0,
                        };
                    }
                    for i in 0..n {
                        let mut sum = 0.0;
                        for l in 0..n {
                            sum += step.b[m * l + j] * cost_a[n * l + i];
                        }
                        cross[n * j + i] = if fixed[j] { 0.0 } else { sum };
                        gain[n * j + i] = -cross[n * j + i];
                    }
                }
                cholesky(factor, m);
                divide(factor, m, gain, n);
            }
            for j in 0..m {
                let mut sum = input_slopes[m * k + j];
                for i in 0..n {
                    sum += step.b[m * i + j] * slope[i];
                }
                constant[j] = if fixed[j] { 0.0 } else { -sum };
            }
            divide(factor, m, constant, 1);
            if k == 0 {
                break;
            }
            for j in 0..n {
                let mut sum = self.slopes[n * k + j];
                for i in 0..n {
                    sum += step.a[n * i + j] * slope[i];
                }
                for l in 0..m {
                    sum += cross[n * l + j] * constant[l];
                }
                later[j] = sum;
            }
            slope.copy_from_slice(later);
            if fresh {
                for j in 0..n {
                    for i in 0..=j {
                        let mut sum = if i == j { program.weights[j] } else { 0.0 };
                        for l in 0..n {
                            sum += step.a[n * l + j] * cost_a[n * l + i];
                        }
                        for l in 0..m {
                            sum += cross[n * l + j] * gain[n * l + i];
                        }
                        cost[n * j + i] = sum;
                        cost[n * i + j] = sum;
                    }
                }
            }
        }
    }

    /// The moves of the free inputs along the displaced path.
    fn forward(&mut self, program: &Program, instance: &Instance<'_>) {
        let (n, m) = (program.states(), program.inputs());
        let Direction { step: moves, fixed, gain, constant, displacement, .. } = &mut self.direction;
        for k in 0..program.horizon {
            let (now, next) = displacement[n * k..].split_at_mut(n);
            for j in (0..m).filter(|&j| !fixed[m * k + j]) {
                let mut sum = constant[m * k + j];
                for i in 0..n {
                    sum += gain[(m * k + j) * n + i] * now[i];
                }
                moves[m * k + j] = sum;
            }
            let step = &program.steps[instance.sequence[k]];
            for i in 0..n {
                let mut sum = 0.0;
                for l in 0..n {
                    sum += step.a[n * i + l] * now[l];
                }
                for j in 0..m {
                    sum += step.b[m * i + j] * moves[m * k + j];
                }
                next[i] = sum;
            }
        }
    }
}

/// P S of a symmetric P (n x n) and S (n x columns).
fn product(p: &[f64], s: &[f64], columns: usize, out: &mut [f64]) {
    let n = s.len() / columns;
    for i in 0..n {
        for j in 0..columns {
            let mut sum = 0.0;
            for l in 0..n {
                sum += p[n * i + l] * s[columns * l + j];
            }
            out[columns * i + j] = sum;
        }
    }
}

/// The lower Cholesky factor (m x m), in place, with the inverse of its diagonal on the diagonal.
fn cholesky(a: &mut [f64], m: usize) {
    for j in 0..m {
        for i in j..m {
            let mut sum = a[m * i + j];
            for l in 0..j {
                sum -= a[m * i + l] * a[m * j + l];
            }
            a[m * i + j] = if i == j { 1.0 / sum.sqrt() } else { sum * a[(m + 1) * j] };
        }
    }
}

/// Solves L L' y = b in place for every column of b (m x columns), with the L of [`cholesky`].
fn divide(factor: &[f64], m: usize, b: &mut [f64], columns: usize) {
    for c in 0..columns {
        for j in 0..m {
            let mut sum = b[columns * j + c];
            for l in 0..j {
                sum -= factor[m * j + l] * b[columns * l + c];
            }
            b[columns * j + c] = sum * factor[(m + 1) * j];
        }
        for j in (0..m).rev() {
            let mut sum = b[columns * j + c];
            for l in j + 1..m {
                sum -= factor[m * l + j] * b[columns * l + c];
            }
            b[columns * j + c] = sum * factor[(m + 1) * j];
        }
    }
}

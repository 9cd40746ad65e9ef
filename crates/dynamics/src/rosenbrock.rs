//! Steps of stiff equations: the L-stable Rosenbrock pair 4(3) RODAS, with exact Jacobians.
//!
//! Hairer and Wanner, "Solving ordinary differential equations II", section IV.7; coefficients of their code RODAS.
//! Every stage solves `(I/(h gamma) - J) U = f + sum c/h U + h d f_t`.

use faer::{Mat, linalg::solvers::Solve};

use crate::{Points, Stepper, StepperWorkspace, Tangent, angle::wrap, step_control::StepControl};

const GAMMA: f64 = 0.25;
/// Nodes: the share of the step at which each stage stands.
const NODES: [f64; 6] = [0.0, 0.386, 0.21, 0.63, 1.0, 1.0];
/// Coefficients of the earlier stages in the states of each stage. The solution is the states of the last stage plus its U.
const STATES: [[f64; 5]; 6] = [
    [0.0; 5],
    [1.544, 0.0, 0.0, 0.0, 0.0],
    [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
    [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0],
];
/// Coefficients of the earlier stages in the right side of each stage, divided by the step.
const SIDES: [[f64; 5]; 6] = [
    [0.0; 5],
    [-5.6688, 0.0, 0.0, 0.0, 0.0],
    [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
    [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
    [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616, 0.0],
    [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
];
/// Coefficient of the derivative by time in each stage, times the step.
const TIMES: [f64; 6] = [0.25, -0.1043, 0.1035, -0.03620000000000023, 0.0, 0.0];

/// The order of the error that is estimated, in the step.
pub(crate) const ERROR_ORDER: f64 = 4.0;

/// Memory of the stages.
pub(crate) struct Rosenbrock {
    tangent: Tangent,
    /// U of each stage: states x points.
    stages: [Vec<f64>; 6],
    /// Norm of each point's Jacobian in the sizes of its states, 1/s.
    pub(crate) rate: Vec<f64>,
}

impl Rosenbrock {
    /// For so many points; nothing where the equations have no derivatives.
    pub(crate) fn new(stepper: &Stepper, count: usize) -> Option<Self> {
        let values = stepper.states.len() * count;
        let tangent = Tangent::new(stepper).ok()?;
        Some(Self { tangent, stages: std::array::from_fn(|_| vec![0.0; values]), rate: vec![0.0; count] })
    }

    /// Tries the steps of the control: their ends and estimated errors. `begin` are the times at which the interval begins.
    pub(crate) fn attempt(
        &mut self,
        stepper: &Stepper,
        points: &mut Points,
        begin: &[f64],
        control: &mut StepControl,
        workspace: &mut StepperWorkspace,
    ) {
        let (count, states) = (points.count(), stepper.states.len());
        let active = control.active();
        self.place(stepper, points, begin, 0, control, &active);
        stepper.evaluate(points, workspace);
        let mut sides = right_sides(stepper, count, workspace);
        let slopes = self.tangent.right_slopes(stepper, points, workspace);
        let by_time = self.by_time(stepper, points, begin, control, &active, &sides, workspace);
        let width = slopes.len() / (count * states).max(1);
        let n = control.continuous.len();
        let factored: Vec<_> = active
            .iter()
            .map(|&b| {
                let jacobian = |row: usize, column: usize| {
                    slopes[(b * states + control.continuous[row]) * width + control.continuous[column]]
                };
                let size = |at: usize| stepper.states[control.continuous[at]].size();
                let scaled = |row: usize| (0..n).map(move |column| (row, column));
                let sum = |row| scaled(row).map(|(i, j)| (jacobian(i, j) * size(j) / size(i)).abs()).sum::<f64>();
                self.rate[b] = (0..n).map(sum).fold(0.0, f64::max);
                let diagonal = 1.0 / (GAMMA * control.tried[b]);
                Mat::from_fn(n, n, |i, j| if i == j { diagonal } else { 0.0 } - jacobian(i, j)).partial_piv_lu()
            })
            .collect();
        for stage in 0..NODES.len() {
            if stage > 0 {
                self.place(stepper, points, begin, stage, control, &active);
                stepper.evaluate(points, workspace);
                sides = right_sides(stepper, count, workspace);
            }
            for (&b, lu) in active.iter().zip(&factored) {
                let h = control.tried[b];
                let side = |row: usize| {
                    let i = control.continuous[row] * count + b;
                    let before: f64 = (0..stage).map(|k| SIDES[stage][k] * self.stages[k][i]).sum();
                    sides[i] + before / h + h * TIMES[stage] * by_time[i]
                };
                let solved = lu.solve(Mat::from_fn(n, 1, |row, _| side(row)));
                (0..n).for_each(|row| self.stages[stage][control.continuous[row] * count + b] = solved[(row, 0)]);
            }
        }
        self.end(stepper, count, control, &active);
    }

    /// The states of a stage, and its time.
    fn place(
        &self,
        stepper: &Stepper,
        points: &mut Points,
        begin: &[f64],
        stage: usize,
        control: &StepControl,
        active: &[usize],
    ) {
        let count = points.count();
        for &b in active {
            points.set_elapsed(b, begin[b], control.elapsed[b] + NODES[stage] * control.tried[b]);
            for &s in &control.continuous {
                let i = s * count + b;
                points.column_mut(stepper.states[s].column, 0)[b] = control.present[i] + self.sum(stage, i);
            }
        }
    }

    fn sum(&self, stage: usize, i: usize) -> f64 {
        (0..stage).map(|k| STATES[stage][k] * self.stages[k][i]).sum()
    }

    /// The ends of the steps, and their estimated errors.
    fn end(&self, stepper: &Stepper, count: usize, control: &mut StepControl, active: &[usize]) {
        let last = NODES.len() - 1;
        for &b in active {
            for s in control.continuous.clone() {
                let i = s * count + b;
                let value = control.present[i] + self.sum(last, i) + self.stages[last][i];
                control.trial[i] = if stepper.states[s].advance.angle { wrap(value) } else { value };
                control.error[i] = self.stages[last][i].abs();
            }
        }
    }

    /// Derivatives of the right sides by time, through values that change within a row: `time()`, and moving inputs. By
    /// a difference, as in RODAS.
    #[expect(clippy::too_many_arguments, reason = "what the step has at hand")]
    fn by_time(
        &self,
        stepper: &Stepper,
        points: &mut Points,
        begin: &[f64],
        control: &StepControl,
        active: &[usize],
        sides: &[f64],
        workspace: &mut StepperWorkspace,
    ) -> Vec<f64> {
        let count = points.count();
        let mut by_time = vec![0.0; sides.len()];
        if !stepper.uses_time() && !points.has_ramps() {
            return by_time;
        }
        let delta = |b: usize| (f64::EPSILON * (begin[b] + control.elapsed[b]).abs().max(1e-5)).sqrt();
        for &b in active {
            points.set_elapsed(b, begin[b], control.elapsed[b] + delta(b));
        }
        stepper.evaluate(points, workspace);
        let later = right_sides(stepper, count, workspace);
        for &b in active {
            for i in control.continuous.iter().map(|s| s * count + b) {
                by_time[i] = (later[i] - sides[i]) / delta(b);
            }
        }
        by_time
    }
}

/// The right sides after an evaluation, states x points.
pub(crate) fn right_sides(stepper: &Stepper, count: usize, workspace: &StepperWorkspace) -> Vec<f64> {
    (0..stepper.states.len()).flat_map(|state| stepper.right_side(state, count, workspace).to_vec()).collect()
}

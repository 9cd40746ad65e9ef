//! Programs of predictive control by an interior-point solver, written down with states and slacks as variables.

use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT},
};
use fleetfoot_control::predictive::{Instance, Program};

/// A sparse matrix in the making: row, column, value.
type Entries = Vec<(usize, usize, f64)>;

/// The matrix of entries at different places.
fn matrix(rows: usize, columns: usize, mut entries: Entries) -> CscMatrix {
    entries.sort_unstable_by_key(|&(row, column, _)| (column, row));
    let mut starts = vec![0; columns + 1];
    entries.iter().for_each(|&(_, column, _)| starts[column + 1] += 1);
    (0..columns).for_each(|column| starts[column + 1] += starts[column]);
    let indices = entries.iter().map(|entry| entry.0).collect();
    CscMatrix::new(rows, columns, starts, indices, entries.iter().map(|entry| entry.2).collect())
}

/// Objective, equations `x_(k+1) - A x_k - B v_k = c` and inequalities of a program.
pub(crate) struct Interior {
    quadratic: CscMatrix,
    linear: Vec<f64>,
    rows: CscMatrix,
    right: Vec<f64>,
    cones: [SupportedConeT<f64>; 2],
    inputs: usize,
}

impl Interior {
    /// Variables are all inputs, then the states behind the start, then a slack for every bound of every sample.
    pub(crate) fn new(program: &Program, instance: &Instance<'_>) -> Self {
        let (n, m, last) = (program.weights.len(), program.input_weights.len(), program.horizon);
        let (state, slack) = (|k: usize, i: usize| last * m + (k - 1) * n + i, last * (m + n));
        let count = slack + last * program.bounds.len();
        let (mut quadratic, mut linear): (Entries, _) = (Vec::new(), vec![0.0; count]);
        for at in 0..last * m {
            quadratic.push((at, at, program.input_weights[at % m]));
            linear[at] = -program.input_weights[at % m] * instance.input_target[at % m];
        }
        for k in 1..=last {
            for i in 0..n {
                for j in 0..n {
                    let weight = match () {
                        () if k == last => program.terminal[n * i + j],
                        () if i == j => program.weights[i],
                        () => 0.0,
                    };
                    // The upper triangle is the whole.
                    if i <= j {
                        quadratic.push((state(k, i), state(k, j), weight));
                    }
                    linear[state(k, i)] -= weight * instance.target[j];
                }
            }
        }
        let (mut rows, mut right): (Entries, Vec<f64>) = (Vec::new(), Vec::new());
        for k in 0..last {
            let region = instance.sequence[k];
            let step = &program.steps[region];
            for i in 0..n {
                let (row, mut constant) = (right.len(), instance.constants[n * region + i]);
                rows.push((row, state(k + 1, i), 1.0));
                (0..m).for_each(|j| rows.push((row, m * k + j, -step.b[m * i + j])));
                for j in 0..n {
                    match k {
                        0 => constant += step.a[n * i + j] * instance.start[j],
                        _ => rows.push((row, state(k, j), -step.a[n * i + j])),
                    }
                }
                right.push(constant);
            }
        }
        let equations = right.len();
        for at in 0..last * m {
            for (sign, limit) in [(-1.0, -instance.limits[at % m][0]), (1.0, instance.limits[at % m][1])] {
                if limit.is_finite() {
                    rows.push((right.len(), at, sign));
                    right.push(limit);
                }
            }
        }
        for k in 1..=last {
            for (b, bound) in program.bounds.iter().enumerate() {
                let violation = slack + (k - 1) * program.bounds.len() + b;
                quadratic.push((violation, violation, bound.weight));
                for (sign, limit) in [(-1.0, -bound.lowest), (1.0, bound.highest)] {
                    if limit.is_finite() {
                        rows.push((right.len(), state(k, bound.state), sign));
                        rows.push((right.len(), violation, -1.0));
                        right.push(limit);
                    }
                }
            }
        }
        let cones = [SupportedConeT::ZeroConeT(equations), SupportedConeT::NonnegativeConeT(right.len() - equations)];
        Self {
            quadratic: matrix(count, count, quadratic),
            linear,
            rows: matrix(right.len(), count, rows),
            right,
            cones,
            inputs: last * m,
        }
    }

    /// The plan, solved to a tolerance.
    pub(crate) fn solve(&self, tolerance: f64) -> Option<Vec<f64>> {
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: tolerance,
            tol_gap_rel: tolerance,
            tol_feas: tolerance,
            max_iter: 500,
            ..DefaultSettings::default()
        };
        let mut solver =
            DefaultSolver::new(&self.quadratic, &self.linear, &self.rows, &self.right, &self.cones, settings).ok()?;
        solver.solve();
        let solved = solver.solution.status == SolverStatus::Solved;
        solved.then(|| solver.solution.x[..self.inputs].to_vec())
    }
}

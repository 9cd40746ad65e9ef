//! The optimal affine law about a set point for one step model.

use faer::{Mat, MatRef, linalg::solvers::Solve};

use super::setpoint::shortest;
use crate::linear::{Mode, Riccati, riccati, times, unreached_modes};

/// Remainder of a motion, in sizes of states, below which it counts as cancelled.
const CANCELLED: f64 = 1e-9;
/// The least weight of a state, of its inverse square size: states that cost nothing may be anywhere, but not everywhere.
const LEAST_WEIGHT: f64 = 1e-3;

/// Weights and sizes of a design.
pub(super) struct Weights {
    /// Of the n states that are kept.
    pub(super) q: Vec<f64>,
    /// Of the m inputs that are driven.
    pub(super) r: Vec<f64>,
    /// States whose error is integrated, and the weights of the integrals.
    pub(super) integrated: Vec<(usize, f64)>,
    /// States that a disturbance must not move, where inputs can see to that.
    pub(super) held: Vec<bool>,
    pub(super) state_sizes: Vec<f64>,
    pub(super) input_sizes: Vec<f64>,
    pub(super) period: f64,
}

/// The law `u = -K e - L z`, and its answer to a constant disturbance.
pub(super) struct Gains {
    /// m x n.
    pub(super) state: Mat<f64>,
    /// m x q.
    pub(super) integral: Mat<f64>,
    pub(super) residual: f64,
    pub(super) radius: f64,
    a: Mat<f64>,
    b: Mat<f64>,
    solved: Riccati,
    /// Inputs and states of the design's coordinates (sizes).
    scales: (Vec<f64>, Vec<f64>),
}

/// Answer to a constant disturbance.
pub(super) struct Answer {
    /// The errors at the nearest rest (n).
    pub(super) errors: Vec<f64>,
    /// The inputs there (m).
    pub(super) inputs: Vec<f64>,
    /// Inputs beside the feedback of errors about the set point (m).
    pub(super) command: Vec<f64>,
    /// True if the step can rest under the disturbance.
    pub(super) rests: bool,
}

impl Weights {
    /// The step with the integrals `z+ = z + h e` behind the states, in sizes.
    fn extended(&self, a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> (Mat<f64>, Mat<f64>, Vec<f64>) {
        let (n, q) = (self.q.len(), self.integrated.len());
        let sizes: Vec<f64> = self
            .state_sizes
            .iter()
            .copied()
            .chain(self.integrated.iter().map(|&(state, _)| self.state_sizes[state]))
            .collect();
        let entry = |i: usize, j: usize| match (i < n, j < n) {
            (true, true) => a[(i, j)],
            (true, false) => 0.0,
            (false, true) if self.integrated[i - n].0 == j => self.period,
            (false, true) => 0.0,
            (false, false) => f64::from(u8::from(i == j)),
        };
        let scaled_a = Mat::from_fn(n + q, n + q, |i, j| entry(i, j) * sizes[j] / sizes[i]);
        let scaled_b =
            Mat::from_fn(n + q, b.ncols(), |i, j| if i < n { b[(i, j)] * self.input_sizes[j] / sizes[i] } else { 0.0 });
        (scaled_a, scaled_b, sizes)
    }

    /// Modes that the inputs do not reach; shares of the states, then of the integrals.
    pub(super) fn unreached(&self, a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Vec<Mode> {
        let (a, b, _) = self.extended(a, b);
        unreached_modes(a.as_ref(), b.as_ref())
    }

    /// The law of a step model; `None` where Riccati's equation has no solution.
    pub(super) fn gains(&self, a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Option<Gains> {
        let (n, m) = (self.q.len(), self.r.len());
        let (scaled_a, scaled_b, sizes) = self.extended(a, b);
        let weights: Vec<f64> =
            self.q.iter().copied().chain(self.integrated.iter().map(|&(_, weight)| weight)).collect();
        let diagonal = |weights: &[f64], sizes: &[f64]| {
            Mat::from_fn(
                weights.len(),
                weights.len(),
                |i, j| {
                    if i == j { weights[i] * sizes[i] * sizes[i] } else { 0.0 }
                },
            )
        };
        let (q, r) = (diagonal(&weights, &sizes), diagonal(&self.r, &self.input_sizes));
        let solved = riccati(scaled_a.as_ref(), scaled_b.as_ref(), q.as_ref(), r.as_ref())?;
        let gain = |i: usize, j: usize| solved.gain[(i, j)] * self.input_sizes[i] / sizes[j];
        Some(Gains {
            state: Mat::from_fn(m, n, gain),
            integral: Mat::from_fn(m, weights.len() - n, |i, j| gain(i, n + j)),
            residual: solved.residual,
            radius: solved.radius,
            a: scaled_a,
            b: scaled_b,
            scales: (self.input_sizes.clone(), sizes),
            solved,
        })
    }

    /// Inputs that a constant disturbance d of the step requires.
    ///
    /// First the nearest rest: the errors e and inputs v of least cost `e'Qe + v'Rv` with `(A - I) e + B v + d = 0`.
    /// Held states have no error if that is possible. Feedback then goes about e. The affine term of the optimal cost,
    /// `(R + B'XB)^-1 B' (I - (A - BK)')^-1 X d`, meets the part that no rest cancels.
    pub(super) fn answer(&self, gains: &Gains, a: MatRef<'_, f64>, b: MatRef<'_, f64>, d: &[f64]) -> Answer {
        let (n, m) = b.shape();
        let unit = |weight: f64, size: f64| 1.0 / weight.max(LEAST_WEIGHT / (size * size)).sqrt();
        let units: Vec<f64> = (self.q.iter().zip(&self.state_sizes).map(|(&q, &size)| unit(q, size)))
            .chain(self.r.iter().map(|r| 1.0 / r.sqrt()))
            .collect();
        let find = |used: &dyn Fn(usize) -> bool| {
            let columns: Vec<usize> = (0..n + m).filter(|&v| used(v)).collect();
            let matrix = Mat::from_fn(n, columns.len(), |i, j| {
                let v = columns[j];
                let entry = if v < n { a[(i, v)] - f64::from(u8::from(i == v)) } else { b[(i, v - n)] };
                entry * units[v] / self.state_sizes[i]
            });
            let right: Vec<f64> = d.iter().zip(&self.state_sizes).map(|(d, size)| -d / size).collect();
            let step = shortest(&matrix, &right).unwrap_or_else(|| vec![0.0; columns.len()]);
            let (mut e, mut v) = (vec![0.0; n], vec![0.0; m]);
            for (&variable, step) in columns.iter().zip(&step) {
                let value = if variable < n { &mut e[variable] } else { &mut v[variable - n] };
                *value = step * units[variable];
            }
            let moved = times(a, &e);
            let driven = times(b, &v);
            let left: Vec<f64> = (0..n).map(|i| moved[i] - e[i] + driven[i] + d[i]).collect();
            let largest =
                left.iter().zip(&self.state_sizes).map(|(left, size)| (left / size).abs()).fold(0.0, f64::max);
            (e, v, left, largest)
        };
        let (mut e, mut v, mut left, mut largest) = find(&|variable| variable >= n || !self.held[variable]);
        let sizeable = d.iter().zip(&self.state_sizes).map(|(d, size)| (d / size).abs()).fold(0.0, f64::max);
        if largest > CANCELLED * sizeable {
            (e, v, left, largest) = find(&|_| true);
        }
        let rests = largest <= CANCELLED * sizeable.max(CANCELLED);
        let back = times(gains.state.as_ref(), &e);
        let further = if rests { vec![0.0; m] } else { gains.against(&left) };
        let command = (0..m).map(|j| v[j] + back[j] - further[j]).collect();
        Answer { errors: e, inputs: v, command, rests }
    }
}

impl Gains {
    /// Cost X of errors and integrals, `x'X x`, in their units.
    pub(super) fn cost(&self) -> Mat<f64> {
        let sizes = &self.scales.1;
        Mat::from_fn(sizes.len(), sizes.len(), |i, j| self.solved.x[(i, j)] / (sizes[i] * sizes[j]))
    }

    /// The affine term of the optimal law for a constant disturbance of the states (n).
    fn against(&self, disturbance: &[f64]) -> Vec<f64> {
        let (inputs, sizes) = &self.scales;
        let n = self.a.nrows();
        let scaled = Mat::from_fn(n, 1, |i, _| disturbance.get(i).map_or(0.0, |d| d / sizes[i]));
        let closed = &self.a - &self.b * &self.solved.gain;
        let remaining =
            (Mat::<f64>::identity(n, n) - closed.transpose()).partial_piv_lu().solve(&self.solved.x * scaled);
        // (R + B'XB) K = B'XA, so the factor of the disturbance is found from the same matrix.
        let factor = self.solved.weighed.partial_piv_lu().solve(self.b.transpose() * remaining);
        (0..inputs.len()).map(|j| factor[(j, 0)] * inputs[j]).collect()
    }
}

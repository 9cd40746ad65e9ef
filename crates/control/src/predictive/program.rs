//! The program of a sample.

/// The fixed part of a program, in dimensionless states (n) and inputs (m); matrices by rows.
///
/// Over the inputs `v_0 .. v_(N-1)` within their limits it minimises
///
/// ```text
///   1/2 sum_k (v_k - v*)' R (v_k - v*)  +  1/2 sum_(k<N) (x_k - x*)' Q (x_k - x*)  +  1/2 (x_N - x*)' X (x_N - x*)
/// + 1/2 sum_(k>0) sum_b w_b (max(0, x_k - h_b)^2 + max(0, l_b - x_k)^2)
/// ```
///
/// along `x_(k+1) = A x_k + B v_k + c`, with A, B and c of the region of sample k. Q and R are diagonal. R is positive,
/// so that the objective is strictly convex and has one minimum. Bounds `[l_b, h_b]` of states are soft, so that a
/// point within the limits always exists.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// N, samples.
    pub horizon: usize,
    /// A and B of every region.
    pub steps: Vec<ProgramStep>,
    /// Q (n).
    pub weights: Vec<f64>,
    /// R (m).
    pub input_weights: Vec<f64>,
    /// X (n x n).
    pub terminal: Vec<f64>,
    /// Soft bounds of states.
    pub bounds: Vec<ProgramBound>,
    /// Second derivatives by which gradients are divided in the residual (m): the diagonal of `R + B'XB`.
    pub curvature: Vec<f64>,
}

/// The step of a region.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramStep {
    /// A (n x n).
    pub a: Vec<f64>,
    /// B (n x m).
    pub b: Vec<f64>,
}

/// A soft bound of a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgramBound {
    /// Index of the state.
    pub state: usize,
    /// Lowest value.
    pub lowest: f64,
    /// Highest value.
    pub highest: f64,
    /// Weight of the squared violation.
    pub weight: f64,
}

/// The part of a program that changes from sample to sample.
#[derive(Debug, Clone, Copy)]
pub struct Instance<'a> {
    /// The present state (n).
    pub start: &'a [f64],
    /// Region of every sample (N).
    pub sequence: &'a [usize],
    /// c of every region, one after the other (regions x n).
    pub constants: &'a [f64],
    /// Lowest and highest value of every input (m).
    pub limits: &'a [[f64; 2]],
    /// x* (n).
    pub target: &'a [f64],
    /// v* (m).
    pub input_target: &'a [f64],
}

impl Program {
    /// n.
    pub fn states(&self) -> usize {
        self.weights.len()
    }

    /// m.
    pub fn inputs(&self) -> usize {
        self.input_weights.len()
    }

    /// Writes the path of the states under a plan (N x m) from the start: (N + 1) x n.
    pub fn path(&self, instance: &Instance<'_>, plan: &[f64], path: &mut [f64]) {
        let (n, m) = (self.states(), self.inputs());
        path[..n].copy_from_slice(instance.start);
        for (k, &region) in instance.sequence.iter().enumerate() {
            let (now, next) = path[n * k..].split_at_mut(n);
            self.step(region, instance.constants, now, &plan[m * k..][..m], &mut next[..n]);
        }
    }

    /// The state behind a sample in a region.
    pub(crate) fn step(&self, region: usize, constants: &[f64], x: &[f64], v: &[f64], next: &mut [f64]) {
        let (n, m) = (self.states(), self.inputs());
        let ProgramStep { a, b } = &self.steps[region];
        for (i, next) in next.iter_mut().enumerate() {
            *next = constants[n * region + i] + dot(&a[n * i..][..n], x) + dot(&b[m * i..][..m], v);
        }
    }

    /// The objective of a plan and its path.
    pub fn cost(&self, instance: &Instance<'_>, plan: &[f64], path: &[f64]) -> f64 {
        let (n, m) = (self.states(), self.inputs());
        let mut cost = 0.0;
        for v in plan.chunks_exact(m) {
            for ((v, target), weight) in v.iter().zip(instance.input_target).zip(&self.input_weights) {
                cost += weight * (v - target) * (v - target);
            }
        }
        for (k, x) in path.chunks_exact(n).enumerate() {
            if k < self.horizon {
                for ((x, target), weight) in x.iter().zip(instance.target).zip(&self.weights) {
                    cost += weight * (x - target) * (x - target);
                }
            } else {
                for (i, row) in self.terminal.chunks_exact(n).enumerate() {
                    let along: f64 = row.iter().zip(x).zip(instance.target).map(|((p, x), t)| p * (x - t)).sum();
                    cost += along * (x[i] - instance.target[i]);
                }
            }
            for bound in self.bounds.iter().filter(|_| k > 0) {
                let violation = bound.violation(x[bound.state]);
                cost += bound.weight * violation * violation;
            }
        }
        0.5 * cost
    }
}

impl ProgramBound {
    /// Distance of a value beyond the bound: positive above, negative below, else 0.
    pub(crate) fn violation(&self, x: f64) -> f64 {
        if x > self.highest {
            x - self.highest
        } else if x < self.lowest {
            x - self.lowest
        } else {
            0.0
        }
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        sum += a * b;
    }
    sum
}

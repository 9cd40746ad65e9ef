//! Recurrent cells: their equations over tiles, forward and in reverse.

use crate::{Activation, samples::TILE};

/// Recurrent cell: the state `h'` from the inputs `x` and the state `h` of the step before.
///
/// Weights `W` (gates units x inputs), `R` (gates units x units), biases `b` and `c` stand gate after gate, in the order below. `s` is the logistic function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Cell {
    /// `h' = tanh(W x + R h + b)` (Elman, "Finding structure in time", 1990).
    Rnn,
    /// Gates r, z, n (Cho et al., 2014, with the reset behind the product, as ONNX has it with `linear_before_reset = 1` and PyTorch always):
    /// `r = s(W_r x + R_r h + b_r)`, `z = s(W_z x + R_z h + b_z)`, `n = tanh(W_n x + b_n + r (R_n h + c))`, `h' = (1 - z) n + z h`.
    Gru,
    /// Gates i, f, g, o (Hochreiter and Schmidhuber, 1997; forget gate: Gers, Schmidhuber and Cummins, 2000):
    /// `i, f, o = s(W x + R h + b)`, `g = tanh(W_g x + R_g h + b_g)`, `m' = f m + i g`, `h' = o tanh(m')`, with a memory `m`.
    Lstm,
}

/// Values of a step that the reverse product needs, for all units of a tile.
#[derive(Default)]
pub(crate) struct Step {
    /// Gates; behind those of the GRU `R_n h + c`.
    pub(crate) gates: Vec<f64>,
    /// State behind the step.
    pub(crate) state: Vec<f64>,
    /// Memory behind the step, and its tanh; empty but for the LSTM.
    memory: Vec<f64>,
    squashed: Vec<f64>,
}

impl Step {
    /// Zeros for so many units.
    pub(crate) fn new(cell: Cell, units: usize) -> Self {
        let memory = if cell == Cell::Lstm { units * TILE } else { 0 };
        Self {
            gates: vec![0.0; cell.sums() * units * TILE],
            state: vec![0.0; units * TILE],
            memory: vec![0.0; memory],
            squashed: vec![0.0; memory],
        }
    }
}

impl Cell {
    /// Gates: rows of weights a unit.
    pub fn gates(self) -> usize {
        match self {
            Self::Rnn => 1,
            Self::Gru => 3,
            Self::Lstm => 4,
        }
    }

    /// True if the product with the state has a bias of its own: `c` of the GRU.
    pub(crate) fn has_state_bias(self) -> bool {
        self == Self::Gru
    }

    /// Sums a unit: those of the gates, and for the GRU the product with the state of its last gate.
    pub(crate) fn sums(self) -> usize {
        self.gates() + usize::from(self.has_state_bias())
    }

    /// Sums that the product with the state adds to, and the gates whose weights it has: first sum, first gate, count.
    pub(crate) fn products(self) -> &'static [[usize; 3]] {
        match self {
            Self::Rnn => &[[0, 0, 1]],
            Self::Gru => &[[0, 0, 2], [3, 2, 1]],
            Self::Lstm => &[[0, 0, 4]],
        }
    }

    /// Replaces the sums of a step by gates, and computes the state behind it.
    pub(crate) fn forward(self, before: &Step, step: &mut Step) {
        let size = step.state.len();
        match self {
            Self::Rnn => {
                Activation::Tanh.apply(&mut step.gates);
                step.state.copy_from_slice(&step.gates);
            }
            Self::Gru => {
                let (gates, product) = step.gates.split_at_mut(3 * size);
                let (switches, candidate) = gates.split_at_mut(2 * size);
                logistic(switches);
                let (reset, update) = switches.split_at(size);
                let parts = candidate.iter_mut().zip(reset).zip(&*product);
                parts.for_each(|((sum, r), q)| *sum += r * q);
                Activation::Tanh.apply(candidate);
                let parts = step.state.iter_mut().zip(&*candidate).zip(update).zip(&before.state);
                parts.for_each(|(((h, n), z), old)| *h = n + z * (old - n));
            }
            Self::Lstm => {
                logistic(&mut step.gates[..2 * size]);
                Activation::Tanh.apply(&mut step.gates[2 * size..3 * size]);
                logistic(&mut step.gates[3 * size..]);
                let gate = |at: usize| &step.gates[at * size..][..size];
                let parts = step.memory.iter_mut().zip(gate(0)).zip(gate(1)).zip(gate(2)).zip(&before.memory);
                parts.for_each(|((((m, i), f), g), old)| *m = f * old + i * g);
                step.squashed.copy_from_slice(&step.memory);
                Activation::Tanh.apply(&mut step.squashed);
                let parts = step.state.iter_mut().zip(gate(3)).zip(&step.squashed);
                parts.for_each(|((h, o), squashed)| *h = o * squashed);
            }
        }
    }

    /// Reverse product of [`Cell::forward`]: the slopes by the sums from those by the state (and the memory) behind the step. Afterwards `by_state` and `by_memory`
    /// are those before the step, but for the products with the state.
    pub(crate) fn backward(
        self,
        (before, step): (&Step, &Step),
        by_state: &mut [f64],
        by_memory: &mut [f64],
        by_sums: &mut [f64],
    ) {
        let size = by_state.len();
        match self {
            Self::Rnn => {
                by_sums.copy_from_slice(by_state);
                Activation::Tanh.chain(&step.gates, by_sums);
                by_state.fill(0.0);
            }
            Self::Gru => {
                for (k, slope) in by_state.iter_mut().enumerate() {
                    let [r, z, n, q] = [0, 1, 2, 3].map(|at| step.gates[at * size + k]);
                    let by_candidate = *slope * (1.0 - z) * (1.0 - n * n);
                    by_sums[k] = by_candidate * q * r * (1.0 - r);
                    by_sums[size + k] = *slope * (before.state[k] - n) * z * (1.0 - z);
                    by_sums[2 * size + k] = by_candidate;
                    by_sums[3 * size + k] = by_candidate * r;
                    *slope *= z;
                }
            }
            Self::Lstm => {
                for (k, (slope, along)) in by_state.iter_mut().zip(by_memory).enumerate() {
                    let [i, f, g, o] = [0, 1, 2, 3].map(|at| step.gates[at * size + k]);
                    let squashed = step.squashed[k];
                    let by_new = *along + *slope * o * (1.0 - squashed * squashed);
                    by_sums[k] = by_new * g * i * (1.0 - i);
                    by_sums[size + k] = by_new * before.memory[k] * f * (1.0 - f);
                    by_sums[2 * size + k] = by_new * i * (1.0 - g * g);
                    by_sums[3 * size + k] = *slope * squashed * o * (1.0 - o);
                    *along = by_new * f;
                    *slope = 0.0;
                }
            }
        }
    }
}

/// The logistic function of sums, by the tanh of their halves.
fn logistic(sums: &mut [f64]) {
    sums.iter_mut().for_each(|sum| *sum *= 0.5);
    Activation::Tanh.apply(sums);
    sums.iter_mut().for_each(|value| *value = 0.5 + 0.5 * *value);
}

//! Equations of recurrent cells for one row: a step, and its products with the Jacobian.

/// Recurrent cell: the state `h'` from the inputs `x` and the state `h` of the step before. `s` is the logistic function.
///
/// Weights W and R, and biases b, stand gate after gate, in the order of the letters below.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Cell {
    /// `h' = tanh(W x + R h + b)` (Elman, "Finding structure in time", 1990).
    Rnn,
    /// Gates r, z, n (Cho et al., 2014; the reset acts behind the product, as in PyTorch, and in ONNX with `linear_before_reset = 1`):
    /// `r, z = s(W x + R h + b)`, `n = tanh(W_n x + b_n + r (R_n h + c))`, `h' = (1 - z) n + z h`.
    Gru,
    /// Gates i, f, g, o (Hochreiter and Schmidhuber, 1997; f: Gers, Schmidhuber and Cummins, 2000): `i, f, o = s(W x + R h + b)`,
    /// `g = tanh(W_g x + R_g h + b_g)`, `m' = f m + i g`, `h' = o tanh(m')`, with a memory `m`.
    Lstm,
}

/// Values of a step.
#[derive(Debug, Clone, Default)]
pub(crate) struct Step {
    /// Gates, units together; behind those of the GRU `R_n h + c`.
    pub(crate) gates: Vec<f64>,
    /// State behind the step.
    pub(crate) state: Vec<f64>,
    /// Memory behind the step; the other cells leave it zero.
    pub(crate) memory: Vec<f64>,
}

impl Step {
    /// Zero state of so many units, before the first step.
    pub(crate) fn zero(units: usize) -> Self {
        Self { gates: Vec::new(), state: vec![0.0; units], memory: vec![0.0; units] }
    }
}

impl Cell {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Rnn, Self::Gru, Self::Lstm];

    /// Its name in files: `gru`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rnn => "rnn",
            Self::Gru => "gru",
            Self::Lstm => "lstm",
        }
    }

    /// Gates: rows of weights a unit.
    pub fn gates(self) -> usize {
        match self {
            Self::Rnn => 1,
            Self::Gru => 3,
            Self::Lstm => 4,
        }
    }

    /// True if the product of the last gate's weights with the state has a bias of its own, `c`, and is multiplied by the reset.
    pub fn resets(self) -> bool {
        self == Self::Gru
    }

    /// The step behind `before`, from the sums `W x + b` of all gates and the products `R h`, to which `c` is added.
    #[inline(always)]
    pub(crate) fn step(self, before: &Step, sums: &[f64], products: &[f64], step: &mut Step) {
        let units = before.state.len();
        step.gates.clear();
        step.gates.extend(sums.iter().zip(products).map(|(sum, product)| sum + product));
        let gates = &mut step.gates;
        match self {
            Self::Rnn => {
                gates.iter_mut().for_each(|sum| *sum = sum.tanh());
                step.state.copy_from_slice(gates);
            }
            Self::Gru => {
                gates[..2 * units].iter_mut().for_each(|sum| *sum = logistic(*sum));
                for k in 0..units {
                    let product = products[2 * units + k];
                    gates[2 * units + k] = (sums[2 * units + k] + gates[k] * product).tanh();
                    gates.push(product);
                    let (z, n) = (gates[units + k], gates[2 * units + k]);
                    step.state[k] = (1.0 - z) * n + z * before.state[k];
                }
            }
            Self::Lstm => {
                for k in 0..units {
                    let [i, f, o] = [0, 1, 3].map(|gate| logistic(gates[gate * units + k]));
                    let g = gates[2 * units + k].tanh();
                    for (gate, value) in [i, f, g, o].into_iter().enumerate() {
                        gates[gate * units + k] = value;
                    }
                    step.memory[k] = f * before.memory[k] + i * g;
                    step.state[k] = o * step.memory[k].tanh();
                }
            }
        }
    }

    /// Reverse product of a step: derivatives by the sums `W x + b` and by the products `R h + c`, from those by the state and the memory behind it. Afterwards these
    /// are the ones before it, but for the products.
    pub(crate) fn reverse(self, [before, step]: [&Step; 2], slopes: [&mut [f64]; 2]) -> [Vec<f64>; 2] {
        let [by_state, by_memory] = slopes;
        let units = by_state.len();
        let mut by_sums = vec![0.0; self.gates() * units];
        let mut by_products = Vec::new();
        for k in 0..units {
            let gate = |at: usize| step.gates[at * units + k];
            let slope = by_state[k];
            match self {
                Self::Rnn => {
                    by_sums[k] = slope * (1.0 - gate(0) * gate(0));
                    by_state[k] = 0.0;
                }
                Self::Gru => {
                    let [r, z, n, product] = [gate(0), gate(1), gate(2), gate(3)];
                    let by_candidate = slope * (1.0 - z) * (1.0 - n * n);
                    by_sums[k] = by_candidate * product * r * (1.0 - r);
                    by_sums[units + k] = slope * (before.state[k] - n) * z * (1.0 - z);
                    by_sums[2 * units + k] = by_candidate;
                    by_products.push(by_candidate * r);
                    by_state[k] = slope * z;
                }
                Self::Lstm => {
                    let [i, f, g, o] = [gate(0), gate(1), gate(2), gate(3)];
                    let squashed = step.memory[k].tanh();
                    let by_new = by_memory[k] + slope * o * (1.0 - squashed * squashed);
                    by_sums[k] = by_new * g * i * (1.0 - i);
                    by_sums[units + k] = by_new * before.memory[k] * f * (1.0 - f);
                    by_sums[2 * units + k] = by_new * i * (1.0 - g * g);
                    by_sums[3 * units + k] = slope * squashed * o * (1.0 - o);
                    by_memory[k] = by_new * f;
                    by_state[k] = 0.0;
                }
            }
        }
        let by_products = match self {
            Self::Gru => [&by_sums[..2 * units], &by_products].concat(),
            Self::Rnn | Self::Lstm => by_sums.clone(),
        };
        [by_sums, by_products]
    }

    /// Forward product of a step: changes of state and memory behind it, from those before it, of the sums and of the products.
    pub(crate) fn forward(self, [before, step]: [&Step; 2], along: [&mut [f64]; 2], sums: &[f64], products: &[f64]) {
        let [along_state, along_memory] = along;
        let units = along_state.len();
        for k in 0..units {
            let gate = |at: usize| step.gates[at * units + k];
            let change = |at: usize| sums[at * units + k] + products[at * units + k];
            match self {
                Self::Rnn => along_state[k] = (1.0 - gate(0) * gate(0)) * change(0),
                Self::Gru => {
                    let [r, z, n, product] = [gate(0), gate(1), gate(2), gate(3)];
                    let by_reset = r * (1.0 - r) * change(0) * product + r * products[2 * units + k];
                    let candidate = (1.0 - n * n) * (sums[2 * units + k] + by_reset);
                    let update = z * (1.0 - z) * change(1);
                    along_state[k] = (1.0 - z) * candidate + update * (before.state[k] - n) + z * along_state[k];
                }
                Self::Lstm => {
                    let [i, f, g, o] = [gate(0), gate(1), gate(2), gate(3)];
                    let squashed = step.memory[k].tanh();
                    let kept = f * along_memory[k] + f * (1.0 - f) * change(1) * before.memory[k];
                    along_memory[k] = kept + i * (1.0 - i) * change(0) * g + i * (1.0 - g * g) * change(2);
                    let by_gate = o * (1.0 - o) * change(3) * squashed;
                    along_state[k] = by_gate + o * (1.0 - squashed * squashed) * along_memory[k];
                }
            }
        }
    }
}

/// The logistic function, by tanh: it does not overflow.
fn logistic(sum: f64) -> f64 {
    0.5 + 0.5 * (0.5 * sum).tanh()
}

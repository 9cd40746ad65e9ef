//! Recordings of the canonical systems: states, their exact derivatives, and noise.

use std::{cell::RefCell, f64::consts::TAU};

use fleetfoot::{
    Column,
    data::{MemorySource, mix},
    library::{Expr, Leaf, Program, Scope, Scratch},
    sim::plant::integrator::rk4_step,
};

use super::{Failure, systems::System};

/// Recordings of a system, and rows of each.
pub(crate) const EPISODES: usize = 10;
pub(crate) const ROWS: usize = 1_000;
/// Steps of the integrator from row to row.
const STEPS: usize = 20;

/// The right side of a system, compiled.
pub(crate) struct RightSide {
    program: Program,
    /// State behind every leaf of the program.
    states: Vec<usize>,
    scratch: RefCell<Scratch>,
}

impl RightSide {
    pub(crate) fn new(system: &System) -> Result<Self, Failure> {
        let scope = Scope::new(system.states);
        let mut sums = Vec::new();
        for terms in system.equations {
            let mut sum = Expr::number(0.0);
            for &(function, coefficient) in *terms {
                sum = sum + Expr::number(coefficient) * Expr::parse(function, &scope)?;
            }
            sums.push(sum.simplified());
        }
        let program = Program::compile(&sums, system.states)?;
        let column = |leaf: &Leaf| match *leaf {
            Leaf::Column { column, lag: 0 } => Ok(column),
            _ => Err(format!("{} depends on time or on earlier rows", system.name)),
        };
        let states = program.leaves().iter().map(column).collect::<Result<_, _>>()?;
        Ok(Self { program, states, scratch: RefCell::default() })
    }

    /// The derivatives at a state.
    pub(crate) fn derivative(&self, state: &[f64], out: &mut [f64]) {
        let leaves: Vec<f64> = self.states.iter().map(|&i| state[i]).collect();
        self.program.evaluate_row(&leaves, out, &mut self.scratch.borrow_mut());
    }

    /// The state `seconds` later.
    pub(crate) fn advance(&self, state: &mut [f64], seconds: f64, steps: usize) {
        match state.len() {
            2 => self.advance_fixed::<2>(state, seconds, steps),
            3 => self.advance_fixed::<3>(state, seconds, steps),
            5 => self.advance_fixed::<5>(state, seconds, steps),
            n => unreachable!("no system has {n} states"),
        }
    }

    fn advance_fixed<const N: usize>(&self, state: &mut [f64], seconds: f64, steps: usize) {
        let mut x: [f64; N] = std::array::from_fn(|i| state[i]);
        for _ in 0..steps {
            x = rk4_step(&x, seconds / steps as f64, |x| {
                let mut out = [0.0; N];
                self.derivative(x, &mut out);
                out
            });
        }
        state.copy_from_slice(&x);
    }
}

/// What was recorded of a system: a column a state, one episode after another.
#[derive(Debug, Clone)]
pub(crate) struct Recorded {
    pub(crate) period: f64,
    /// Of every episode, of every state (and input, after them): the values.
    pub(crate) states: Vec<Vec<Vec<f64>>>,
    /// The same of the derivatives, where they are known.
    pub(crate) derivatives: Option<Vec<Vec<Vec<f64>>>>,
}

/// The system without errors, with its exact derivatives.
pub(crate) fn record(system: &System, seed: u64) -> Result<Recorded, Failure> {
    let right = RightSide::new(system)?;
    let n = system.states.len();
    let mut recorded = Recorded { period: system.period, states: Vec::new(), derivatives: Some(Vec::new()) };
    for episode in 0..EPISODES {
        let mut state: Vec<f64> = (0..n)
            .map(|i| {
                let [low, high] = system.begins[i];
                low + (high - low) * uniform(address(seed, &[episode, i]))
            })
            .collect();
        let (mut x, mut dx) = (vec![Vec::with_capacity(ROWS); n], vec![Vec::with_capacity(ROWS); n]);
        let mut derivative = vec![0.0; n];
        for _ in 0..ROWS {
            right.derivative(&state, &mut derivative);
            (0..n).for_each(|i| {
                x[i].push(state[i]);
                dx[i].push(derivative[i]);
            });
            right.advance(&mut state, system.period, STEPS);
        }
        recorded.states.push(x);
        recorded.derivatives.as_mut().into_iter().for_each(|all| all.push(dx.clone()));
    }
    Ok(recorded)
}

impl Recorded {
    /// The states alone, each with Gaussian noise of a share of its own standard deviation over the recording.
    ///
    /// The same seed draws the same numbers for every level: only their size differs.
    pub(crate) fn noisy(&self, level: f64, seed: u64) -> Self {
        let n = self.states[0].len();
        let sizes: Vec<f64> = (0..n).map(|i| level * self.deviation(i)).collect();
        let mut states = self.states.clone();
        for (episode, columns) in states.iter_mut().enumerate() {
            for (i, column) in columns.iter_mut().enumerate() {
                for (row, value) in column.iter_mut().enumerate() {
                    *value += sizes[i] * normal(address(seed, &[1_000 + episode, i, row]));
                }
            }
        }
        Self { period: self.period, states, derivatives: None }
    }

    /// Number of states whose derivatives are sought; columns after them are inputs.
    pub(crate) fn targets(&self) -> usize {
        self.derivatives.as_ref().map_or(self.states[0].len(), |derivatives| derivatives[0].len())
    }

    /// Standard deviation of a state over all episodes.
    fn deviation(&self, state: usize) -> f64 {
        let values = || self.states.iter().flat_map(|columns| &columns[state]);
        let count = values().count() as f64;
        let mean = values().sum::<f64>() / count;
        (values().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// As a source: the columns by their names, then those of the derivatives, `d_x` for a state `x`.
    pub(crate) fn source(&self, names: &[&str]) -> MemorySource {
        let derivatives =
            self.derivatives.iter().flat_map(|_| names[..self.targets()].iter().map(|name| format!("d_{name}")));
        let columns = names.iter().map(|name| (*name).to_owned()).chain(derivatives);
        let mut source = MemorySource::new(columns.map(Column::float).collect());
        for (episode, states) in self.states.iter().enumerate() {
            let mut values = states.clone();
            values.extend(self.derivatives.iter().flat_map(|all| all[episode].iter().cloned()));
            source.push_uniform(format!("recording-{episode}"), self.period, values);
        }
        source
    }
}

/// The address of a random number.
fn address(seed: u64, parts: &[usize]) -> u64 {
    parts.iter().fold(mix(seed), |address, &part| mix(address.wrapping_add(part as u64)))
}

/// Uniform in (0, 1).
fn uniform(address: u64) -> f64 {
    ((mix(address) >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
}

/// Standard normal, by Box and Muller.
fn normal(address: u64) -> f64 {
    (-2.0 * uniform(address).ln()).sqrt() * (TAU * uniform(address ^ 0x9e37_79b9_7f4a_7c15)).cos()
}

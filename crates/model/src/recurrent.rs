//! The last state of a recurrent cell over a window of past rows.

use crate::{
    cell::{Cell, Step},
    map_array::MapArray,
};

/// State of a recurrent cell behind the last step of a window: some functions x of a library, step by step, the oldest first. The state before the first step is zero.
///
/// Every step has the same columns, which are standardised: `(x - centre)/scale`.
#[derive(Debug, Clone, PartialEq)]
pub struct Recurrent {
    /// The cell, which has the equations.
    pub cell: Cell,
    /// Indices of the functions x in the library, steps x columns, step after step.
    pub inputs: Vec<usize>,
    /// Centre of each column.
    pub centre: Vec<f64>,
    /// Scale of each column.
    pub scale: Vec<f64>,
    /// W, gates units x columns.
    pub input_weights: Vec<Vec<f64>>,
    /// R, gates units x units.
    pub state_weights: Vec<Vec<f64>>,
    /// b, gates units.
    pub biases: Vec<f64>,
    /// c of a GRU, units; empty for the others.
    pub state_biases: Vec<f64>,
}

impl Recurrent {
    /// The name of a unit in text for people: `unit1`.
    pub fn name(index: usize) -> String {
        format!("unit{}", index + 1)
    }

    /// Number of units.
    pub fn count(&self) -> usize {
        self.biases.len() / self.cell.gates()
    }

    /// Columns of a step.
    pub fn columns(&self) -> usize {
        self.centre.len()
    }

    /// Steps of the window.
    pub fn steps(&self) -> usize {
        self.inputs.len() / self.columns().max(1)
    }

    /// Weights and biases of the cell.
    pub fn numbers(&self) -> usize {
        let weights = self.input_weights.iter().chain(&self.state_weights).map(Vec::len).sum::<usize>();
        weights + self.biases.len() + self.state_biases.len()
    }

    /// The state behind the last step.
    pub fn evaluate(&self, inputs: &[f64], values: &mut [f64]) {
        let (mut before, mut step) = (Step::zero(self.count()), Step::zero(self.count()));
        for row in inputs.chunks_exact(self.columns()) {
            self.step(row, &before, &mut step);
            std::mem::swap(&mut before, &mut step);
        }
        values.copy_from_slice(&before.state);
    }

    fn step(&self, row: &[f64], before: &Step, step: &mut Step) {
        let x: Vec<f64> = row.iter().zip(self.centre.iter().zip(&self.scale)).map(|(x, (c, s))| (x - c) / s).collect();
        let rows = self.input_weights.iter().zip(&self.biases);
        let sums: Vec<f64> = rows.map(|(weights, bias)| bias + product(weights, &x)).collect();
        let mut products = self.products(&before.state);
        let first = products.len() - self.state_biases.len();
        products[first..].iter_mut().zip(&self.state_biases).for_each(|(sum, bias)| *sum += bias);
        self.cell.step(before, &sums, &products, step);
    }

    fn products(&self, state: &[f64]) -> Vec<f64> {
        self.state_weights.iter().map(|weights| product(weights, state)).collect()
    }

    /// The zero state, then all steps.
    fn trajectory(&self, inputs: &[f64]) -> Vec<Step> {
        let mut steps = vec![Step::zero(self.count())];
        for (at, row) in inputs.chunks_exact(self.columns()).enumerate() {
            let mut step = Step::zero(self.count());
            self.step(row, &steps[at], &mut step);
            steps.push(step);
        }
        steps
    }

    /// Reverse product: adds `sum_k weights_k d unit_k / d x_i` to the slope of every input.
    pub fn gradient(&self, inputs: &[f64], weights: &[f64], slopes: &mut [f64]) {
        let steps = self.trajectory(inputs);
        let (mut by_state, mut by_memory) = (weights.to_vec(), vec![0.0; weights.len()]);
        for (at, slopes) in slopes.chunks_exact_mut(self.columns()).enumerate().rev() {
            let pair = [&steps[at], &steps[at + 1]];
            let [by_sums, by_products] = self.cell.reverse(pair, [&mut by_state, &mut by_memory]);
            for (weights, slope) in self.state_weights.iter().zip(&by_products) {
                by_state.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += slope * weight);
            }
            for (weights, by_sum) in self.input_weights.iter().zip(&by_sums) {
                let parts = slopes.iter_mut().zip(weights).zip(&self.scale);
                parts.for_each(|((slope, weight), scale)| *slope += by_sum * weight / scale);
            }
        }
    }

    /// Forward product: how the units change where the inputs change by `change`.
    pub fn tangent(&self, inputs: &[f64], change: &[f64], out: &mut [f64]) {
        let steps = self.trajectory(inputs);
        let mut memory = vec![0.0; out.len()];
        out.fill(0.0);
        for (at, change) in change.chunks_exact(self.columns()).enumerate() {
            let x: Vec<f64> = change.iter().zip(&self.scale).map(|(change, scale)| change / scale).collect();
            let sums: Vec<f64> = self.input_weights.iter().map(|weights| product(weights, &x)).collect();
            let products = self.products(out);
            self.cell.forward([&steps[at], &steps[at + 1]], [out, &mut memory], &sums, &products);
        }
    }

    /// Its numbers for a file of arrays.
    pub fn arrays(&self) -> Vec<MapArray> {
        let array =
            |name: &str, values: Vec<f64>, shape: Vec<usize>| MapArray { name: name.to_owned().into(), values, shape };
        let flat = |rows: &[Vec<f64>]| rows.iter().flatten().copied().collect::<Vec<f64>>();
        let (columns, units, rows) = (self.columns(), self.count(), self.biases.len());
        let places = self.inputs.iter().map(|&input| input as f64).collect();
        let mut arrays = vec![
            array("inputs", places, vec![self.steps(), columns]),
            array("centre", self.centre.clone(), vec![columns]),
            array("scale", self.scale.clone(), vec![columns]),
            array("input_weights", flat(&self.input_weights), vec![rows, columns]),
            array("state_weights", flat(&self.state_weights), vec![rows, units]),
            array("biases", self.biases.clone(), vec![rows]),
        ];
        if self.cell.resets() {
            arrays.push(array("state_biases", self.state_biases.clone(), vec![units]));
        }
        arrays
    }

    /// Checks that the parts fit together, and to a library of so many functions.
    ///
    /// # Errors
    /// The contradiction, in words.
    pub fn check(&self, functions: usize) -> Result<(), String> {
        let (cell, columns, rows) = (self.cell.name(), self.columns(), self.biases.len());
        if self.inputs.is_empty() || self.inputs.iter().any(|&input| input >= functions) {
            return Err(format!("a cell ({cell}) of functions that the library does not have ({functions})"));
        }
        if columns == 0 || self.scale.len() != columns || !self.inputs.len().is_multiple_of(columns) {
            return Err(format!(
                "a cell ({cell}) of {} inputs in steps of {columns} columns, {} scales",
                self.inputs.len(),
                self.scale.len()
            ));
        }
        if !self.scale.iter().all(|scale| scale.is_finite() && *scale > 0.0) {
            return Err(format!("the scale of an input of a cell ({cell}) is not positive"));
        }
        let units = rows / self.cell.gates();
        let fits =
            |weights: &[Vec<f64>], width: usize| weights.len() == rows && weights.iter().all(|row| row.len() == width);
        let state_biases = if self.cell.resets() { units } else { 0 };
        if units == 0
            || !rows.is_multiple_of(self.cell.gates())
            || !fits(&self.input_weights, columns)
            || !fits(&self.state_weights, units)
            || self.state_biases.len() != state_biases
        {
            return Err(format!("a cell ({cell}) with {rows} biases, weights of another shape"));
        }
        let weights = self.input_weights.iter().chain(&self.state_weights).flatten();
        let mut numbers = weights.chain(&self.biases).chain(&self.state_biases).chain(&self.centre);
        match numbers.all(|value| value.is_finite()) {
            true => Ok(()),
            false => Err(format!("a number of a cell ({cell}) is not finite")),
        }
    }
}

fn product(weights: &[f64], values: &[f64]) -> f64 {
    weights.iter().zip(values).map(|(weight, value)| weight * value).sum()
}

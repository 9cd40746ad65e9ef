//! A recurrent cell over the window of one tile: values, and the reverse product through all steps.

use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};

use crate::{
    Shape, Window,
    cell::{Cell, Step},
    samples::TILE,
    window::Places,
};

/// Memory for the steps of one tile, reused from tile to tile.
pub(crate) struct Recurrence {
    window: Window,
    units: usize,
    places: Places,
    /// The state before the first step, which is zero, then that of every step.
    steps: Vec<Step>,
    /// Inputs of a step, column after column.
    inputs: Vec<f64>,
    by_state: Vec<f64>,
    by_memory: Vec<f64>,
    by_sums: Vec<f64>,
}

impl Recurrence {
    pub(crate) fn new(shape: &Shape, window: &Window) -> Self {
        let (cell, units) = (window.cell, shape.features());
        let memory = if cell == Cell::Lstm { units * TILE } else { 0 };
        Self {
            window: window.clone(),
            units,
            places: Places::new(window, units),
            steps: (0..=window.steps.len()).map(|_| Step::new(cell, units)).collect(),
            inputs: vec![0.0; window.columns() * TILE],
            by_state: vec![0.0; units * TILE],
            by_memory: vec![0.0; memory],
            by_sums: vec![0.0; cell.sums() * units * TILE],
        }
    }

    /// The state behind the last step, column after column.
    pub(crate) fn features(&self) -> &[f64] {
        self.steps.last().map_or(&[], |step| &step.state)
    }

    /// Takes the columns of a step out of those of the tile.
    fn gather(inputs: &mut [f64], columns: &[usize], tile: &[f64]) {
        for (to, &column) in inputs.chunks_exact_mut(TILE).zip(columns) {
            to.copy_from_slice(&tile[column * TILE..][..TILE]);
        }
    }

    /// States of all steps from the inputs of a tile.
    pub(crate) fn forward(&mut self, parameters: &[f64], tile: &[f64]) {
        let Self { window, units, places, steps, inputs, .. } = self;
        let (cell, units, width) = (window.cell, *units, window.columns());
        let gates = cell.gates() * units;
        for (at, columns) in window.steps.iter().enumerate() {
            Self::gather(inputs, columns, tile);
            let (before, rest) = steps.split_at_mut(at + 1);
            let (before, step) = (&before[at], &mut rest[0]);
            let biases = parameters[places.biases.clone()].iter().chain(&parameters[places.state_biases.clone()]);
            step.gates.chunks_exact_mut(TILE).zip(biases).for_each(|(column, bias)| column.fill(*bias));
            let weights = MatRef::from_column_major_slice(&parameters[places.inputs.clone()], width, gates);
            let sums = MatMut::from_column_major_slice_mut(&mut step.gates[..gates * TILE], TILE, gates);
            let inputs = MatRef::from_column_major_slice(inputs, TILE, width);
            matmul(sums, Accum::Add, inputs, weights, 1.0, Par::Seq);
            // The state before the first step is zero.
            for &[sum, gate, count] in cell.products().iter().filter(|_| at > 0) {
                let [sum, gate, count] = [sum, gate, count].map(|gates| gates * units);
                let weights = &parameters[places.states.clone()][gate * units..][..count * units];
                let weights = MatRef::from_column_major_slice(weights, units, count);
                let to = &mut step.gates[sum * TILE..][..count * TILE];
                let to = MatMut::from_column_major_slice_mut(to, TILE, count);
                let state = MatRef::from_column_major_slice(&before.state, TILE, units);
                matmul(to, Accum::Add, state, weights, 1.0, Par::Seq);
            }
            cell.forward(before, step);
        }
    }

    /// Reverse product after [`Recurrence::forward`]: adds to `gradient` the derivatives by all parameters, given those by the features.
    pub(crate) fn backward(&mut self, parameters: &[f64], tile: &[f64], features: &[f64], gradient: &mut [f64]) {
        let Self { window, units, places, steps, inputs, by_state, by_memory, by_sums } = self;
        let (cell, units, width) = (window.cell, *units, window.columns());
        let gates = cell.gates() * units;
        by_state.copy_from_slice(features);
        by_memory.fill(0.0);
        for (at, columns) in window.steps.iter().enumerate().rev() {
            let before = &steps[at];
            cell.backward((before, &steps[at + 1]), by_state, by_memory, by_sums);
            Self::gather(inputs, columns, tile);
            let inputs = MatRef::from_column_major_slice(inputs, TILE, width);
            let slopes = MatRef::from_column_major_slice(&by_sums[..gates * TILE], TILE, gates);
            let to = MatMut::from_column_major_slice_mut(&mut gradient[places.inputs.clone()], width, gates);
            matmul(to, Accum::Add, inputs.transpose(), slopes, 1.0, Par::Seq);
            let biases = places.biases.start..places.state_biases.end;
            for (sum, column) in gradient[biases].iter_mut().zip(by_sums.chunks_exact(TILE)) {
                *sum += column.iter().sum::<f64>();
            }
            for &[sum, gate, count] in cell.products().iter().filter(|_| at > 0) {
                let [sum, gate, count] = [sum, gate, count].map(|gates| gates * units);
                let slopes = MatRef::from_column_major_slice(&by_sums[sum * TILE..][..count * TILE], TILE, count);
                let range = places.states.start + gate * units..places.states.start + (gate + count) * units;
                let to = MatMut::from_column_major_slice_mut(&mut gradient[range.clone()], units, count);
                let state = MatRef::from_column_major_slice(&before.state, TILE, units);
                matmul(to, Accum::Add, state.transpose(), slopes, 1.0, Par::Seq);
                let weights = MatRef::from_column_major_slice(&parameters[range], units, count);
                let to = MatMut::from_column_major_slice_mut(by_state, TILE, units);
                matmul(to, Accum::Add, slopes, weights.transpose(), 1.0, Par::Seq);
            }
        }
    }
}

//! Hidden layers over one tile: values, and the reverse product with the Jacobian.

use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};

use crate::{Shape, recurrence::Recurrence, samples::TILE, shape::Layer};

/// The hidden layers of one tile.
pub(crate) enum Hidden {
    Dense(Layers),
    Cell(Box<Recurrence>),
}

impl Hidden {
    pub(crate) fn new(shape: &Shape) -> Self {
        match &shape.window {
            Some(window) => Self::Cell(Box::new(Recurrence::new(shape, window))),
            None => Self::Dense(Layers::new(shape)),
        }
    }

    /// The features, column after column.
    pub(crate) fn features(&self) -> &[f64] {
        match self {
            Self::Dense(layers) => layers.features(),
            Self::Cell(recurrence) => recurrence.features(),
        }
    }

    /// Values from the inputs of a tile.
    pub(crate) fn forward(&mut self, parameters: &[f64], inputs: &[f64]) {
        match self {
            Self::Dense(layers) => layers.forward(parameters, inputs),
            Self::Cell(recurrence) => recurrence.forward(parameters, inputs),
        }
    }

    /// Reverse product after [`Hidden::forward`]: adds to `gradient` the derivatives by all parameters, given those by the features.
    pub(crate) fn backward(&mut self, parameters: &[f64], inputs: &[f64], features: &[f64], gradient: &mut [f64]) {
        match self {
            Self::Dense(layers) => layers.backward(parameters, inputs, features, gradient),
            Self::Cell(recurrence) => recurrence.backward(parameters, inputs, features, gradient),
        }
    }
}

/// Memory for the layers of one tile, reused from tile to tile.
pub(crate) struct Layers {
    layers: Vec<Layer>,
    shape: Shape,
    /// Values of the units of every layer.
    values: Vec<Vec<f64>>,
    /// Derivatives by the sums of the units of a layer.
    slopes: Vec<f64>,
    before: Vec<f64>,
}

impl Layers {
    pub(crate) fn new(shape: &Shape) -> Self {
        let layers = shape.layers();
        let values = layers.iter().map(|layer| vec![0.0; layer.units * TILE]).collect();
        Self { layers, shape: shape.clone(), values, slopes: Vec::new(), before: Vec::new() }
    }

    /// The values of the last layer's units, column after column.
    pub(crate) fn features(&self) -> &[f64] {
        self.values.last().map_or(&[], |values| values)
    }

    /// Values of all units from the inputs of a tile.
    pub(crate) fn forward(&mut self, parameters: &[f64], inputs: &[f64]) {
        for (at, layer) in self.layers.iter().enumerate() {
            let (before, rest) = self.values.split_at_mut(at);
            let (inputs, values) = (before.last().map_or(inputs, |values| values), &mut rest[0]);
            for (column, constant) in values.chunks_exact_mut(TILE).zip(&parameters[layer.constants.clone()]) {
                column.fill(*constant);
            }
            let weights =
                MatRef::from_column_major_slice(&parameters[layer.weights.clone()], layer.inputs, layer.units);
            let inputs = MatRef::from_column_major_slice(inputs, TILE, layer.inputs);
            let sums = MatMut::from_column_major_slice_mut(values, TILE, layer.units);
            matmul(sums, Accum::Add, inputs, weights, 1.0, Par::Seq);
            self.shape.activation.apply(values);
        }
    }

    /// Reverse product after [`Layers::forward`]: adds to `gradient` the derivatives by all parameters, given those by the features.
    pub(crate) fn backward(&mut self, parameters: &[f64], inputs: &[f64], features: &[f64], gradient: &mut [f64]) {
        self.slopes.clear();
        self.slopes.extend_from_slice(features);
        for (at, layer) in self.layers.iter().enumerate().rev() {
            self.shape.activation.chain(&self.values[at], &mut self.slopes);
            let below = if at == 0 { inputs } else { &self.values[at - 1] };
            let below = MatRef::from_column_major_slice(below, TILE, layer.inputs);
            let slopes = MatRef::from_column_major_slice(&self.slopes, TILE, layer.units);
            let to =
                MatMut::from_column_major_slice_mut(&mut gradient[layer.weights.clone()], layer.inputs, layer.units);
            matmul(to, Accum::Add, below.transpose(), slopes, 1.0, Par::Seq);
            for (sum, column) in gradient[layer.constants.clone()].iter_mut().zip(self.slopes.chunks_exact(TILE)) {
                *sum += column.iter().sum::<f64>();
            }
            if at > 0 {
                let weights =
                    MatRef::from_column_major_slice(&parameters[layer.weights.clone()], layer.inputs, layer.units);
                self.before.resize(layer.inputs * TILE, 0.0);
                let before = MatMut::from_column_major_slice_mut(&mut self.before, TILE, layer.inputs);
                matmul(before, Accum::Replace, slopes, weights.transpose(), 1.0, Par::Seq);
                std::mem::swap(&mut self.before, &mut self.slopes);
            }
        }
    }
}

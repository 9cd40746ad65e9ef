//! A trained network as the basis of a model.

use std::sync::Arc;

use fleetfoot_learn::{Shape, Units};
use fleetfoot_model::{Activation, Basis, Cell, DenseLayer, Network, Recurrent};

/// The cell of a model.
pub(super) fn cell(cell: fleetfoot_learn::Cell) -> Cell {
    match cell {
        fleetfoot_learn::Cell::Rnn => Cell::Rnn,
        fleetfoot_learn::Cell::Gru => Cell::Gru,
        fleetfoot_learn::Cell::Lstm => Cell::Lstm,
    }
}

fn activation(activation: fleetfoot_learn::Activation) -> Activation {
    match activation {
        fleetfoot_learn::Activation::Tanh => Activation::Tanh,
        fleetfoot_learn::Activation::Relu => Activation::Relu,
        fleetfoot_learn::Activation::Softplus => Activation::Softplus,
    }
}

/// The hidden layers or the cell with these numbers, in these units; `inputs` are the functions of the library that stand in the columns of the rows.
pub(super) fn basis(shape: &Shape, parameters: &[f64], inputs: &[usize], units: &Units) -> Basis {
    let p = inputs.len();
    let Some(window) = &shape.window else {
        let mut before = p;
        let layer = |(weights, biases): (&[f64], &[f64])| {
            let weights = weights.chunks_exact(before).map(<[f64]>::to_vec).collect();
            before = biases.len();
            DenseLayer { weights, biases: biases.to_vec() }
        };
        return Basis::Network(Arc::new(Network {
            inputs: inputs.to_vec(),
            centre: units.centre[..p].to_vec(),
            scale: units.scale[..p].to_vec(),
            activation: activation(shape.activation),
            layers: shape.split(parameters).into_iter().map(layer).collect(),
        }));
    };
    let [input_weights, state_weights, biases, state_biases] = shape.split_cell(parameters);
    let rows = |weights: &[f64], width: usize| weights.chunks_exact(width).map(<[f64]>::to_vec).collect();
    // All steps of a column have the units of the last one.
    let last = window.steps.last().map_or(&[][..], Vec::as_slice);
    Basis::Recurrent(Arc::new(Recurrent {
        cell: cell(window.cell),
        inputs: window.steps.iter().flatten().map(|&column| inputs[column]).collect(),
        centre: last.iter().map(|&column| units.centre[column]).collect(),
        scale: last.iter().map(|&column| units.scale[column]).collect(),
        input_weights: rows(input_weights, window.columns()),
        state_weights: rows(state_weights, shape.features()),
        biases: biases.to_vec(),
        state_biases: state_biases.to_vec(),
    }))
}

/// Words for a model's method, and for a candidate: `6-4 tanh`, `gru 8`.
pub(super) fn words(shape: &Shape) -> String {
    let sizes: Vec<String> = shape.hidden.iter().map(usize::to_string).collect();
    match &shape.window {
        Some(window) => format!("{} {}", cell(window.cell).name(), sizes.join("-")),
        None => format!("{} {}", sizes.join("-"), activation(shape.activation).name()),
    }
}

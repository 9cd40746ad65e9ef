//! Size of a network, and the places of its numbers.

use std::ops::Range;

use fleetfoot_data::mix;

use crate::{Activation, Cell, Error, Window, window::Places};

/// The hidden layers of a network: dense layers, or one recurrent cell.
///
/// The numbers of dense layers are one list: for each layer the weights (units x inputs, the inputs of a unit together), then the constants of the units. Those of a cell
/// are the weights of its inputs (gates units x columns), of its state (gates units x units), the biases (gates units) and, of a GRU, `c` (units).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    /// Number of inputs.
    pub inputs: usize,
    /// Units of every hidden layer.
    pub hidden: Vec<usize>,
    /// Function of each unit's sum in dense layers.
    pub activation: Activation,
    /// The cell that stands in place of dense layers, and its steps.
    pub window: Option<Window>,
}

/// One layer: where its numbers stand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Layer {
    pub(crate) inputs: usize,
    pub(crate) units: usize,
    pub(crate) weights: Range<usize>,
    pub(crate) constants: Range<usize>,
}

impl Shape {
    /// Checks that there are inputs and units to train.
    ///
    /// # Errors
    /// No inputs, no layer, a layer without units.
    pub fn check(&self) -> Result<(), Error> {
        match self.inputs > 0 && !self.hidden.is_empty() && self.hidden.iter().all(|&units| units > 0) {
            true => self.window.as_ref().map_or(Ok(()), |window| window.check(self.inputs, &self.hidden)),
            false => Err(Error::Shape(format!(
                "a network of {} inputs and hidden layers of {:?} units: there is one of each at least",
                self.inputs, self.hidden
            ))),
        }
    }

    pub(crate) fn layers(&self) -> Vec<Layer> {
        let (mut inputs, mut at) = (self.inputs, 0);
        let layer = |&units: &usize| {
            let weights = at..at + units * inputs;
            at = weights.end + units;
            let layer = Layer { inputs, units, constants: weights.end..at, weights };
            inputs = units;
            layer
        };
        self.hidden.iter().map(layer).collect()
    }

    /// Units of the last hidden layer: the features of the output layer.
    pub fn features(&self) -> usize {
        self.hidden.last().copied().unwrap_or(0)
    }

    /// Number of weights and constants of the hidden layers.
    pub fn parameters(&self) -> usize {
        match &self.window {
            Some(window) => Places::new(window, self.features()).state_biases.end,
            None => self.layers().last().map_or(0, |layer| layer.constants.end),
        }
    }

    /// Multiply-adds of the hidden layers for a row.
    pub fn products(&self) -> usize {
        match &self.window {
            Some(window) => {
                let rows = window.cell.gates() * self.features();
                window.steps.len() * rows * (window.columns() + self.features())
            }
            None => self.layers().iter().map(|layer| layer.inputs * layer.units).sum(),
        }
    }

    /// Weights and constants (units x inputs; units) of every dense layer.
    pub fn split<'a>(&self, parameters: &'a [f64]) -> Vec<(&'a [f64], &'a [f64])> {
        self.layers().into_iter().map(|layer| (&parameters[layer.weights], &parameters[layer.constants])).collect()
    }

    /// The numbers of a cell: weights of its inputs, weights of its state, biases, `c` of a GRU. Empty for dense layers.
    pub fn split_cell<'a>(&self, parameters: &'a [f64]) -> [&'a [f64]; 4] {
        let Some(window) = &self.window else { return [&[]; 4] };
        let Places { inputs, states, biases, state_biases } = Places::new(window, self.features());
        [inputs, states, biases, state_biases].map(|range| &parameters[range])
    }

    /// Random numbers to begin with: uniform, with the variance that keeps sums of standardised inputs at 1 (LeCun, Bottou, Orr and Mueller, "Efficient BackProp",
    /// 1998; twice that for ReLU: He et al. 2015), and constants between -1 and 1, so that units bend at different places.
    pub fn initial(&self, seed: u64) -> Vec<f64> {
        if let Some(window) = &self.window {
            return self.initial_cell(window, seed);
        }
        let gain = if self.activation == Activation::Relu { 6.0 } else { 3.0 };
        let mut parameters = vec![0.0; self.parameters()];
        for (at, layer) in self.layers().into_iter().enumerate() {
            let key = mix(mix(seed).wrapping_add(at as u64));
            let bound = (gain / layer.inputs as f64).sqrt();
            for place in layer.weights.chain(layer.constants.clone()) {
                let uniform = (mix(key.wrapping_add(place as u64)) >> 11) as f64 * 2f64.powi(-52) - 1.0;
                parameters[place] = uniform * if layer.constants.contains(&place) { 1.0 } else { bound };
            }
        }
        parameters
    }

    /// The same for a cell: the sum over inputs and states has the variance 1 at most. Forget gates begin open (Gers, Schmidhuber and Cummins, "Learning to forget",
    /// 2000).
    fn initial_cell(&self, window: &Window, seed: u64) -> Vec<f64> {
        let units = self.features();
        let places = Places::new(window, units);
        let bound = (3.0 / (window.columns() + units) as f64).sqrt();
        let key = mix(seed);
        let number = |place: usize| {
            let uniform = (mix(key.wrapping_add(place as u64)) >> 11) as f64 * 2f64.powi(-52) - 1.0;
            let forgets = window.cell == Cell::Lstm
                && (places.biases.start + units..places.biases.start + 2 * units).contains(&place);
            match place < places.biases.start {
                true => uniform * bound,
                false => uniform + f64::from(forgets),
            }
        };
        (0..self.parameters()).map(number).collect()
    }
}

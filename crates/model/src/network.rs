//! Units of a feed-forward network.

use fleetfoot_library::Expr;

use crate::map_array::MapArray;

/// Activation: the function of a unit of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Activation {
    /// `tanh(z)`.
    Tanh,
    /// `max(z, 0)`.
    Relu,
    /// `log(1 + exp(z))`.
    Softplus,
}

impl Activation {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Tanh, Self::Relu, Self::Softplus];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tanh => "tanh",
            Self::Relu => "relu",
            Self::Softplus => "softplus",
        }
    }

    /// The value of a unit.
    #[inline(always)]
    pub fn value(self, sum: f64) -> f64 {
        match self {
            Self::Tanh => sum.tanh(),
            // NaN stays NaN.
            Self::Relu => {
                if sum < 0.0 {
                    0.0
                } else {
                    sum
                }
            }
            Self::Softplus => sum.max(0.0) + (1.0 + (-sum.abs()).exp()).ln(),
        }
    }

    /// The derivative by the sum, from the value.
    #[inline(always)]
    pub fn slope(self, value: f64) -> f64 {
        match self {
            Self::Tanh => 1.0 - value * value,
            Self::Relu => f64::from(value > 0.0),
            Self::Softplus => 1.0 - (-value).exp(),
        }
    }

    fn expression(self, sum: Expr) -> Expr {
        match self {
            Self::Tanh => sum.tanh(),
            Self::Relu => sum.max(Expr::number(0.0)),
            Self::Softplus => {
                let tail = Expr::number(1.0) + (-sum.abs()).exp();
                sum.max(Expr::number(0.0)) + tail.log()
            }
        }
    }
}

/// A dense layer: a unit is the activation of `bias + weights' * units before`.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseLayer {
    /// One row a unit.
    pub weights: Vec<Vec<f64>>,
    /// One a unit.
    pub biases: Vec<f64>,
}

/// Units of the last hidden layer of a network over some functions x of a library, which are standardised: `(x - centre)/scale`.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Indices of the functions x in the library.
    pub inputs: Vec<usize>,
    /// Centre of each input.
    pub centre: Vec<f64>,
    /// Scale of each input.
    pub scale: Vec<f64>,
    /// Activation of all units.
    pub activation: Activation,
    /// Hidden layers, the first next to the inputs.
    pub layers: Vec<DenseLayer>,
}

impl Network {
    /// The name of a unit of the last hidden layer in text for people: `unit1`.
    pub fn name(index: usize) -> String {
        format!("unit{}", index + 1)
    }

    /// Number of units of the last hidden layer.
    pub fn count(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.biases.len())
    }

    /// Units of every hidden layer: `16-16`.
    pub fn sizes(&self) -> String {
        let sizes: Vec<String> = self.layers.iter().map(|layer| layer.biases.len().to_string()).collect();
        sizes.join("-")
    }

    /// Weights and biases of the hidden layers.
    pub fn numbers(&self) -> usize {
        self.layers.iter().map(|layer| layer.weights.iter().map(Vec::len).sum::<usize>() + layer.biases.len()).sum()
    }

    /// Values of the units of every layer; `last` takes those of the last one.
    #[inline(always)]
    pub fn evaluate(&self, inputs: &[f64], last: &mut [f64]) {
        let mut before = self.standardised(inputs);
        for (at, layer) in self.layers.iter().enumerate() {
            if at + 1 == self.layers.len() {
                self.layer(layer, &before, last);
            } else {
                let mut units = vec![0.0; layer.biases.len()];
                self.layer(layer, &before, &mut units);
                before = units;
            }
        }
    }

    fn standardised(&self, inputs: &[f64]) -> Vec<f64> {
        inputs.iter().zip(&self.centre).zip(&self.scale).map(|((x, centre), scale)| (x - centre) / scale).collect()
    }

    #[inline(always)]
    fn layer(&self, layer: &DenseLayer, before: &[f64], units: &mut [f64]) {
        for ((value, weights), bias) in units.iter_mut().zip(&layer.weights).zip(&layer.biases) {
            let sum = weights.iter().zip(before).fold(*bias, |sum, (weight, unit)| sum + weight * unit);
            *value = self.activation.value(sum);
        }
    }

    /// Values of the units of all layers but the last one.
    fn hidden(&self, inputs: &[f64]) -> Vec<Vec<f64>> {
        let mut values: Vec<Vec<f64>> = Vec::with_capacity(self.layers.len());
        let first = self.standardised(inputs);
        for layer in self.layers.iter().take(self.layers.len().saturating_sub(1)) {
            let mut units = vec![0.0; layer.biases.len()];
            self.layer(layer, values.last().unwrap_or(&first), &mut units);
            values.push(units);
        }
        values
    }

    /// Reverse product: adds `sum_k weights_k d unit_k / d x_i` to the slope of every input; `values` are those of the last layer at `inputs`.
    pub fn gradient(&self, inputs: &[f64], values: &[f64], weights: &[f64], slopes: &mut [f64]) {
        let hidden = self.hidden(inputs);
        let mut by_unit = weights.to_vec();
        for (at, layer) in self.layers.iter().enumerate().rev() {
            let inputs_of = hidden.get(at).map_or(values, Vec::as_slice);
            let mut before = vec![0.0; layer.weights.first().map_or(0, Vec::len)];
            for ((row, by_unit), value) in layer.weights.iter().zip(&by_unit).zip(inputs_of) {
                let by_sum = by_unit * self.activation.slope(*value);
                before.iter_mut().zip(row).for_each(|(sum, weight)| *sum += by_sum * weight);
            }
            by_unit = before;
        }
        slopes.iter_mut().zip(by_unit).zip(&self.scale).for_each(|((to, slope), scale)| *to += slope / scale);
    }

    /// Forward product: how the values change where the inputs change by `change`.
    pub fn tangent(&self, inputs: &[f64], values: &[f64], change: &[f64], out: &mut [f64]) {
        let hidden = self.hidden(inputs);
        let mut along: Vec<f64> = change.iter().zip(&self.scale).map(|(change, scale)| change / scale).collect();
        for (at, layer) in self.layers.iter().enumerate() {
            let inputs_of = hidden.get(at).map_or(values, Vec::as_slice);
            let unit = |(row, value): (&Vec<f64>, &f64)| {
                self.activation.slope(*value) * row.iter().zip(&along).map(|(weight, d)| weight * d).sum::<f64>()
            };
            along = layer.weights.iter().zip(inputs_of).map(unit).collect();
        }
        out.copy_from_slice(&along);
    }

    /// One unit of the last layer as an expression of the inputs. Units of the layers before are written out in it.
    pub fn expression(&self, index: usize, inputs: &[Expr]) -> Expr {
        let parts = inputs.iter().zip(self.centre.iter().zip(&self.scale));
        let mut before: Vec<Expr> =
            parts.map(|(x, (&centre, &scale))| (x - Expr::number(centre)) / Expr::number(scale)).collect();
        for (at, layer) in self.layers.iter().enumerate() {
            let unit = |(row, &bias): (&Vec<f64>, &f64)| {
                let terms = row.iter().zip(&before).map(|(&weight, unit)| Expr::number(weight) * unit);
                self.activation.expression(terms.fold(Expr::number(bias), |sum, term| sum + term))
            };
            let all = layer.weights.iter().zip(&layer.biases);
            before = match at + 1 == self.layers.len() {
                true => all.skip(index).take(1).map(unit).collect(),
                false => all.map(unit).collect(),
            };
        }
        before.swap_remove(0)
    }

    /// Its numbers for a file of arrays.
    pub fn arrays(&self) -> Vec<MapArray> {
        let array = |name: String, values: Vec<f64>, shape: Vec<usize>| MapArray { name: name.into(), values, shape };
        let inputs = self.inputs.len();
        let places = self.inputs.iter().map(|&input| input as f64).collect();
        let mut arrays = vec![
            array("inputs".into(), places, vec![inputs]),
            array("centre".into(), self.centre.clone(), vec![inputs]),
            array("scale".into(), self.scale.clone(), vec![inputs]),
        ];
        for (at, layer) in self.layers.iter().enumerate() {
            let (units, before) = (layer.biases.len(), layer.weights.first().map_or(0, Vec::len));
            let weights = layer.weights.iter().flatten().copied().collect();
            arrays.push(array(format!("layer{}_weights", at + 1), weights, vec![units, before]));
            arrays.push(array(format!("layer{}_biases", at + 1), layer.biases.clone(), vec![units]));
        }
        arrays
    }

    /// Checks that the parts fit together, and to a library of so many functions.
    ///
    /// # Errors
    /// The contradiction, in words.
    pub fn check(&self, functions: usize) -> Result<(), String> {
        let inputs = self.inputs.len();
        if inputs == 0 || self.inputs.iter().any(|&input| input >= functions) {
            return Err(format!("a network of functions that the library does not have ({functions})"));
        }
        if self.scale.len() != inputs || self.centre.len() != inputs {
            return Err(format!("{inputs} inputs of a network, {} scales", self.scale.len()));
        }
        if !self.scale.iter().all(|scale| scale.is_finite() && *scale > 0.0) {
            return Err("the scale of an input of a network is not positive".into());
        }
        let mut before = inputs;
        for (at, layer) in self.layers.iter().enumerate() {
            let units = layer.biases.len();
            if units == 0 || layer.weights.len() != units || layer.weights.iter().any(|row| row.len() != before) {
                return Err(format!("layer {} of a network: {units} biases, weights of another shape", at + 1));
            }
            before = units;
        }
        if self.layers.is_empty() {
            return Err("a network without layers".into());
        }
        let numbers = self.layers.iter().flat_map(|layer| layer.weights.iter().flatten().chain(&layer.biases));
        match numbers.chain(&self.centre).all(|value| value.is_finite()) {
            true => Ok(()),
            false => Err("a number of a network is not finite".into()),
        }
    }
}

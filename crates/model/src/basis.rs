//! Functions that a latent has beside those of its library.

use std::sync::Arc;

use fleetfoot_library::Expr;

use crate::{gaussian::Gaussian, map_array::MapArray, network::Network, recurrent::Recurrent};

/// Definition of basis functions, for people: a sentence, and a table of the numbers of each.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    /// Their names, and the formula that all have.
    pub text: String,
    /// Heads of the columns of the table, without that of the names.
    pub head: Vec<String>,
    /// Name and numbers of every basis function.
    pub rows: Vec<(String, Vec<f64>)>,
}

/// Basis functions over the functions of a library: features that a kind of latent has beside them, linear in its coefficients too.
///
/// Latents whose basis is the same share its values. Simulation and code compute it once a row; a match on it has no default arm.
#[derive(Debug, Clone, PartialEq)]
pub enum Basis {
    /// Radial functions.
    Gaussian(Arc<Gaussian>),
    /// Units of the last hidden layer of a network.
    Network(Arc<Network>),
    /// The last state of a recurrent cell.
    Recurrent(Arc<Recurrent>),
}

impl Basis {
    /// Name of the functions in files: `radial`.
    pub fn kind(&self) -> &'static str {
        match self {
            Basis::Gaussian(_) => "radial",
            Basis::Network(_) | Basis::Recurrent(_) => "network",
        }
    }

    /// True if single functions have no meaning: text for people has their weighted sum as one term.
    pub fn is_summed_up(&self) -> bool {
        match self {
            Basis::Gaussian(_) => false,
            Basis::Network(_) | Basis::Recurrent(_) => true,
        }
    }

    /// Checks that the parts fit together, and to a library of so many functions.
    ///
    /// # Errors
    /// The contradiction, in words.
    pub fn check(&self, functions: usize) -> Result<(), String> {
        match self {
            Basis::Gaussian(gaussian) => gaussian.check(functions),
            Basis::Network(network) => network.check(functions),
            Basis::Recurrent(recurrent) => recurrent.check(functions),
        }
    }

    /// Its numbers for a file of arrays.
    pub fn arrays(&self) -> Vec<MapArray> {
        match self {
            Basis::Gaussian(gaussian) => gaussian.arrays(),
            Basis::Network(network) => network.arrays(),
            Basis::Recurrent(recurrent) => recurrent.arrays(),
        }
    }

    /// Number of basis functions.
    pub fn count(&self) -> usize {
        match self {
            Basis::Gaussian(gaussian) => gaussian.count(),
            Basis::Network(network) => network.count(),
            Basis::Recurrent(recurrent) => recurrent.count(),
        }
    }

    /// Indices of the functions of the library that it reads.
    pub fn inputs(&self) -> &[usize] {
        match self {
            Basis::Gaussian(gaussian) => &gaussian.inputs,
            Basis::Network(network) => &network.inputs,
            Basis::Recurrent(recurrent) => &recurrent.inputs,
        }
    }

    /// The name of a basis function in text for people: `radial1`.
    pub fn name(&self, index: usize) -> String {
        match self {
            Basis::Gaussian(_) => Gaussian::name(index),
            Basis::Network(_) => Network::name(index),
            Basis::Recurrent(_) => Recurrent::name(index),
        }
    }

    /// The values of the basis functions, from those of its inputs.
    #[inline(always)]
    pub fn evaluate(&self, inputs: &[f64], values: &mut [f64]) {
        match self {
            Basis::Gaussian(gaussian) => gaussian.evaluate(inputs, values),
            Basis::Network(network) => network.evaluate(inputs, values),
            Basis::Recurrent(recurrent) => recurrent.evaluate(inputs, values),
        }
    }

    /// Reverse product: adds `sum_k weights_k d basis_k / d input_i` to every slope; `values` are those at `inputs`.
    pub fn gradient(&self, inputs: &[f64], values: &[f64], weights: &[f64], slopes: &mut [f64]) {
        match self {
            Basis::Gaussian(gaussian) => gaussian.gradient(inputs, values, weights, slopes),
            Basis::Network(network) => network.gradient(inputs, values, weights, slopes),
            Basis::Recurrent(recurrent) => recurrent.gradient(inputs, weights, slopes),
        }
    }

    /// Forward product: how the values change where the inputs change by `change`.
    pub fn tangent(&self, inputs: &[f64], values: &[f64], change: &[f64], out: &mut [f64]) {
        match self {
            Basis::Gaussian(gaussian) => gaussian.tangent(inputs, values, change, out),
            Basis::Network(network) => network.tangent(inputs, values, change, out),
            Basis::Recurrent(recurrent) => recurrent.tangent(inputs, change, out),
        }
    }

    /// A basis function written out over the columns; `library` are the functions of the latent's library. `None` for units of a cell: their text doubles in length at
    /// every step.
    pub fn expression(&self, index: usize, library: &[Expr]) -> Option<Expr> {
        let inputs: Option<Vec<Expr>> = self.inputs().iter().map(|&input| library.get(input).cloned()).collect();
        match self {
            Basis::Gaussian(gaussian) => Some(gaussian.expression(index, &inputs?)),
            Basis::Network(network) => Some(network.expression(index, &inputs?)),
            Basis::Recurrent(_) => None,
        }
    }

    /// Definition of these functions, for people; `library`: functions of the latent's library.
    pub fn definition(&self, library: &[Expr]) -> Definition {
        let name = |&input: &usize| library.get(input).map_or_else(String::new, Expr::to_string);
        let mut head: Vec<String> = self.inputs().iter().map(name).collect();
        let names = || (0..self.count()).map(|index| self.name(index));
        match self {
            Basis::Gaussian(gaussian) => {
                let scale: Vec<String> =
                    head.iter().zip(&gaussian.scale).map(|(x, s)| format!("{s:.6} of {x}")).collect();
                Definition {
                    text: format!(
                        "{} to {}: exp(-|(u - c)/s|^2/(2*w^2)) of u = ({}), width w = {:.6}, scales s = {}; centres c",
                        self.name(0),
                        self.name(self.count().saturating_sub(1)),
                        head.join(", "),
                        gaussian.width,
                        scale.join(", ")
                    ),
                    rows: names().zip(gaussian.centres.iter().cloned()).collect(),
                    head,
                }
            }
            Basis::Network(network) => Definition {
                text: format!(
                    "network: the weighted sum of {} units, the last of the hidden layers {} ({}) of standardised inputs, {} numbers in them; centre and scale of the inputs",
                    network.count(),
                    network.sizes(),
                    network.activation.name(),
                    network.numbers()
                ),
                rows: vec![("centre".into(), network.centre.clone()), ("scale".into(), network.scale.clone())],
                head,
            },
            Basis::Recurrent(recurrent) => Definition {
                text: format!(
                    "network: the weighted sum of {} units, the last state of a recurrent cell ({}) over {} rows of standardised inputs, {} numbers in it; centre and scale of the inputs",
                    recurrent.count(),
                    recurrent.cell.name(),
                    recurrent.steps(),
                    recurrent.numbers()
                ),
                rows: vec![("centre".into(), recurrent.centre.clone()), ("scale".into(), recurrent.scale.clone())],
                // The columns of the last step name those of all.
                head: head.split_off(head.len() - recurrent.columns()),
            },
        }
    }
}

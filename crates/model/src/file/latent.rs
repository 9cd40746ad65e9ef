//! Latent functions in files.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Real, Reals, floats, reals, rows};
use crate::{Activation, AffineMap, Basis, BasisMap, Cell, DenseLayer, Gaussian, Latent, Map, Network, Recurrent};

/// A latent of any kind: constants and coefficients, then the numbers that only another kind has.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LatentText {
    pub(super) name: String,
    library: usize,
    partition: usize,
    constants: Reals,
    coefficients: Vec<Reals>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    radial: Option<RadialText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    network: Option<NetworkText>,
    /// Coefficients outside of a region's training ranges; empty where the map is followed everywhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    beyond: Reals,
}

/// Radial functions with their weights, one row a region.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RadialText {
    inputs: Vec<usize>,
    centres: Vec<Reals>,
    scale: Reals,
    width: Real,
    weights: Vec<Reals>,
}

/// Hidden layers of a network, or its recurrent cell, with the weights of its last units, one row a region.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct NetworkText {
    /// The latent before this one, by its index, that has the same hidden layers or cell; they are not repeated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    of: Option<usize>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    hidden: Option<HiddenText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cell: Option<CellText>,
    weights: Vec<Reals>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HiddenText {
    inputs: Vec<usize>,
    centre: Reals,
    scale: Reals,
    activation: String,
    layers: Vec<LayerText>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CellText {
    kind: String,
    /// Functions of the library, one row a step, the oldest first.
    steps: Vec<Vec<usize>>,
    centre: Reals,
    scale: Reals,
    input_weights: Vec<Reals>,
    state_weights: Vec<Reals>,
    biases: Reals,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    state_biases: Reals,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LayerText {
    weights: Vec<Reals>,
    biases: Reals,
}

/// The latents of a model.
pub(super) fn texts(latents: &[Latent]) -> Vec<LatentText> {
    let of = |(at, latent): (usize, &Latent)| {
        let mut text = LatentText::from(latent);
        if let Some(network) = &mut text.network {
            let basis = latent.map.basis();
            network.of = latents[..at].iter().position(|before| before.map.basis() == basis);
            if network.of.is_some() {
                (network.hidden, network.cell) = (None, None);
            }
        }
        text
    };
    latents.iter().enumerate().map(of).collect()
}

/// Reads the latents of a model.
///
/// # Errors
/// A network that refers to none.
pub(super) fn latents(texts: Vec<LatentText>) -> Result<Vec<Latent>, String> {
    let mut latents: Vec<Latent> = Vec::with_capacity(texts.len());
    for text in texts {
        let latent = text.into_latent(&latents)?;
        latents.push(latent);
    }
    Ok(latents)
}

impl From<&Latent> for LatentText {
    fn from(l: &Latent) -> Self {
        let (map, radial, network) = match &l.map {
            Map::Affine(map) => (map, None, None),
            Map::Basis(map) => match &map.basis {
                Basis::Gaussian(gaussian) => (&map.affine, Some(RadialText::new(gaussian, &map.weights)), None),
                Basis::Network(network) => (&map.affine, None, Some(NetworkText::new(network, &map.weights))),
                Basis::Recurrent(recurrent) => {
                    let cell = Some(CellText::from(&**recurrent));
                    let network = NetworkText { of: None, hidden: None, cell, weights: rows(&map.weights) };
                    (&map.affine, None, Some(network))
                }
            },
        };
        Self {
            name: l.name.clone(),
            library: l.library,
            partition: l.partition,
            constants: reals(&map.constants),
            coefficients: rows(&map.coefficients),
            radial,
            network,
            beyond: reals(&l.beyond),
        }
    }
}

impl LatentText {
    /// `before` are the latents before it.
    fn into_latent(self, before: &[Latent]) -> Result<Latent, String> {
        let (constants, coefficients) = (floats(self.constants), self.coefficients.into_iter().map(floats).collect());
        let affine = AffineMap { constants, coefficients };
        let map = match (self.radial, self.network) {
            (None, None) => affine.into(),
            (Some(radial), None) => radial.into_map(affine).into(),
            (None, Some(network)) => {
                network.into_map(affine, before).map_err(|reason| format!("{}: {reason}", self.name))?.into()
            }
            (Some(_), Some(_)) => return Err(format!("{}: radial functions and a network in one latent", self.name)),
        };
        Ok(Latent {
            name: self.name,
            library: self.library,
            partition: self.partition,
            map,
            beyond: floats(self.beyond),
        })
    }
}

impl RadialText {
    fn new(radial: &Gaussian, weights: &[Vec<f64>]) -> Self {
        Self {
            inputs: radial.inputs.clone(),
            centres: rows(&radial.centres),
            scale: reals(&radial.scale),
            width: Real(radial.width),
            weights: rows(weights),
        }
    }

    fn into_map(self, affine: AffineMap) -> BasisMap {
        let radial = Gaussian {
            inputs: self.inputs,
            centres: self.centres.into_iter().map(floats).collect(),
            scale: floats(self.scale),
            width: self.width.0,
        };
        BasisMap {
            affine,
            basis: Basis::Gaussian(Arc::new(radial)),
            weights: self.weights.into_iter().map(floats).collect(),
        }
    }
}

impl NetworkText {
    fn new(network: &Network, weights: &[Vec<f64>]) -> Self {
        let layer = |dense_layer: &DenseLayer| LayerText {
            weights: rows(&dense_layer.weights),
            biases: reals(&dense_layer.biases),
        };
        let hidden = HiddenText {
            inputs: network.inputs.clone(),
            centre: reals(&network.centre),
            scale: reals(&network.scale),
            activation: network.activation.name().into(),
            layers: network.layers.iter().map(layer).collect(),
        };
        Self { of: None, hidden: Some(hidden), cell: None, weights: rows(weights) }
    }

    fn into_map(self, affine: AffineMap, before: &[Latent]) -> Result<BasisMap, String> {
        let weights = self.weights.into_iter().map(floats).collect();
        let basis = match (self.hidden, self.cell, self.of) {
            (Some(hidden), None, None) => Basis::Network(Arc::new(hidden.into_network()?)),
            (None, Some(cell), None) => Basis::Recurrent(Arc::new(cell.into_recurrent()?)),
            (None, None, Some(of)) => match before.get(of).and_then(|latent| latent.map.basis()) {
                Some(basis @ (Basis::Network(_) | Basis::Recurrent(_))) => basis,
                _ => return Err(format!("its network is that of latent {of}, which has none")),
            },
            _ => return Err("a network has hidden layers, or a cell, or is that of a latent before".into()),
        };
        Ok(BasisMap { affine, basis, weights })
    }
}

impl From<&Recurrent> for CellText {
    fn from(recurrent: &Recurrent) -> Self {
        Self {
            kind: recurrent.cell.name().into(),
            steps: recurrent.inputs.chunks(recurrent.columns().max(1)).map(<[usize]>::to_vec).collect(),
            centre: reals(&recurrent.centre),
            scale: reals(&recurrent.scale),
            input_weights: rows(&recurrent.input_weights),
            state_weights: rows(&recurrent.state_weights),
            biases: reals(&recurrent.biases),
            state_biases: reals(&recurrent.state_biases),
        }
    }
}

impl CellText {
    fn into_recurrent(self) -> Result<Recurrent, String> {
        let cell = Cell::ALL.into_iter().find(|cell| cell.name() == self.kind);
        let cell = cell.ok_or_else(|| format!("unknown cell `{}`", self.kind))?;
        let columns = self.centre.len();
        if let Some(step) = self.steps.iter().find(|step| step.len() != columns) {
            return Err(format!("a cell ({}) of {columns} columns with a step of {}", self.kind, step.len()));
        }
        let matrix = |text: Vec<Reals>| text.into_iter().map(floats).collect();
        Ok(Recurrent {
            cell,
            inputs: self.steps.concat(),
            centre: floats(self.centre),
            scale: floats(self.scale),
            input_weights: matrix(self.input_weights),
            state_weights: matrix(self.state_weights),
            biases: floats(self.biases),
            state_biases: floats(self.state_biases),
        })
    }
}

impl HiddenText {
    fn into_network(self) -> Result<Network, String> {
        let activation = Activation::ALL.into_iter().find(|activation| activation.name() == self.activation);
        let activation = activation.ok_or_else(|| format!("unknown activation `{}`", self.activation))?;
        let layer = |text: LayerText| DenseLayer {
            weights: text.weights.into_iter().map(floats).collect(),
            biases: floats(text.biases),
        };
        Ok(Network {
            inputs: self.inputs,
            centre: floats(self.centre),
            scale: floats(self.scale),
            activation,
            layers: self.layers.into_iter().map(layer).collect(),
        })
    }
}

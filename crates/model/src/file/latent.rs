//! Latent functions in files.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Real, Reals, floats, reals, rows};
use crate::{AffineMap, Gaussian, Latent, Map, RadialMap};

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

impl From<&Latent> for LatentText {
    fn from(l: &Latent) -> Self {
        let (map, radial) = match &l.map {
            Map::Affine(map) => (map, None),
            Map::Radial(map) => (&map.affine, Some(RadialText::from(map))),
        };
        Self {
            name: l.name.clone(),
            library: l.library,
            partition: l.partition,
            constants: reals(&map.constants),
            coefficients: rows(&map.coefficients),
            radial,
        }
    }
}

impl LatentText {
    pub(super) fn into_latent(self) -> Latent {
        let (constants, coefficients) = (floats(self.constants), self.coefficients.into_iter().map(floats).collect());
        let affine = AffineMap { constants, coefficients };
        let map = match self.radial {
            None => affine.into(),
            Some(radial) => radial.into_map(affine).into(),
        };
        Latent { name: self.name, library: self.library, partition: self.partition, map }
    }
}

impl From<&RadialMap> for RadialText {
    fn from(map: &RadialMap) -> Self {
        Self {
            inputs: map.radial.inputs.clone(),
            centres: rows(&map.radial.centres),
            scale: reals(&map.radial.scale),
            width: Real(map.radial.width),
            weights: rows(&map.weights),
        }
    }
}

impl RadialText {
    fn into_map(self, affine: AffineMap) -> RadialMap {
        let radial = Gaussian {
            inputs: self.inputs,
            centres: self.centres.into_iter().map(floats).collect(),
            scale: floats(self.scale),
            width: self.width.0,
        };
        RadialMap { affine, radial: Arc::new(radial), weights: self.weights.into_iter().map(floats).collect() }
    }
}

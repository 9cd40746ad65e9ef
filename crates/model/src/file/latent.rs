//! Latent functions in files.

use serde::{Deserialize, Serialize};

use super::{Reals, floats, reals, rows};
use crate::{AffineMap, Latent, Map};

/// A latent: constants and coefficients stand in it whatever its kind; what another kind has besides follows them.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LatentText {
    pub(super) name: String,
    library: usize,
    partition: usize,
    constants: Reals,
    coefficients: Vec<Reals>,
}

impl From<&Latent> for LatentText {
    fn from(l: &Latent) -> Self {
        let Map::Affine(map) = &l.map;
        Self {
            name: l.name.clone(),
            library: l.library,
            partition: l.partition,
            constants: reals(&map.constants),
            coefficients: rows(&map.coefficients),
        }
    }
}

impl LatentText {
    pub(super) fn into_latent(self) -> Latent {
        let (constants, coefficients) = (floats(self.constants), self.coefficients.into_iter().map(floats).collect());
        Latent {
            name: self.name,
            library: self.library,
            partition: self.partition,
            map: AffineMap { constants, coefficients }.into(),
        }
    }
}

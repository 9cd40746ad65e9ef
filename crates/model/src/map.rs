//! The list of the kinds of latent functions.

use std::ops::{Deref, DerefMut};

use crate::{AffineMap, BasisMap, MapKind};

/// Map from functions to the value of a latent: one variant a kind. A [`MapKind`] is the interface of all kinds.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Map {
    /// Affine in the functions of the library, sparse or not.
    Affine(AffineMap),
    /// Functions of a basis beside them: radial functions, units of a network.
    Basis(BasisMap),
}

impl Deref for Map {
    type Target = dyn MapKind;

    fn deref(&self) -> &Self::Target {
        match self {
            Map::Affine(map) => map,
            Map::Basis(map) => map,
        }
    }
}

impl DerefMut for Map {
    fn deref_mut(&mut self) -> &mut Self::Target {
        match self {
            Map::Affine(map) => map,
            Map::Basis(map) => map,
        }
    }
}

impl From<AffineMap> for Map {
    fn from(map: AffineMap) -> Self {
        Map::Affine(map)
    }
}

impl From<BasisMap> for Map {
    fn from(map: BasisMap) -> Self {
        Map::Basis(map)
    }
}

//! The list of the kinds of latent functions.

use std::ops::{Deref, DerefMut};

use crate::{AffineMap, MapKind, RadialMap};

/// Map from functions to the value of a latent: one variant a kind. A [`MapKind`] is the interface of all kinds.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Map {
    /// Affine in the functions of the library, sparse or not.
    Affine(AffineMap),
    /// Radial functions around given centres beside them.
    Radial(RadialMap),
}

impl Deref for Map {
    type Target = dyn MapKind;

    fn deref(&self) -> &Self::Target {
        match self {
            Map::Affine(map) => map,
            Map::Radial(map) => map,
        }
    }
}

impl DerefMut for Map {
    fn deref_mut(&mut self) -> &mut Self::Target {
        match self {
            Map::Affine(map) => map,
            Map::Radial(map) => map,
        }
    }
}

impl From<AffineMap> for Map {
    fn from(map: AffineMap) -> Self {
        Map::Affine(map)
    }
}

impl From<RadialMap> for Map {
    fn from(map: RadialMap) -> Self {
        Map::Radial(map)
    }
}

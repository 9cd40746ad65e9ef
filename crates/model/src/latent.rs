//! Latent functions: a library, a partition, and a map from the values of the library's functions.

use crate::{AffineMap, Map};

/// A fitted function: in the region that a row falls in, a value from the functions of a library.
#[derive(Debug, Clone, PartialEq)]
pub struct Latent {
    /// Its name in equations.
    pub name: String,
    /// Index into the model's libraries.
    pub library: usize,
    /// Index into the model's partitions.
    pub partition: usize,
    /// Map from the functions to its value, region by region.
    pub map: Map,
}

impl Latent {
    /// The constants and coefficients of a latent that is affine in its functions; `None` for another kind.
    ///
    /// For code about coefficients alone: refits, bounds on linear maps, tables. Everything else reads [`Latent::map`].
    pub fn affine(&self) -> Option<&AffineMap> {
        match &self.map {
            Map::Affine(map) => Some(map),
            Map::Radial(_) => None,
        }
    }

    /// As [`Latent::affine`], to be changed.
    pub fn affine_mut(&mut self) -> Option<&mut AffineMap> {
        match &mut self.map {
            Map::Affine(map) => Some(map),
            Map::Radial(_) => None,
        }
    }
}

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
    /// Coefficients of the functions outside of what a region saw in training; empty where the region's map is followed everywhere.
    ///
    /// With them the value is `map(h) + beyond'(f - h)`, where h are the functions' values f, held within the training ranges of the region
    /// ([`RegionSummary::range`](crate::RegionSummary::range)): the region's map within them, and on from their border by slopes that all regions share.
    pub beyond: Vec<f64>,
}

impl Latent {
    /// True if the value depends on a function of the library.
    pub fn reads(&self, function: usize) -> bool {
        self.map.reads(function) || self.beyond.get(function).is_some_and(|slope| *slope != 0.0)
    }

    /// The constants and coefficients of a latent that is affine in its functions; `None` for another kind.
    ///
    /// For code about coefficients alone: refits, bounds on linear maps, tables. Everything else reads [`Latent::map`].
    pub fn affine(&self) -> Option<&AffineMap> {
        match &self.map {
            Map::Affine(map) => Some(map),
            Map::Basis(_) => None,
        }
    }

    /// As [`Latent::affine`], to be changed.
    pub fn affine_mut(&mut self) -> Option<&mut AffineMap> {
        match &mut self.map {
            Map::Affine(map) => Some(map),
            Map::Basis(_) => None,
        }
    }
}

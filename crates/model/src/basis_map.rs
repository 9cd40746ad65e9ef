//! The second kind of latent function: functions of a basis beside those of the library.

use crate::{affine_map::AffineMap, basis::Basis, map_array::MapArray, map_kind::MapKind};

/// In every region `constant + sum_j coefficient_j * function_j + sum_k weight_k * phi_k`, with the functions phi of a basis.
#[derive(Debug, Clone, PartialEq)]
pub struct BasisMap {
    /// Constants, and coefficients of the library's functions.
    pub affine: AffineMap,
    /// The basis; all regions have the same.
    pub basis: Basis,
    /// Weights of its functions, regions x basis functions.
    pub weights: Vec<Vec<f64>>,
}

impl MapKind for BasisMap {
    fn name(&self) -> &'static str {
        self.basis.kind()
    }

    fn regions(&self) -> usize {
        self.affine.regions()
    }

    fn functions(&self) -> usize {
        self.affine.functions()
    }

    fn basis(&self) -> Option<Basis> {
        Some(self.basis.clone())
    }

    fn constant(&self, region: usize) -> f64 {
        self.affine.constant(region)
    }

    fn coefficient(&self, region: usize, feature: usize) -> f64 {
        match feature.checked_sub(self.functions()) {
            None => self.affine.coefficient(region, feature),
            Some(k) => self.weights.get(region).and_then(|row| row.get(k)).copied().unwrap_or(0.0),
        }
    }

    fn set(&mut self, region: usize, feature: Option<usize>, value: f64) {
        match feature.and_then(|feature| feature.checked_sub(self.functions())) {
            None => self.affine.set(region, feature, value),
            Some(k) => {
                if let Some(weight) = self.weights.get_mut(region).and_then(|row| row.get_mut(k)) {
                    *weight = value;
                }
            }
        }
    }

    fn keep_region(&mut self, region: usize) {
        self.affine.keep_region(region);
        self.weights = vec![self.weights[region].clone()];
    }

    fn check(&self, functions: usize, regions: usize) -> Result<(), String> {
        self.affine.check(functions, regions)?;
        self.basis.check(functions)?;
        let (count, described) = (self.basis.count(), self.weights.len());
        match described == regions && self.weights.iter().all(|row| row.len() == count) {
            true => Ok(()),
            false => {
                Err(format!("weights for {described} of {regions} regions, of {count} functions of the basis each"))
            }
        }
    }

    fn arrays(&self) -> Vec<MapArray> {
        let mut arrays = self.affine.arrays();
        let values = self.weights.iter().flatten().copied().collect();
        let shape = vec![self.weights.len(), self.basis.count()];
        arrays.push(MapArray { name: "weights".into(), values, shape });
        arrays.extend(self.basis.arrays());
        arrays
    }
}

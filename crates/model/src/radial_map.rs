//! The second kind of latent function: radial functions beside those of the library.

use std::sync::Arc;

use crate::{
    affine_map::AffineMap,
    basis::Basis,
    gaussian::Gaussian,
    map_kind::{MapArray, MapKind},
};

/// In every region `constant + sum_j coefficient_j * function_j + sum_k weight_k * phi_k`, with radial functions phi of some functions.
#[derive(Debug, Clone, PartialEq)]
pub struct RadialMap {
    /// Constants, and coefficients of the library's functions.
    pub affine: AffineMap,
    /// The radial functions; all regions have the same.
    pub radial: Arc<Gaussian>,
    /// Their weights, regions x radial functions.
    pub weights: Vec<Vec<f64>>,
}

impl MapKind for RadialMap {
    fn name(&self) -> &'static str {
        "radial"
    }

    fn regions(&self) -> usize {
        self.affine.regions()
    }

    fn functions(&self) -> usize {
        self.affine.functions()
    }

    fn basis(&self) -> Option<Basis> {
        Some(Basis::Gaussian(self.radial.clone()))
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
        self.radial.check(functions)?;
        let (count, found) = (self.radial.count(), self.weights.len());
        match found == regions && self.weights.iter().all(|row| row.len() == count) {
            true => Ok(()),
            false => Err(format!("weights for {found} of {regions} regions, of {count} radial functions each")),
        }
    }

    fn arrays(&self) -> Vec<MapArray> {
        let (radial, mut arrays) = (&self.radial, self.affine.arrays());
        let flat = |rows: &[Vec<f64>]| rows.iter().flatten().copied().collect::<Vec<f64>>();
        let (count, inputs) = (radial.count(), radial.inputs.len());
        for (name, values, shape) in [
            ("weights", flat(&self.weights), vec![self.weights.len(), count]),
            ("inputs", radial.inputs.iter().map(|&input| input as f64).collect(), vec![inputs]),
            ("centres", flat(&radial.centres), vec![count, inputs]),
            ("scale", radial.scale.clone(), vec![inputs]),
            ("width", vec![radial.width], vec![1]),
        ] {
            arrays.push(MapArray { name, values, shape });
        }
        arrays
    }
}

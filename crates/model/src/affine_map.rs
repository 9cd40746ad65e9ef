//! The first kind of latent function: an affine map a region.

use crate::{map_array::MapArray, map_kind::MapKind};

/// In every region `constant + sum_j coefficient_j * function_j`, mostly zeros where it was found by sparse regression.
#[derive(Debug, Clone, PartialEq)]
pub struct AffineMap {
    /// Constant term, one per region.
    pub constants: Vec<f64>,
    /// Coefficients, regions x functions.
    pub coefficients: Vec<Vec<f64>>,
}

impl MapKind for AffineMap {
    fn name(&self) -> &'static str {
        "affine"
    }

    fn regions(&self) -> usize {
        self.constants.len()
    }

    fn functions(&self) -> usize {
        self.coefficients.first().map_or(0, Vec::len)
    }

    fn constant(&self, region: usize) -> f64 {
        self.constants[region]
    }

    fn coefficient(&self, region: usize, feature: usize) -> f64 {
        self.coefficients.get(region).and_then(|row| row.get(feature)).copied().unwrap_or(0.0)
    }

    fn set(&mut self, region: usize, feature: Option<usize>, value: f64) {
        let place = match feature {
            None => self.constants.get_mut(region),
            Some(j) => self.coefficients.get_mut(region).and_then(|row| row.get_mut(j)),
        };
        if let Some(place) = place {
            *place = value;
        }
    }

    fn keep_region(&mut self, region: usize) {
        self.constants = vec![self.constants[region]];
        self.coefficients = vec![self.coefficients[region].clone()];
    }

    fn check(&self, functions: usize, regions: usize) -> Result<(), String> {
        if self.constants.len() != regions || self.coefficients.len() != regions {
            return Err(format!("coefficients for {} of {regions} regions", self.coefficients.len()));
        }
        match self.coefficients.iter().find(|row| row.len() != functions) {
            Some(row) => Err(format!("{} coefficients for {functions} functions", row.len())),
            None => Ok(()),
        }
    }

    fn arrays(&self) -> Vec<MapArray> {
        let values = self.coefficients.iter().flatten().copied().collect();
        let shape = vec![self.coefficients.len(), self.functions()];
        vec![
            MapArray { name: "constants".into(), values: self.constants.clone(), shape: vec![self.constants.len()] },
            MapArray { name: "coefficients".into(), values, shape },
        ]
    }
}

//! What every kind of latent function can say and do.

use std::fmt::Debug;

use fleetfoot_library::Expr;

/// Numbers of a map, by name, with their shape: what a file of arrays holds of it.
#[derive(Debug, Clone, PartialEq)]
pub struct MapArray {
    /// Its name within the latent: `coefficients`.
    pub name: &'static str,
    /// The numbers, the last dimension fastest.
    pub values: Vec<f64>,
    /// Lengths of the dimensions.
    pub shape: Vec<usize>,
}

/// A kind of latent function: how a value follows from the functions f of a library, in a region r.
///
/// Every kind ends in an affine function of features: `constant(r) + sum_j coefficient(r, j) * feature_j`. The features are the functions of the library.
/// Simulation, exported code and text for people read a latent through this trait alone.
pub trait MapKind: Debug {
    /// The kind, for people: `affine`.
    fn name(&self) -> &'static str;

    /// Regions that it has a function for.
    fn regions(&self) -> usize;

    /// Number of features.
    fn features(&self) -> usize;

    /// The constant term in a region.
    fn constant(&self, region: usize) -> f64;

    /// The coefficient of a feature in a region; 0 for a feature that it does not have.
    fn coefficient(&self, region: usize, feature: usize) -> f64;

    /// Gives the constant term (`None`) or the coefficient of a feature a value. What it does not have is left alone.
    fn set(&mut self, region: usize, feature: Option<usize>, value: f64);

    /// Leaves one region of all.
    fn keep_region(&mut self, region: usize);

    /// Whether it fits a library of so many functions and a partition of so many regions; else what does not.
    ///
    /// # Errors
    /// The contradiction, in words.
    fn check(&self, functions: usize, regions: usize) -> Result<(), String>;

    /// All its numbers.
    fn arrays(&self) -> Vec<MapArray>;

    /// Whether a feature has a coefficient in any region.
    fn has(&self, feature: usize) -> bool {
        (0..self.regions()).any(|region| self.coefficient(region, feature) != 0.0)
    }

    /// Whether its value depends on a function of the library.
    fn reads(&self, function: usize) -> bool {
        self.has(function)
    }

    /// Fitted numbers that are not zero; constants are not counted.
    fn parameters(&self) -> usize {
        let of = |region| (0..self.features()).filter(move |&j| self.coefficient(region, j) != 0.0).count();
        (0..self.regions()).map(of).sum()
    }

    /// A feature by the name that text for people has for it; `library` are the functions of the latent's library.
    fn feature(&self, feature: usize, library: &[Expr]) -> Option<Expr> {
        library.get(feature).cloned()
    }

    /// The value in a region, from the values of the library's functions.
    fn value(&self, region: usize, functions: &[f64]) -> f64 {
        functions.iter().enumerate().fold(self.constant(region), |sum, (j, f)| sum + self.coefficient(region, j) * f)
    }

    /// Forward product: how the value changes where the functions change by `change`.
    fn tangent(&self, region: usize, functions: &[f64], change: &[f64]) -> f64 {
        let mut slopes = vec![0.0; functions.len()];
        self.gradient(region, functions, 1.0, &mut slopes);
        slopes.iter().zip(change).map(|(slope, change)| slope * change).sum()
    }

    /// Reverse product: adds `weight` times the derivative of the value by every function.
    fn gradient(&self, region: usize, functions: &[f64], weight: f64, slopes: &mut [f64]) {
        for (j, slope) in slopes.iter_mut().enumerate().take(functions.len()) {
            *slope += weight * self.coefficient(region, j);
        }
    }
}

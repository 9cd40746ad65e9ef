//! Common interface of all kinds of latent functions.

use std::fmt::Debug;

use fleetfoot_library::Expr;

use crate::{basis::Basis, map_array::MapArray};

/// A kind of latent function: how a value follows from the functions f of a library, in a region r.
///
/// Every kind ends in an affine function of features: `constant(r) + sum_j coefficient(r, j) * feature_j`. The features are the functions of the library, and behind
/// them the functions of the kind's basis, where it has one. Simulation, exported code and text for people read a latent through this trait alone.
pub trait MapKind: Debug {
    /// The kind, for people: `affine`.
    fn name(&self) -> &'static str;

    /// Regions that it has a function for.
    fn regions(&self) -> usize;

    /// Number of functions of the library.
    fn functions(&self) -> usize;

    /// The constant term in a region.
    fn constant(&self, region: usize) -> f64;

    /// The coefficient of a feature in a region; 0 for a feature that it does not have.
    fn coefficient(&self, region: usize, feature: usize) -> f64;

    /// Sets the constant term (`None`) or the coefficient of a feature. A missing feature is ignored.
    fn set(&mut self, region: usize, feature: Option<usize>, value: f64);

    /// Leaves one region of all.
    fn keep_region(&mut self, region: usize);

    /// Checks that it fits a library of so many functions and a partition of so many regions.
    ///
    /// # Errors
    /// The contradiction, in words.
    fn check(&self, functions: usize, regions: usize) -> Result<(), String>;

    /// All its numbers.
    fn arrays(&self) -> Vec<MapArray>;

    /// The functions that stand beside those of the library.
    fn basis(&self) -> Option<Basis> {
        None
    }

    /// Number of features.
    fn features(&self) -> usize {
        self.functions() + self.basis().map_or(0, |basis| basis.count())
    }

    /// Returns true if a feature has a coefficient in any region.
    fn has(&self, feature: usize) -> bool {
        (0..self.regions()).any(|region| self.coefficient(region, feature) != 0.0)
    }

    /// Returns true if its value depends on a function of the library.
    fn reads(&self, function: usize) -> bool {
        let through = |basis: Basis| {
            let mut added = self.functions()..self.features();
            basis.inputs().contains(&function) && added.any(|feature| self.has(feature))
        };
        self.has(function) || self.basis().is_some_and(through)
    }

    /// Coefficients that are not zero; constants, and the numbers inside a basis, are not counted.
    fn parameters(&self) -> usize {
        let of = |region| (0..self.features()).filter(move |&j| self.coefficient(region, j) != 0.0).count();
        (0..self.regions()).map(of).sum()
    }

    /// A feature by the name that text for people has for it; `library` are the functions of the latent's library.
    fn feature(&self, feature: usize, library: &[Expr]) -> Option<Expr> {
        match feature.checked_sub(self.functions()) {
            None => library.get(feature).cloned(),
            Some(function) => self.basis().map(|basis| Expr::column(basis.name(function))),
        }
    }

    /// A feature written out over the columns.
    fn expression(&self, feature: usize, library: &[Expr]) -> Option<Expr> {
        match feature.checked_sub(self.functions()) {
            None => library.get(feature).cloned(),
            Some(function) => self.basis()?.expression(function, library),
        }
    }

    /// The value in a region, from the values of the library's functions.
    fn value(&self, region: usize, functions: &[f64]) -> f64 {
        let values = self.basis().map_or_else(Vec::new, |basis| at(&basis, functions).1);
        let features = functions.iter().chain(&values).enumerate();
        features.fold(self.constant(region), |sum, (j, feature)| sum + self.coefficient(region, j) * feature)
    }

    /// Forward product: how the value changes where the functions change by `change`.
    fn tangent(&self, region: usize, functions: &[f64], change: &[f64]) -> f64 {
        let values = self.basis().map_or_else(Vec::new, |basis| {
            let (inputs, values) = at(&basis, functions);
            let change: Vec<f64> = basis.inputs().iter().map(|&input| change[input]).collect();
            let mut along = vec![0.0; values.len()];
            basis.tangent(&inputs, &values, &change, &mut along);
            along
        });
        change.iter().chain(&values).enumerate().map(|(j, along)| self.coefficient(region, j) * along).sum()
    }

    /// Reverse product: adds `weight` times the derivative of the value by every function.
    fn gradient(&self, region: usize, functions: &[f64], weight: f64, slopes: &mut [f64]) {
        for (j, slope) in slopes.iter_mut().enumerate().take(functions.len()) {
            *slope += weight * self.coefficient(region, j);
        }
        let Some(basis) = self.basis() else { return };
        let (inputs, values) = at(&basis, functions);
        let weights: Vec<f64> =
            (self.functions()..self.features()).map(|j| weight * self.coefficient(region, j)).collect();
        let mut gradient = vec![0.0; inputs.len()];
        basis.gradient(&inputs, &values, &weights, &mut gradient);
        basis.inputs().iter().zip(gradient).for_each(|(&input, slope)| slopes[input] += slope);
    }
}

/// The inputs of a basis among the values of a library's functions, and its own values.
fn at(basis: &Basis, functions: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let inputs: Vec<f64> = basis.inputs().iter().map(|&input| functions[input]).collect();
    let mut values = vec![0.0; basis.count()];
    basis.evaluate(&inputs, &mut values);
    (inputs, values)
}

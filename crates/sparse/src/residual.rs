//! Coefficients that are carried from lambda to lambda, with the remaining correlations: for every solver that
//! descends.

use crate::{Quadratic, products::Products};

/// Coefficients in correlation form with the gradients of all columns.
pub(crate) struct Residual<'a> {
    pub(crate) problem: &'a Quadratic,
    /// Of the columns that took part.
    pub(crate) products: Products<'a>,
    /// Correlations with the target (padded).
    pub(crate) target: Vec<f64>,
    /// Coefficients (p).
    pub(crate) delta: Vec<f64>,
    /// Correlations with the residual of `delta`, without ridge (padded).
    pub(crate) gradient: Vec<f64>,
}

impl<'a> Residual<'a> {
    /// All coefficients zero.
    pub(crate) fn new(problem: &'a Quadratic) -> Self {
        let p = problem.columns();
        let target = problem.target_correlations();
        Self { problem, products: Products::of(problem), delta: vec![0.0; p], gradient: target.clone(), target }
    }

    /// Goes on from other coefficients (p).
    pub(crate) fn start(&mut self, delta: Vec<f64>) {
        self.delta = delta;
        let active: Vec<usize> = (0..self.delta.len()).filter(|&j| self.delta[j] != 0.0).collect();
        self.products.form(&active);
        self.refresh();
    }

    /// Computes the gradient of all columns anew; the products of all coefficients that are not zero must be formed.
    pub(crate) fn refresh(&mut self) {
        self.products.left(&self.delta, &self.target, &mut self.gradient);
    }
}

//! Coefficients that are carried from lambda to lambda, and what they leave of the correlations: for every solver that descends.

use crate::{Quadratic, kernel::add_scaled, quadratic::Form};

/// Coefficients in correlation form with the gradients of all columns. From square-root form only the Gram columns that were asked for are ever formed.
pub(crate) struct Residual<'a> {
    pub(crate) problem: &'a Quadratic,
    /// Gram columns that were needed so far (square-root form).
    formed: Vec<Option<Vec<f64>>>,
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
        Self { problem, formed: vec![None; p], delta: vec![0.0; p], gradient: target.clone(), target }
    }

    /// Makes the Gram column of j available.
    pub(crate) fn form(&mut self, j: usize) {
        if matches!(self.problem.form, Form::Root { .. }) && self.formed[j].is_none() {
            let mut column = vec![0.0; self.target.len()];
            self.problem.correlations_of(j, &mut column);
            self.formed[j] = Some(column);
        }
    }

    /// The Gram column of j, once it is formed.
    pub(crate) fn column(&self, j: usize) -> &[f64] {
        match &self.problem.form {
            Form::Gram { g, .. } => g.column(j),
            Form::Root { .. } => self.formed[j].as_deref().unwrap_or(&[]),
        }
    }

    /// Computes the gradient of all columns anew; the columns of all coefficients that are not zero must be formed.
    pub(crate) fn refresh(&mut self) {
        let mut gradient = std::mem::take(&mut self.gradient);
        gradient.copy_from_slice(&self.target);
        for j in (0..self.delta.len()).filter(|&j| self.delta[j] != 0.0) {
            add_scaled(-self.delta[j], self.column(j), &mut gradient);
        }
        self.gradient = gradient;
    }
}

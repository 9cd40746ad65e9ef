//! Candidates that every equation may have, and those of every model.

use fleetfoot_sparse::threshold::Terms;

use crate::{
    coefficients::bounds,
    equations::{EquationTask, FittedEquation},
};

impl EquationTask {
    /// Candidates that every equation may have, and those of every model, for the optimisers.
    pub fn terms(&self) -> Vec<Terms> {
        let mut terms = self.free_terms();
        if !self.limits.is_empty() {
            for (equation, terms) in terms.iter_mut().enumerate() {
                let limits = self.limits.iter().filter(|limit| limit.owner == equation);
                terms.bounds = Some(bounds(self.candidates(), limits, |limit| limit.candidate));
            }
        }
        terms
    }

    /// The same without bounds of coefficients.
    pub fn free_terms(&self) -> Vec<Terms> {
        let terms = |equation: &FittedEquation| Terms {
            allowed: Some(equation.allowed.clone()),
            fixed: equation.fixed.clone(),
            ..Terms::all()
        };
        self.fitted.iter().map(terms).collect()
    }
}

//! Equations fitted to simulations: the terms stay, the coefficients are those of the objective.

use faer::Mat;
use fleetfoot_model::Model;
use fleetfoot_task::EquationTask;

use super::{SindyReport, report};
use crate::objective::Coefficients;

/// The coefficients of a model of a task, region by region (candidates x equations).
pub(crate) fn coefficients_of(model: &Model, task: &EquationTask, regions: usize) -> Vec<Mat<f64>> {
    let places: Vec<Coefficients> = (0..task.fitted.len()).map(|t| Coefficients::new(task, model, t)).collect();
    let value = |region: usize, j: usize, t: usize| places[t].of(region, j).unwrap_or(0.0);
    (0..regions).map(|region| Mat::from_fn(task.candidates(), task.fitted.len(), |j, t| value(region, j, t))).collect()
}

impl SindyReport {
    /// Reports the equations of a model that was fitted to simulations: its coefficients, whose standard errors are not
    /// known, and its errors.
    pub(super) fn refine(&mut self, task: &EquationTask, model: &Model) {
        let Some(refinement) = self.summary.refinement.as_ref().filter(|refinement| refinement.written) else { return };
        // The errors of single regions are not known.
        let whole = self.regions.len() == 1;
        let places: Vec<Coefficients> = (0..task.fitted.len()).map(|t| Coefficients::new(task, model, t)).collect();
        for (at, region) in self.regions.iter_mut().enumerate() {
            for (target, equation) in region.equations.iter_mut().enumerate() {
                for term in &mut equation.terms {
                    let coefficient = places[target].of(at, term.candidate);
                    (term.coefficient, term.standard_error) = (coefficient.unwrap_or(0.0), f64::NAN);
                }
                equation.right = report::right(task, target, &equation.terms);
                let scores = &refinement.training.targets[target];
                (equation.rms, equation.r2) = if whole { (scores.rmse, scores.r2) } else { (f64::NAN, f64::NAN) };
                [equation.held_out, equation.held_out_r2] =
                    if whole { refinement.held_out(target) } else { [f64::NAN; 2] };
            }
        }
    }
}

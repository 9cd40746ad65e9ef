//! Equation error: parameters with which the equations hold row by row, every equation by its own noise.

use fleetfoot_data::{Progress, Source};

use crate::{Bounded, Estimate, EstimateError, Options, Residual, nonlinear_least_squares};

/// Rounds of the alternation, at most.
const ROUNDS: usize = 50;
/// Relative change of the deviations at which it ends.
const SAME: f64 = 1e-9;

/// Parameters of equations that hold row by row.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct EquationError {
    /// The parameters, each equation weighing by its own noise.
    pub estimate: Estimate,
    /// Standard deviation of the residuals of each equation, in its unit.
    pub deviations: Vec<f64>,
    /// True if the alternation converged.
    pub settled: bool,
}

/// Maximum likelihood of normal errors in the equations, independent from row to row. Least squares and the variances
/// of the errors alternate until both stay; the weights of `residuals` are the start.
///
/// # Errors
/// Those of [`nonlinear_least_squares`].
pub fn equation_error<'a>(
    residuals: &[Residual],
    parameters: impl Into<Bounded<'a>>,
    source: &dyn Source,
    options: &Options,
    progress: &dyn Progress,
) -> Result<EquationError, EstimateError> {
    let (bounded, mut options) = (parameters.into(), *options);
    let (mut residuals, mut parameters) = (residuals.to_vec(), bounded.parameters.to_vec());
    let inside: Vec<f64> = parameters.iter().map(|parameter| parameter.initial).collect();
    let mut round = 0;
    loop {
        round += 1;
        let inner = Bounded { parameters: &parameters, inside: Some(bounded.inside.unwrap_or(&inside)), ..bounded };
        let estimate = nonlinear_least_squares(&residuals, inner, source, &options, progress)?;
        options.search = 0;
        let deviation = |(share, residual): (&f64, &Residual)| (share / residual.weight / estimate.rows as f64).sqrt();
        let deviations: Vec<f64> = estimate.shares.iter().zip(&residuals).map(deviation).collect();
        let stays = |(residual, deviation): (&Residual, &f64)| (residual.weight.sqrt() * deviation - 1.0).abs() < SAME;
        let settled = residuals.len() < 2
            || residuals.iter().zip(&deviations).all(stays)
            || deviations.iter().any(|&deviation| deviation <= 0.0);
        if settled || round == ROUNDS {
            return Ok(EquationError { estimate, deviations, settled });
        }
        residuals.iter_mut().zip(&deviations).for_each(|(residual, deviation)| residual.weight = deviation.powi(-2));
        parameters.iter_mut().zip(&estimate.values).for_each(|(parameter, &value)| parameter.initial = value);
    }
}

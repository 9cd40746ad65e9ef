//! Filter error: maximum likelihood of the parameters of given equations, where both the measurements and the dynamics are noisy.
//!
//! The simulation of [`output_error`](crate::output_error()) becomes a filter of constant gain: with the errors e_k =
//! y_k - x_k of the measurements,
//!
//! ```text
//! x_k+ = x_k + K e_k,    x_{k+1} = x_k+ advanced by x' = f(x, u, theta) over a step
//! ```
//!
//! and the e_k are its innovations (Maine and Iliff 1985; Jategaonkar, Flight vehicle system identification, 2006,
//! chapter 5). The objective over the parameters, the gain, the states at the beginnings and the innovations' variances
//! is, up to a constant,
//!
//! ```text
//! sum_j n_j log sigma_j + 1/2 sum_j sum_c sum_k e_jck^2 / sigma_j^2
//! ```
//!
//! The noise of the dynamics would give the gain by a Riccati equation; here the gain itself is estimated. It is
//! diagonal: one number a measured state, which has no unit and lies between 0 and 1. At 0 measurements correct
//! nothing, which is output error. At 1 every step begins at the measurement, which is equation error over a step. The
//! best gain for noise of both kinds need not be diagonal, so that innovations may be correlated from row to row, and
//! from state to state. The covariance of the estimates is corrected by that correlation, as by output error.

use faer::Mat;
use fleetfoot_data::{Progress, Source};
use fleetfoot_model::Model;
use fleetfoot_stats::student_t_95;

use crate::{
    Bounded, EstimateError, Gains, OutputError, OutputErrorOptions,
    output_error::{Minimum, minimum},
};

/// Options of estimation by filter error.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct FilterErrorOptions {
    /// Simulations, outputs, starts and ends, as by output error.
    pub simulation: OutputErrorOptions,
    /// The gains.
    pub gains: Gains,
}

/// Parameters by filter error.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct FilterError {
    /// The parameters; deviations are those of the innovations, and beginnings those of the filter.
    pub parameters: OutputError,
    /// The gains, one an output.
    pub gains: Vec<Gain>,
    /// Covariance of the innovations of a row (m x m), in the outputs' own units.
    pub innovations: Mat<f64>,
}

/// By how much the measurements of a state correct the simulation.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Gain {
    /// The state.
    pub state: String,
    /// Between 0, which is output error, and 1, which is equation error.
    pub value: f64,
    /// Its standard error, for innovations as correlated as they are. It is 0 if the gain is held or at a bound, and
    /// infinite if the rows do not determine it.
    pub error: f64,
    /// Half the width of its 95 % interval, which ends at 0 and 1.
    pub half_width: f64,
    /// True if the gain is at an active bound: 0 or 1 itself.
    pub at_bound: bool,
}

impl Gain {
    /// The 95 % interval.
    pub fn interval(&self) -> [f64; 2] {
        [-self.half_width, self.half_width].map(|half| (self.value + half).clamp(0.0, 1.0))
    }
}

/// Estimates the parameters of a model by filter error. Model, parameters and source are as for
/// [`output_error`](crate::output_error()).
///
/// The same bits on any number of threads.
///
/// # Errors
/// Those of output error; gains that are not between 0 and 1, or not one an output.
pub fn filter_error<'a>(
    model: &Model,
    parameters: impl Into<Bounded<'a>>,
    source: &dyn Source,
    options: &FilterErrorOptions,
    progress: &dyn Progress,
) -> Result<FilterError, EstimateError> {
    progress.stage("filter error");
    let minimum = minimum(model, &parameters.into(), Some(&options.gains), source, &options.simulation, progress)?;
    let gains = (0..minimum.gains.len()).map(|at| gain(&minimum, at)).collect();
    Ok(FilterError { gains, innovations: minimum.residuals, parameters: minimum.parameters })
}

fn gain(minimum: &Minimum, at: usize) -> Gain {
    let parameters = &minimum.parameters;
    let error = match minimum.gains_undetermined.contains(&at) {
        true => f64::INFINITY,
        // As of the parameters, the larger of both.
        false => minimum.variances[at].max(minimum.white[at]).sqrt(),
    };
    let unknowns =
        parameters.values.len() + minimum.gains.len() + parameters.beginnings.len() * parameters.states.len();
    Gain {
        state: parameters.outputs[at].clone(),
        value: minimum.gains[at],
        error,
        half_width: student_t_95((parameters.residuals as usize).saturating_sub(unknowns)) * error,
        at_bound: minimum.gains_at_bounds.contains(&at),
    }
}

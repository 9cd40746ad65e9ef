//! Nonlinear parameters from logs.
//!
//! [`nonlinear_least_squares`] minimises, over the parameters theta between their bounds,
//!
//! ```text
//! sum_k w_k sum_i (y_k(x_i) - g_k(x_i, theta))^2
//! ```
//!
//! over residuals k and all rows i of a source (equation (42) of the block-sparse bolasso paper), y and g any
//! expressions over columns, and over parameters by name. Derivatives are exact. Every trial step is one pass over the
//! rows, which leaves a triangular factor for each residual. Memory does not grow with the rows, and nothing is
//! squared.
//!
//! [`separable`] does the same for models that are linear in most of their unknowns, `sum_j c_kj phi_kj(x_i, theta)`:
//! it searches over theta alone. Both take filters, such as a motor's first-order lag, with their constants among the
//! parameters, and give standard errors.
//!
//! [`output_error`] estimates the parameters of a model's given equations so that its simulations stay nearest to the
//! measurements. It takes the noise to be in the measurements, and initial states are among the unknowns.
//! [`equation_error`] estimates them so that the equations hold row by row. [`filter_error`] takes noise in both:
//! measurements correct its simulations by gains that are estimated too.
//!
//! [`simulation_error`] fits the coefficients of a model to its own simulations through segments of a recording instead of to one step.
//!
//! [`StateSmoother`] finds the states and the coefficients under which measurements and equations disagree least, both with noise.
//!
//! [`resimulate`] finds the states and inputs that obey a model and stay nearest to a recording.
//!
//! ```
//! use fleetfoot_data::{Column, MemorySource, Silent};
//! use fleetfoot_estimate::{Options, Parameter, Residual, nonlinear_least_squares};
//! use fleetfoot_library::{Expr, Scope};
//!
//! // y = exp(-0.7 x): the rate is found from rows.
//! let x: Vec<f64> = (0..50).map(|row| 0.1 * f64::from(row)).collect();
//! let y = x.iter().map(|x| (-0.7 * x).exp()).collect();
//! let mut rows = MemorySource::new(vec![Column::float("x"), Column::float("y")]);
//! rows.push_uniform("run", 0.1, vec![x, y]);
//! let scope = Scope::new(["x", "y", "rate"]);
//! let residual = Residual::new(Expr::parse("y", &scope)?, Expr::parse("exp(-rate*x)", &scope)?);
//! let estimate = nonlinear_least_squares(&[residual], &[Parameter::new("rate", 0.1)], &rows, &Options::default(), &Silent)?;
//! assert!((estimate.values[0] - 0.7).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod covariance;
mod descent;
mod equation_error;
mod error;
mod evaluate;
mod evaluation;
mod filter_error;
mod fit;
mod gains;
mod limits;
mod output_error;
mod parameter;
mod problem;
mod products;
mod reader;
mod reads;
mod recorded;
mod resimulation;
mod rows;
mod search;
mod separable;
mod simulation;
mod smoothing;
mod step;
mod transcription;
mod uncertain;

pub use descent::{Options, Status};
pub use equation_error::{EquationError, equation_error};
pub use error::EstimateError;
pub use filter_error::{FilterError, FilterErrorOptions, Gain, filter_error};
pub use fit::{Estimate, nonlinear_least_squares};
pub use gains::Gains;
pub use limits::{Affine, Bounded, MatrixLimit};
pub use output_error::{Begun, OutputError, OutputErrorOptions, output_error};
pub use parameter::Parameter;
pub use problem::Residual;
pub use resimulation::{Certificate, Ending, Resimulated, Resimulation, ResimulationOptions, resimulate};
pub use separable::{LinearFit, LinearTarget, Separable, SeparableOptions, Start, separable};
pub use simulation::{
    Hold, MOST_PRODUCTS, ManyOptions, Simulated, SimulationOptions, WHOLE_COEFFICIENTS, simulation_error,
    simulation_errors,
};
pub use smoothing::{Settled, SmoothingOptions, StateSmoother, Tracks, Variances};
pub use uncertain::Uncertain;

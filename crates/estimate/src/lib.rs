//! Nonlinear parameters from logs.
//!
//! [`nonlinear_least_squares`] minimises, over the parameters theta between their bounds,
//!
//! ```text
//! sum_k w_k sum_i (y_k(x_i) - g_k(x_i, theta))^2
//! ```
//!
//! over residuals k and all rows i of a source (equation (42) of the block-sparse bolasso paper), y and g any expressions over columns, and over
//! parameters by name. Derivatives are exact. Every trial step is one pass over the rows, which leaves a triangular factor for each residual: memory
//! does not grow with the rows, and nothing is squared.

mod covariance;
mod error;
mod evaluate;
mod fit;
mod problem;
mod step;

pub use error::EstimateError;
pub use fit::{Estimate, Options, Status, nonlinear_least_squares};
pub use problem::{Parameter, Residual};

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
//!
//! [`separable`] does the same for models that are linear in most of what is unknown, `sum_j c_kj phi_kj(x_i, theta)`: it searches over theta
//! alone. Both take filters, such as a motor's first-order lag, with their constants among the parameters, and answer with standard errors.

mod covariance;
mod descent;
mod error;
mod evaluate;
mod fit;
mod problem;
mod reads;
mod rows;
mod separable;
mod step;
mod uncertain;

pub use descent::{Options, Status};
pub use error::EstimateError;
pub use fit::{Estimate, nonlinear_least_squares};
pub use problem::{Parameter, Residual};
pub use separable::{LinearFit, LinearTarget, Separable, SeparableOptions, Start, separable};
pub use uncertain::Uncertain;

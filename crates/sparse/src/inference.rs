//! Inference for a fit on a support: standard errors, intervals, coefficients that cannot be told apart, and the logs
//! that determine the fit.
//!
//! Everything here is conditional on the support. A support that was chosen on the same rows makes intervals too short,
//! by an unknown amount. [`crate::bolasso::stability_selection`] and the replicates of the bolasso measure the choice
//! itself.

mod bootstrap;
mod confounded;
mod covariance;
mod error;
mod influence;
mod least_squares;
mod system;

pub use bootstrap::{BootstrapInterval, bootstrap_intervals};
pub use confounded::{Confounded, Confounding, confounded};
pub use covariance::{Clusters, Covariance, clustered_covariance};
pub use error::InferenceError;
pub use influence::{Influence, InfluenceReport, influence};
pub use least_squares::least_squares_on;
pub use system::{system_effective_rows, system_errors};

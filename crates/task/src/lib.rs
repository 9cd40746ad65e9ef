//! A recipe resolved for a recording: its columns, its equations, and the task of a fit.
//!
//! Every method has a task: [`Task`] of `fit pwa`, [`StructuredTask`] of `fit sparse`, [`EquationTask`] of `fit sindy`
//! and `fit narx`, [`ParametersTask`] of `fit parameters`. [`KnownTask`] has given equations only. All read a recipe
//! through the same [`Aliases`](fleetfoot_recipe::Aliases). No log is opened here.

mod coefficients;
mod derivative;
mod difference;
mod differentiated;
mod equations;
mod error;
mod filters;
mod known;
mod leak;
mod model;
mod parameter;
mod parameters;
mod partition;
mod piecewise;
mod preparation;
mod structured;
mod system;
mod task;
mod terms;
mod units;
mod weak;
mod windows;

pub use coefficients::{CoefficientLimit, bounds};
pub use difference::{Difference, DifferenceErrors, SettledDifference};
pub use equations::{EquationTask, FittedEquation};
pub use error::Error;
pub use known::KnownTask;
pub use model::Provenance;
pub use parameter::{Parameter, names};
pub use parameters::ParametersTask;
pub use partition::{placeholder, specification};
pub use piecewise::piecewise;
pub use preparation::prepared;
pub use structured::{Moments, StructuredTask};
pub use task::{Task, rate_unit, seen};
pub use windows::{WeakForm, Windows};

//! What a recipe means for a recording: its columns, its equations, and what they are fitted on.
//!
//! Every method has its task: [`Task`] of `fit pwa`, [`StructuredTask`] of `fit sparse`, [`EquationTask`] of `fit sindy` and `fit narx`, [`ParametersTask`] of `fit parameters`, and
//! [`KnownTask`] where nothing is fitted. All read a recipe through the same [`Aliases`]. No log is opened here.

mod aliases;
mod attitude;
mod coefficients;
mod derivative;
mod difference;
mod differentiated;
mod equations;
mod filters;
mod known;
mod leak;
mod parameter;
mod parameters;
mod partition;
mod piecewise;
mod preparation;
mod structured;
mod system;
mod task;
mod weak;
mod windows;

pub(crate) use aliases::{Aliases, aliases_of_model};
pub use coefficients::CoefficientLimit;
pub(crate) use coefficients::bounds;
pub use difference::{Difference, DifferenceErrors, SettledDifference};
pub use equations::{EquationTask, FittedEquation};
pub(crate) use known::KnownTask;
pub use parameter::Parameter;
pub(crate) use parameter::names;
pub(crate) use parameters::ParametersTask;
pub(crate) use partition::{clustering, placeholder, regions, specification};
pub(crate) use piecewise::piecewise;
pub(crate) use preparation::prepared;
pub use structured::{Moments, StructuredTask};
pub use task::Task;
pub(crate) use task::{rate_unit, seen};
pub(crate) use windows::WeakForm;
pub use windows::Windows;

//! Why a model has no regulator or no filter.

use crate::{control_error::ControlError, filter_error::FilterError};

/// Why a regulator or a filter could not be made of a model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The model cannot be run.
    #[error(transparent)]
    Dynamics(#[from] fleetfoot_dynamics::Error),
    /// The design of a regulator or a filter does not fit the model.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// A filter cannot be made of the model.
    #[error(transparent)]
    Filter(#[from] FilterError),
}

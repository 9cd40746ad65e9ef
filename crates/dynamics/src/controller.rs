//! Interface of a controller that closes the loop around a model in a rollout.

mod driver;

use std::fmt;

pub(crate) use driver::{Drive, Driver, Read};

pub use crate::parameter_error::ParameterError;

/// Law that drives inputs of a model in a closed loop: immutable, shared by all trajectories.
pub trait Controller: fmt::Debug + Send + Sync {
    /// Columns that it reads: states, or columns of the recording such as a belt's speed.
    fn reads(&self) -> Vec<String>;

    /// Inputs of the model that it drives.
    fn drives(&self) -> Vec<String>;

    /// Checks the parameters.
    ///
    /// # Errors
    /// The first parameter that cannot be used.
    fn validate(&self) -> Result<(), ParameterError> {
        Ok(())
    }

    /// Its memory at the start of a trajectory.
    fn start(&self) -> Box<dyn ControllerState>;
}

/// A controller's memory along one trajectory.
pub trait ControllerState: Send {
    /// Sets the inputs for the step that begins now; called once a step, before it.
    ///
    /// `seconds` count from the trajectory's start; `columns` hold the present values of [`Controller::reads`].
    /// `inputs`, in the order of [`Controller::drives`], come with the values of the step before (at the start with the
    /// recorded ones). An unchanged input is held.
    fn control(&mut self, seconds: f64, columns: &[f64], inputs: &mut [f64]);
}

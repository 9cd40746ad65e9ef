//! Controllers: laws that drive a model's inputs, or a robot's, from measurements of its state.
//!
//! A [`Controller`] closes the loop around a model in a rollout. Its laws ([`Treadmill`], [`DifferentialDrive`],
//! [`Pid`]) are those that a simulated robot runs on.

mod differential_drive;
mod pid;
mod regulator;
mod regulator_model;
mod sampling;
mod treadmill;
mod treadmill_loop;

pub use differential_drive::DifferentialDrive;
pub use pid::{Pid, PidState};
pub use regulator::{
    DrivenInput, ErrorBound, MOST_SAMPLES, MOST_SEQUENCES, MeasuredColumn, PredictedStep, PredictedTarget, Prediction,
    PredictionTables, RegionChoice, RegionLaw, RegulatedRotation, RegulatedState, Regulator,
};
pub use sampling::Sampling;
pub use treadmill::Treadmill;
pub use treadmill_loop::{TreadmillLoop, TreadmillSpeed};

pub use fleetfoot_dynamics::{
    ParameterError,
    controller::{Controller, ControllerState},
};

/// Refuses a number that is not finite or does not pass the test.
fn check(name: &str, value: f64, ok: bool, allowed: &'static str) -> Result<(), ParameterError> {
    if ok && value.is_finite() { Ok(()) } else { Err(ParameterError::new(name, value, allowed)) }
}

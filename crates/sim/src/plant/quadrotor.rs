//! A quadrotor that tracks a trajectory in wind.

mod airframe;
mod controller;
mod instant;
mod parameters;
mod reference;
mod scenario;
mod sensors;
#[cfg(test)]
mod tests;

pub use airframe::{Airframe, Loads, QuadrotorState};
pub use controller::Tracking;
pub use parameters::{Odometry, QuadrotorFlight};
pub use reference::Reference;
pub use scenario::QuadrotorScenario;

//! A robot with two driven wheels and a caster in a walled arena: a differential drive of rigid bodies, whose wheels roll, slip and spin
//! as friction lets them.

mod arena;
mod avoidance;
mod defaults;
mod odometry;
mod parameters;
mod robot;
mod run;
#[cfg(test)]
mod run_tests;
mod scenario;
mod state;
#[cfg(test)]
mod tests;
mod topics;
mod world;

pub use arena::Arena;
pub use avoidance::{Avoidance, AvoidanceState};
pub use odometry::WheelOdometry;
pub use parameters::{Commands, Inputs, Wheeled};
pub use robot::{Caster, Chassis, Wheel, WheeledRobot};
pub use state::WheeledState;
pub use world::WheeledWorld;

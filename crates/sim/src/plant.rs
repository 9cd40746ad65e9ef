//! Plants in closed form beside the rigid bodies: their equations are known exactly.

pub mod aircraft;
pub mod atmosphere;
pub mod integrator;
pub mod quadrotor;
pub mod stage;
pub mod wind;

//! Climbs of a fleet of jets with known thrust, drag, lift and specific impulse.

mod autopilot;
mod dynamics;
mod fleet;
mod flight;
mod latent;
mod parameters;
mod recorder;
mod scenario;
#[cfg(test)]
mod tests;

pub use dynamics::Forces;
pub use fleet::{Airplane, Conditions};
pub use flight::Flight;
pub use latent::{Latent, Term, Terms};
pub use parameters::{AircraftClimb, Autopilot, Fleet, Flights, Spread, Turbulence};
pub use recorder::{Channel, Recorder};
pub use scenario::ClimbScenario;

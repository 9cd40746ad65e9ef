//! Excitation: signals that move a robot so that its log has information about it.
//!
//! Good data give small variances of the estimates: every direction of the regressors is excited, at the frequencies
//! and over the range of states that matter. The log-determinant of the regressors' Gram and [`nonuniformity`] compare
//! signals for a robot.
//!
//! One [`Excitation`] drives one channel, e.g. the forward velocity; channels take streams of random numbers of their own
//! and are independent.

mod check;
mod chirp;
mod histogram;
mod inverse_sampling;
mod multisine;
mod ornstein_uhlenbeck;
mod parameters;
mod pink;
mod prbs;
mod random_steps;
mod random_walk;
mod signal;
mod sine;
#[cfg(test)]
mod spectrum;

pub use chirp::{Chirp, Sweep};
pub use fleetfoot_dynamics::nonuniformity;
pub use histogram::{Axis, Histogram};
pub use inverse_sampling::InverseSampling;
pub use multisine::{Multisine, Phases};
pub use ornstein_uhlenbeck::{OrnsteinUhlenbeck, OrnsteinUhlenbeckNoise};
pub use parameters::Excitation;
pub use pink::Pink;
pub use prbs::Prbs;
pub use random_steps::RandomSteps;
pub use random_walk::RandomWalk;
pub use signal::Signal;
pub use sine::Sine;

/// A uniform number in `[low, high)`.
fn uniform(low: f64, high: f64, random: &mut rand_pcg::Pcg64) -> f64 {
    use rand::RngExt;
    low + (high - low) * random.random::<f64>()
}

//! Analytic plants that produce logs.
//!
//! Recordings with known truth: what a method finds can be held against what is true.

mod diff_drive;
mod noise;

pub use diff_drive::{DiffDrive, Mode};
pub use noise::OrnsteinUhlenbeck;

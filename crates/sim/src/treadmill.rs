//! A hexapod on a treadmill: the experiment of *Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot* (Buchan,
//! Haldane, Fearing), II-B and II-C.
//!
//! ```text
//! motion capture -> controller (equation 1, 100 Hz) -> robot (equation 2, PID on the cranks at 1 kHz) -> motors -> physics
//! ```

mod belt;
mod crank_control;
mod desk;
mod layout;
mod onboard;
mod parameters;
mod recorder;
mod simulation;
#[cfg(test)]
mod tests;

pub use belt::BeltParameters;
pub use crank_control::CrankControl;
pub use parameters::{DriveParameters, HexapodTreadmill, StartParameters, TreadmillExcitation};

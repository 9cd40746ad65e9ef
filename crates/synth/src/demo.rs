//! The demonstration: logs of a hexapod on a treadmill, with the analyses of Buchan, Haldane, Fearing, "Automatic
//! Identification of Dynamic Piecewise Affine Models for a Running Robot".

mod drive;
mod gait;
mod logs;
mod view;

pub use drive::differential_drive;
pub use gait::{Gait, PHASE_BINS, gaits, phase_of};
pub use logs::{DemoLogs, generate_logs};

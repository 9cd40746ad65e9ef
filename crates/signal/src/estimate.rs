//! Measurements from which a state is estimated.

/// Measurements from which a state is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Estimate {
    /// All measurements, earlier and later.
    #[default]
    Smoother,
    /// Measurements up to its instant: the state of an extended Kalman filter on the machine. Unlike that filter, this
    /// one knows noise and constants from all measurements, and gross errors are left out.
    Filter,
}

//! Measurements from which a state is estimated.

/// Measurements from which a state is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Estimate {
    /// All measurements, earlier and later.
    #[default]
    Smoother,
    /// Those up to its instant: what an extended Kalman filter on the machine would say that knows noise and constants, which all measurements tell, and was not deceived by what is left
    /// out as a gross error.
    Filter,
}

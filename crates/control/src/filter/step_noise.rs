//! The noise of a step.

use faer::Mat;

/// The noise of a step in a region.
pub(super) struct StepNoise {
    /// The covariance of what is white, of a continuous model its spectral density: n x n.
    pub(super) white: Mat<f64>,
    /// What hangs on the rows before, by whitened residuals; of a continuous model as it goes into the derivatives: n x q, without columns where all is white.
    pub(super) shape: Mat<f64>,
}

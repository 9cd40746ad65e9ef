//! The noise of a step.

use faer::Mat;

/// The noise of a step in a region.
pub(super) struct StepNoise {
    /// The covariance of the white part, of a continuous model its spectral density: n x n.
    pub(super) white: Mat<f64>,
    /// Effect of the correlated residuals, whitened, on the states; of a continuous model on the derivatives. n x q,
    /// without columns if all noise is white.
    pub(super) shape: Mat<f64>,
}

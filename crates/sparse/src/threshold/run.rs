//! One run of a method at one threshold.

use super::Step;

/// A model, and what its comparisons saw, in the units of the threshold: nothing would change for any threshold above `most` and up to `least`.
pub(super) struct Run {
    pub(super) step: Step,
    /// The smallest coefficient that was kept.
    pub(super) least: f64,
    /// The largest coefficient that was dropped; infinite where it does not settle the model.
    pub(super) most: f64,
}

//! A partition to choose from.

use fleetfoot_model::Partition;
use fleetfoot_pwa::Specification;

/// A partition to choose from.
pub(crate) struct Choice {
    pub(crate) specification: Specification,
    /// `None`: one region.
    pub partition: Option<Partition>,
    pub(crate) seed: u64,
}

impl Choice {
    /// One region.
    pub(crate) fn whole(seed: u64) -> Self {
        Self { specification: Specification::Average, partition: None, seed }
    }
}

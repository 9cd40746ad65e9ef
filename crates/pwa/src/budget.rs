//! Bytes of stored statistics.

use crate::Specification;

/// Bytes that all stored statistics may take.
pub(crate) const STATS_BUDGET: usize = 192 << 20;

pub(crate) fn gram_bytes(width: usize) -> usize {
    8 * (width + 4) * (width + 4) / 2
}

pub(crate) fn expected_regions(specification: &Specification) -> usize {
    match specification {
        Specification::Null | Specification::Average => 0,
        Specification::ZScore(_) | Specification::ZBox(_) => 2,
        Specification::KMeans(k) | Specification::Refined(k) => *k,
        Specification::Tree(depth) => 1 << depth,
        // The sums of cells are bounded by themselves.
        Specification::Lattice(_) => 0,
        Specification::Labels { .. } => 10 * specification.clusters().unwrap_or(1),
    }
}

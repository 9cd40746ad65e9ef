//! Notes for the user about the making of a partition's regions.

use std::fmt;

use fleetfoot_data::setting::{ITERATIONS, MEMORY};

/// Note for the user about the making of a partition's regions; its text is a sentence.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PartitionNote {
    /// The partition, after the label where it is that of one: `kmeans:4`, `terrain grass: kmeans:4`.
    pub place: String,
    /// Content of the note.
    pub finding: Finding,
}

/// Observation about a partition.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Finding {
    /// k-means ended before its centroids came to rest.
    NotConverged {
        /// Iterations that were made.
        iterations: usize,
    },
    /// There are fewer different rows than clusters.
    FewPositions {
        /// Different rows.
        positions: usize,
    },
    /// Rows are enough for fewer maps than regions.
    FewRegions {
        /// Regions with rows enough.
        regions: usize,
    },
    /// Rows are enough for fewer cells than regions.
    FewCells {
        /// Cells.
        cells: usize,
    },
    /// Sums of more cells would take more memory than they may.
    CellsLackMemory {
        /// Cells.
        cells: usize,
        /// The memory, MiB.
        memory: usize,
    },
    /// Regions are those of a sample of the rows.
    Sampled {
        /// Use of the sample: `clustered`, `refined`, `grown on`.
        method: SampleMethod,
        /// Rows of the sample.
        kept: u64,
        /// Rows.
        all: u64,
    },
}

/// Use of a sample of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleMethod {
    /// k-means.
    Clustered,
    /// Refined regions.
    Refined,
    /// A tree.
    Grown,
}

impl PartitionNote {
    /// Of a partition.
    pub(crate) fn new(place: impl fmt::Display, finding: Finding) -> Self {
        Self { place: place.to_string(), finding }
    }

    /// The same, of a label.
    pub(crate) fn within(self, label: &str) -> Self {
        Self { place: format!("{label}: {}", self.place), ..self }
    }

    /// Returns true if an iteration ended before it converged.
    pub fn is_unconverged(&self) -> bool {
        matches!(self.finding, Finding::NotConverged { .. })
    }

    /// Returns true if the rows were enough for fewer regions than the partition names.
    pub fn is_of_few_rows(&self) -> bool {
        matches!(self.finding, Finding::FewPositions { .. } | Finding::FewRegions { .. } | Finding::FewCells { .. })
    }
}

impl fmt::Display for PartitionNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.place)?;
        match self.finding {
            Finding::NotConverged { iterations } => {
                write!(f, "not converged after {iterations} iterations; raise {ITERATIONS}")
            }
            Finding::FewPositions { positions } => {
                let word = if positions == 1 { "position" } else { "positions" };
                write!(f, "only {positions} different {word} to cluster")
            }
            Finding::FewRegions { regions } => {
                let word = if regions == 1 { "region has" } else { "regions have" };
                write!(f, "only {regions} {word} enough rows for a separate map")
            }
            Finding::FewCells { cells } => {
                write!(f, "there are enough rows for {cells} cells, so there are at most that many regions")
            }
            Finding::CellsLackMemory { cells, memory } => write!(
                f,
                "regions are joined from {cells} cells: more cells would take over {memory} MiB; use fewer folds or columns for more cells"
            ),
            Finding::Sampled { method, kept, all } => {
                let done = match method {
                    SampleMethod::Clustered => "clustered",
                    SampleMethod::Refined => "refined on",
                    SampleMethod::Grown => "grown on",
                };
                write!(f, "{done} a sample of {kept} of {all} rows; raise {MEMORY} for more")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_sentences_with_their_place() {
        let note = PartitionNote::new("kmeans:4", Finding::NotConverged { iterations: 1 }).within("floor wet");
        assert!(note.is_unconverged());
        assert_eq!(note.to_string(), "floor wet: kmeans:4: not converged after 1 iterations; raise --iterations");
        let sampled = Finding::Sampled { method: SampleMethod::Refined, kept: 10, all: 20 };
        let note = PartitionNote::new("refined:2", sampled);
        assert!(!note.is_unconverged());
        assert_eq!(note.to_string(), "refined:2: refined on a sample of 10 of 20 rows; raise --memory for more");
    }
}

//! Unit of resampling of a statistic: episodes or chunks.

use super::BolassoError;
use crate::SparseError;

/// Unit of resampling of a block bootstrap. Rows of a log are correlated, so a unit should be longer than the
/// correlation time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BootstrapUnit {
    /// Chunks, short ones joined: non-overlapping blocks of consecutive rows (Kuensch 1989 with a fixed grid).
    Chunk,
    /// Whole episodes.
    #[default]
    Episode,
}

/// Nothing to resample is an error of its own.
pub(crate) fn enough(units: usize, unit: BootstrapUnit, needed: usize) -> Result<(), BolassoError> {
    let name = match unit {
        BootstrapUnit::Chunk => "chunk",
        BootstrapUnit::Episode => "episode",
    };
    match units {
        0 => Err(SparseError::NoRows.into()),
        units if units < needed => Err(BolassoError::TooFewUnits { units, unit: name, needed }),
        _ => Ok(()),
    }
}

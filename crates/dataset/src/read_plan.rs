//! Reading plan of the passes over logs.

use fleetfoot_log::Estimate;
use serde::{Serialize, Serializer};

use crate::{dataset::Dataset, logs::Logs};

/// Files, rows and columns that passes over logs would read, computed before they begin.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct ReadPlan {
    /// Files.
    pub files: usize,
    /// Episodes; robots' logs are not decoded to count them.
    pub episodes: Option<usize>,
    /// Rows; of robots' logs at most, from the counts in the files.
    pub rows: usize,
    /// Bytes of decoded columns, where logs must be decoded, and whether the cache has them already.
    #[serde(flatten, serialize_with = "decoded")]
    pub decoded: Option<(u64, bool)>,
    /// Columns that are read.
    pub columns: Vec<String>,
}

impl ReadPlan {
    /// Of tables, which are open.
    pub fn of_tables(logs: &Logs, dataset: &Dataset) -> Self {
        Self {
            files: logs.len(),
            episodes: Some(dataset.episodes().len()),
            rows: dataset.rows(),
            decoded: None,
            columns: dataset.columns(),
        }
    }

    /// Of robots' logs, whose messages are counted and not decoded.
    pub fn of_messages(logs: &Logs, columns: Vec<String>, cost: &Estimate) -> Self {
        Self {
            files: logs.len(),
            episodes: None,
            rows: usize::try_from(cost.rows).unwrap_or(usize::MAX),
            decoded: Some((cost.decoded_bytes, cost.cached)),
            columns,
        }
    }
}

/// The decoded columns of robots' logs: their bytes, and whether the cache has them already.
fn decoded<S: Serializer>(decoded: &Option<(u64, bool)>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Decoded {
        decoded_bytes: Option<u64>,
        cached: Option<bool>,
    }
    let decoded = Decoded { decoded_bytes: decoded.map(|(bytes, _)| bytes), cached: decoded.map(|(_, cached)| cached) };
    decoded.serialize(serializer)
}

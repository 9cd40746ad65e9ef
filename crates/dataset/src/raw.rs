//! The raw log behind a prepared one: its path, which `prepare` writes, and its measurements at the rows of the
//! prepared log.

mod measured;
mod opened;
mod path;
mod series;

use std::{
    collections::{BTreeMap, HashMap},
    path::{Path, PathBuf},
};

use fleetfoot_data::Progress;
pub use measured::Measured;
use serde::{Deserialize, Serialize};

use crate::{content::hash_path, dataset::Dataset, error::Error};

/// The key of a prepared file's metadata: the [`RawLog`] that it was made of, as JSON.
pub const RAW: &str = "fleetfoot.raw";

/// The key of a prepared file's metadata: the recipe that it was prepared by.
pub const PREPARED_BY: &str = "fleetfoot.prepared";

/// The raw log of an episode, as a prepared file names it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RawLog {
    /// The files that are read together: one, or those of a run (`[files]`) or of a recording that was split.
    pub files: Vec<RawFile>,
    /// The place of the episode among those of its log; none where all of them were read together.
    pub episode: Option<usize>,
    /// The stamp from which the seconds below count, nanoseconds.
    pub start: i64,
    /// Offset to add to the prepared stamps for the times at which the log was recorded, nanoseconds.
    pub clock_offset: i64,
    /// Seconds by which the stamps of a channel are later than its measurements.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub late: BTreeMap<String, f64>,
    /// The topic of a channel, where the rows are those of another one.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub topics: BTreeMap<String, String>,
    /// The values of a channel that were rejected: from which second to which.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub left_out: BTreeMap<String, Vec<[f64; 2]>>,
}

/// A file of a raw log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RawFile {
    /// Its path from the folder of the prepared file.
    pub path: String,
    /// The hash of its content.
    pub hash: String,
}

/// The raw logs of a preparation; every file is hashed once.
pub struct RawLogs<'a> {
    folder: &'a Path,
    hashes: HashMap<PathBuf, String>,
}

impl<'a> RawLogs<'a> {
    /// Those of what is written into a folder.
    pub fn new(folder: &'a Path) -> Self {
        Self { folder, hashes: HashMap::new() }
    }

    /// The raw log of an episode; none of a table in memory.
    ///
    /// # Errors
    /// Those of reading.
    pub fn of(&mut self, dataset: &Dataset, episode: usize, progress: &dyn Progress) -> Result<Option<RawLog>, Error> {
        let mut files = Vec::new();
        for file in dataset.files_of(episode) {
            let hash = match self.hashes.get(file) {
                Some(hash) => hash.clone(),
                None => {
                    let hash = hash_path(file, progress)?.0.to_string();
                    self.hashes.entry(file.clone()).or_insert(hash).clone()
                }
            };
            files.push(RawFile { path: path::relative(file, self.folder), hash });
        }
        let same = |other: &usize| dataset.origin(*other) == dataset.origin(episode);
        Ok((!files.is_empty()).then(|| RawLog {
            files,
            episode: Some((0..episode).filter(same).count()),
            start: dataset.episodes()[episode].start,
            clock_offset: dataset.log_offset(episode),
            ..RawLog::default()
        }))
    }
}

impl RawLog {
    /// The entry of a prepared file's metadata.
    pub fn entry(&self) -> (String, String) {
        (RAW.to_owned(), serde_json::json!(self).to_string())
    }
}

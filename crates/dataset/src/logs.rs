//! Logs to read: files, tables in memory, or both; or their statistic.

use fleetfoot_data::setting::STATS_MERGE;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot_data::Progress;
use fleetfoot_log::{FileInfo, Log, MemoryTable, Recording, RunFiles, Selection};
use fleetfoot_recipe::Recipe;

use crate::{error::Error, hold_out::Part, kept::Kept, stats_file::StatisticFile};

/// Logs in reading order: files by their paths, then tables in memory. Or the statistic of logs in their place.
///
/// Anything that is a list of paths becomes one.
#[derive(Debug, Clone, Default)]
pub struct Logs {
    logs: Vec<Log>,
    statistic: Option<Arc<StatisticFile>>,
    part: Part,
    /// Rows that were opened already, for callers that open the same logs many times.
    kept: Option<Arc<Kept>>,
}

impl Logs {
    /// Tables in memory.
    pub fn tables(tables: impl IntoIterator<Item = Arc<dyn MemoryTable>>) -> Self {
        tables.into_iter().map(Log::Table).collect::<Vec<_>>().into()
    }

    /// A statistic, in place of logs, for the fits that need no rows.
    pub fn of_statistic(statistic: Arc<StatisticFile>) -> Self {
        Self { statistic: Some(statistic), ..Self::default() }
    }

    /// The same logs, of which only the training rows or only the test rows are read ([`Part`]).
    pub fn only(&self, part: Part) -> Self {
        Self { part, ..self.clone() }
    }

    /// The same logs, opened once: all copies of them share the rows that one of them opened, as long as they live.
    #[must_use]
    pub fn kept(&self) -> Self {
        Self { kept: Some(Arc::default()), ..self.clone() }
    }

    /// All rows of the logs, as a selection reads them.
    ///
    /// # Errors
    /// Those of opening.
    pub(crate) fn recording(
        &self,
        selection: &Selection,
        progress: &dyn Progress,
    ) -> Result<Recording, fleetfoot_log::Error> {
        match &self.kept {
            Some(kept) => kept.recording(&self.logs, selection, progress),
            None => fleetfoot_log::open_logs(&self.logs, selection, progress),
        }
    }

    /// Description of one of the files: columns, topics and clock.
    ///
    /// # Errors
    /// Those of reading.
    pub(crate) fn info(&self, file: &Path) -> Result<FileInfo, Error> {
        match &self.kept {
            Some(kept) => kept.info(file),
            None => Ok(fleetfoot_log::inspect(file)?),
        }
    }

    /// Part of the rows that is read.
    pub fn part(&self) -> Part {
        self.part
    }

    /// All files and tables.
    pub fn all(&self) -> &[Log] {
        &self.logs
    }

    /// Number of logs.
    pub fn len(&self) -> usize {
        self.logs.len()
    }

    /// Returns true if there is no log to read.
    pub fn is_empty(&self) -> bool {
        self.logs.is_empty()
    }

    /// Paths of the files among them.
    pub fn files(&self) -> Vec<PathBuf> {
        let of_log = |log: &Log| match log {
            Log::File(path) => vec![path.clone()],
            Log::Run(run) => run.files.iter().map(|(_, path)| path.clone()).collect(),
            Log::Table(_) => Vec::new(),
        };
        self.logs.iter().flat_map(of_log).collect()
    }

    /// The same logs as a recipe reads them: with its `[files]`, the files of a folder are one run. The files beside them that no pattern matches come second.
    ///
    /// # Errors
    /// Those of [`RunFiles::group`].
    pub fn by(&self, recipe: &Recipe) -> Result<(Self, Vec<PathBuf>), Error> {
        if recipe.files.is_empty() {
            return Ok((self.clone(), Vec::new()));
        }
        let patterns: Vec<(String, String)> =
            recipe.files.iter().map(|(topic, pattern)| (topic.clone(), pattern.clone())).collect();
        let files: Vec<PathBuf> = self
            .logs
            .iter()
            .filter_map(|log| if let Log::File(path) = log { Some(path.clone()) } else { None })
            .collect();
        let (runs, others) = RunFiles::group(&files, &patterns)?;
        let rest = self.logs.iter().filter(|log| !matches!(log, Log::File(_))).cloned();
        Ok((
            Self {
                logs: runs.into_iter().map(Log::Run).chain(rest).collect(),
                statistic: self.statistic.clone(),
                part: self.part,
                kept: self.kept.clone(),
            },
            others,
        ))
    }

    /// Returns true if this is the statistic of logs instead of logs.
    pub fn is_statistic(&self) -> bool {
        self.statistic.is_some() || is_statistic(&self.files())
    }

    /// The statistic that these are.
    ///
    /// # Errors
    /// Several of them; those of reading.
    pub fn statistic(&self) -> Result<StatisticFile, Error> {
        match (&self.statistic, self.logs.as_slice()) {
            (Some(statistic), []) => Ok(statistic.as_ref().clone()),
            (None, [Log::File(path)]) => StatisticFile::read(path),
            _ => Err(Error::conflict(format!(
                "several files, a `.stats` among them: fit on one statistic ({STATS_MERGE} makes one of several) or on logs"
            ))),
        }
    }
}

impl From<Vec<Log>> for Logs {
    fn from(logs: Vec<Log>) -> Self {
        Self { logs, ..Self::default() }
    }
}

impl From<&Logs> for Logs {
    fn from(logs: &Logs) -> Self {
        logs.clone()
    }
}

impl<P: AsRef<Path>> From<&[P]> for Logs {
    fn from(files: &[P]) -> Self {
        files.iter().map(|file| Log::File(file.as_ref().to_path_buf())).collect::<Vec<_>>().into()
    }
}

impl<P: AsRef<Path>> From<&Vec<P>> for Logs {
    fn from(files: &Vec<P>) -> Self {
        files.as_slice().into()
    }
}

impl<P: AsRef<Path>, const N: usize> From<&[P; N]> for Logs {
    fn from(files: &[P; N]) -> Self {
        files.as_slice().into()
    }
}

/// Returns true if the files are the statistic of logs instead of logs.
pub fn is_statistic(files: &[PathBuf]) -> bool {
    files.iter().any(|file| file.extension().is_some_and(|extension| extension == "stats"))
}

/// The end of the names of the files that `prepare` writes.
pub const PREPARED: &str = ".clean.parquet";

/// The key of a prepared file's metadata: the standard deviation of a measurement about the curve, by column, as JSON.
pub const NOISE: &str = "fleetfoot.noise";

/// Returns true if a file's name is one that `prepare` writes.
pub fn is_prepared(name: &str) -> bool {
    name.ends_with(PREPARED)
}

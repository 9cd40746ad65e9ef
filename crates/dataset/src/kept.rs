//! Logs that are opened once: whoever opens them again in the same way gets the same rows.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use fleetfoot_data::Progress;
use fleetfoot_log::{FileInfo, Log, Recording, Selection};

use crate::error::Error;

/// Recordings kept at most: beyond it the one that was longest not used goes, so that memory and disk stay bounded.
const MOST: usize = 4;

/// Recordings by how they were opened, and what their files hold.
#[derive(Debug, Default)]
pub(crate) struct Kept {
    recordings: Mutex<Vec<(Selection, Recording)>>,
    infos: Mutex<Vec<(PathBuf, FileInfo)>>,
}

impl Kept {
    /// The recording of logs, which are the same in every call.
    ///
    /// # Errors
    /// Those of opening.
    pub(crate) fn recording(
        &self,
        logs: &[Log],
        selection: &Selection,
        progress: &dyn Progress,
    ) -> Result<Recording, fleetfoot_log::Error> {
        let mut known = self.recordings.lock().unwrap_or_else(PoisonError::into_inner);
        let recording = match known.iter().position(|(kept, _)| kept == selection) {
            Some(at) => known.remove(at).1,
            None => fleetfoot_log::open_logs(logs, selection, progress)?,
        };
        known.push((selection.clone(), recording.clone()));
        let old = known.len().saturating_sub(MOST);
        known.drain(..old);
        Ok(recording)
    }

    /// Description of a file: columns, topics and clock.
    ///
    /// # Errors
    /// Those of reading.
    pub(crate) fn info(&self, file: &Path) -> Result<FileInfo, Error> {
        let mut known = self.infos.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, info)) = known.iter().find(|(kept, _)| kept == file) {
            return Ok(info.clone());
        }
        let info = fleetfoot_log::inspect(file)?;
        known.push((file.to_owned(), info.clone()));
        Ok(info)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use fleetfoot_data::Silent;
    use fleetfoot_recipe::Recipe;

    use crate::{Dataset, Logs, Part};

    /// The file is gone when the same rows are opened again, and other columns of it are not there.
    #[test]
    fn kept_logs_are_read_once() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        let rows: String = (0..50).map(|row| format!("{},{row},{}\n", 0.1 * f64::from(row), 2 * row)).collect();
        fs::write(&file, format!("t,x,y\n{rows}")).unwrap();
        let recipe = Recipe::parse("[states]\nx = {}\n", "test").unwrap();
        let logs = Logs::from(std::slice::from_ref(&file)).kept();
        let rows = |recipe: &Recipe, part| {
            Dataset::for_columns(recipe, None, logs.only(part), &Silent).map(|dataset| dataset.rows())
        };
        assert_eq!(rows(&recipe, Part::Training).unwrap(), 40);
        fs::remove_file(file).unwrap();
        assert_eq!(rows(&recipe, Part::Test).unwrap(), 10);
        assert_eq!(rows(&recipe, Part::All).unwrap(), 50);
        assert!(rows(&Recipe::parse("[states]\ny = {}\n", "test").unwrap(), Part::All).is_err());
    }
}

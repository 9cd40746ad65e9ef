//! One writer at a time, if the outputs of two would mix.

use std::{
    fs::{self, File, TryLockError},
    path::{Path, PathBuf},
};

use crate::{destination::is_at, error::Error};

/// The sole right to write something, until it is dropped. The system takes it back from a process that is killed.
#[derive(Debug)]
pub struct WriteLock {
    path: PathBuf,
    _file: File,
    exclusive: bool,
}

impl WriteLock {
    /// Takes the right to write `what`, a file or a folder; `path` is the hidden lock file.
    ///
    /// On a file system without locks it is granted to everybody.
    ///
    /// # Errors
    /// Another process has it; the hidden file cannot be made.
    pub fn take(path: impl Into<PathBuf>, what: &Path) -> Result<Self, Error> {
        let path = path.into();
        let error = |source| Error::Io { path: what.into(), action: "write", source };
        loop {
            let file = File::options().create(true).truncate(false).write(true).open(&path).map_err(error)?;
            let locked = file.try_lock();
            if let Err(TryLockError::WouldBlock) = locked {
                return Err(Error::Busy { path: what.into() });
            }
            // Whoever had it before may have removed the very file that was opened.
            if is_at(&file, &path) {
                return Ok(Self { path, _file: file, exclusive: locked.is_ok() });
            }
        }
    }

    /// Returns true if the lock excludes others: the file system has locks.
    pub fn is_exclusive(&self) -> bool {
        self.exclusive
    }

    /// The hidden file that stands for the output `file` in its folder.
    pub fn beside(file: &Path) -> PathBuf {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        file.with_file_name(format!(".{name}.lock"))
    }
}

impl Drop for WriteLock {
    fn drop(&mut self) {
        // Still locked: nobody else takes it between here and its end. A file that stays harms nobody.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_one_writer_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("run.stats");
        let path = WriteLock::beside(&output);
        for _ in 0..2 {
            let held = WriteLock::take(&path, &output).unwrap();
            let message = WriteLock::take(&path, &output).unwrap_err().to_string();
            assert!(message.contains("run.stats") && message.contains("another command"), "{message}");
            drop(held);
            assert!(!path.exists());
        }
        // The lock file of a killed process is no lock.
        fs::write(&path, "").unwrap();
        WriteLock::take(&path, &output).unwrap();
    }
}

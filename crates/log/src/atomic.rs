//! Files that appear whole or not at all.

use std::{
    fs::File,
    io::{self, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use tempfile::NamedTempFile;

use crate::Error;

/// A file under construction: written beside its target, renamed onto it by [`AtomicFile::commit`], removed when dropped before.
#[derive(Debug)]
pub struct AtomicFile {
    temporary: NamedTempFile,
    target: PathBuf,
}

impl AtomicFile {
    /// Begins a file that will be `target`. Missing parent folders are an error.
    pub fn create(target: impl Into<PathBuf>) -> Result<Self, Error> {
        let target = target.into();
        let error = |source| Error::Io { path: target.clone(), action: "write", source };
        if target.is_dir() {
            return Err(error(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder; name a file in it")));
        }
        let folder = match target.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".").suffix(".partial");
        #[cfg(unix)]
        {
            // The permissions that a plain `create` would give; the process's mask takes the rest away.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let temporary = builder.tempfile_in(folder).map_err(error)?;
        Ok(Self { temporary, target })
    }

    /// Where the file will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes everything to the disk and gives the file its name, replacing an older one.
    pub fn commit(self) -> Result<(), Error> {
        let Self { temporary, target } = self;
        let error = |source| Error::Io { path: target.clone(), action: "write", source };
        temporary.as_file().sync_all().map_err(error)?;
        temporary.persist(&target).map_err(|failure| error(failure.error))?;
        // The rename itself lives in the folder. Not every system can sync a folder, and the data is safe without.
        #[cfg(unix)]
        if let Some(folder) = target.parent() {
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            let _ = File::open(folder).and_then(|folder| folder.sync_all());
        }
        Ok(())
    }

    /// The open file.
    pub fn file(&mut self) -> &mut File {
        self.temporary.as_file_mut()
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temporary.as_file_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temporary.as_file_mut().flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.temporary.as_file_mut().seek(position)
    }
}

/// Writes a file whole or not at all: temporary file beside it, sync, rename.
pub fn write_atomic(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), Error> {
    let path = path.as_ref();
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(|source| Error::Io { path: path.into(), action: "write", source })?;
    file.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_only_when_committed_and_nothing_is_left_behind() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out.json");
        let mut file = AtomicFile::create(&target).unwrap();
        file.write_all(b"half").unwrap();
        assert!(!target.exists());
        drop(file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        write_atomic(&target, b"one").unwrap();
        write_atomic(&target, b"two").unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"two");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_or_a_missing_parent_is_an_error_with_the_name() {
        let folder = tempfile::tempdir().unwrap();
        let message = write_atomic(folder.path(), b"x").unwrap_err().to_string();
        assert!(message.contains("folder"), "{message}");
        let message = write_atomic(folder.path().join("no/such.json"), b"x").unwrap_err().to_string();
        assert!(message.contains("such.json"), "{message}");
    }
}

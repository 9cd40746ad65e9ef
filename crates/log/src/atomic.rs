//! Files that appear whole or not at all.

use std::{
    fs::File,
    io::{self, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use tempfile::NamedTempFile;

use crate::{
    Error,
    destination::{Destination, RANDOM, folder},
};

/// Names that are longer leave no room for what is put around them.
const LONGEST_NAME: usize = 200;

/// A file under construction: written beside its target, renamed onto it by [`AtomicFile::commit`], removed when dropped before.
///
/// A symbolic link is followed and stays. A device, a pipe or a socket gets all bytes at the end, and stays what it is.
#[derive(Debug)]
pub struct AtomicFile {
    work: Work,
    target: PathBuf,
}

#[derive(Debug)]
enum Work {
    /// Beside a regular file.
    Beside(NamedTempFile, PathBuf),
    /// For something that is no file: in an unnamed temporary file, as formats are written with seeks.
    Through(File),
}

impl AtomicFile {
    /// Begins a file that will be `target`. Missing parent folders are an error.
    pub fn create(target: impl Into<PathBuf>) -> Result<Self, Error> {
        let target = target.into();
        let error = |source| Error::Io { path: target.clone(), action: "write", source };
        let work = match Destination::of(&target).map_err(error)? {
            Destination::File(real) => Work::Beside(beside(&real).map_err(error)?, real),
            Destination::Stream(_) => Work::Through(tempfile::tempfile().map_err(error)?),
        };
        Ok(Self { work, target })
    }

    /// Where the file will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes everything to the disk and gives the file its name, replacing an older one.
    pub fn commit(self) -> Result<(), Error> {
        let Self { work, target } = self;
        let done = match work {
            Work::Beside(temporary, real) => rename(temporary, &real),
            Work::Through(temporary) => hand_over(temporary, &target),
        };
        done.map_err(|source| Error::Io { path: target, action: "write", source })
    }

    /// The open file.
    pub fn file(&mut self) -> &mut File {
        match &mut self.work {
            Work::Beside(temporary, _) => temporary.as_file_mut(),
            Work::Through(temporary) => temporary,
        }
    }
}

/// An unfinished file beside a target, locked while somebody writes it: what a killed process leaves is known by its name and free.
fn beside(target: &Path) -> io::Result<NamedTempFile> {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    let prefix = if name.len() > LONGEST_NAME { ".".to_owned() } else { format!(".{name}.") };
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".partial").rand_bytes(RANDOM);
    #[cfg(unix)]
    {
        // The permissions that a plain `create` would give; the process's mask takes the rest away.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let temporary = builder.tempfile_in(folder(target))?;
    // Not every file system has locks; without one a leftover cannot be told from work.
    let _ = temporary.as_file().try_lock();
    Ok(temporary)
}

fn rename(temporary: NamedTempFile, target: &Path) -> io::Result<()> {
    temporary.as_file().sync_all()?;
    temporary.persist(target).map_err(|failure| failure.error)?;
    // The rename itself lives in the folder. Not every system can sync a folder, and the data is safe without.
    #[cfg(unix)]
    let _ = File::open(folder(target)).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Writes what is in a temporary file through to a device, a pipe or a socket.
fn hand_over(mut temporary: File, target: &Path) -> io::Result<()> {
    temporary.seek(SeekFrom::Start(0))?;
    // Neither created nor cut: a redirected standard output may be a file, with something in it.
    let mut stream = File::options().append(true).open(target)?;
    match io::copy(&mut temporary, &mut stream).and_then(|_| stream.flush()) {
        // A reader that closes its end early (`| head`) wants no more.
        Err(problem) if problem.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        done => done,
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file().flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file().seek(position)
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

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_a_pipe_stays_a_pipe() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real.json"), folder.path().join("link.json"));
        std::os::unix::fs::symlink("real.json", &link).unwrap();
        for text in [b"one", b"two"] {
            write_atomic(&link, text).unwrap();
            assert!(link.symlink_metadata().unwrap().is_symlink());
            assert_eq!(std::fs::read(&real).unwrap(), text);
        }
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let from = pipe.clone();
        let reader = std::thread::spawn(move || std::fs::read(from).unwrap());
        write_atomic(&pipe, b"all of it").unwrap();
        assert_eq!(reader.join().unwrap(), b"all of it");
        assert!(std::fs::symlink_metadata(&pipe).unwrap().file_type().is_fifo());
    }
}

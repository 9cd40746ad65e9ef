//! Files that appear whole or not at all.

use std::{
    cell::RefCell,
    fs::File,
    io::{self, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
};

use tempfile::NamedTempFile;

use crate::{
    destination::{Destination, folder, is_at},
    error::Error,
    leftovers::{self, RANDOM, SUFFIX},
};

thread_local! {
    /// Complete files of this thread's [`together`], which have no names yet.
    static TOGETHER: RefCell<Option<Vec<AtomicFile>>> = const { RefCell::new(None) };
}

/// Files of this process that have got their names.
static WRITTEN: AtomicUsize = AtomicUsize::new(0);

/// Number of files that this process has completed and named; a stopped process can report it.
pub fn written_files() -> usize {
    WRITTEN.load(Ordering::Relaxed)
}

/// A file under construction: written beside its target, renamed onto it by [`AtomicFile::commit`], removed when dropped before.
///
/// A symbolic link is followed and stays. A device, a pipe or a socket gets all bytes at the end, and is not replaced.
///
/// Remains of killed processes are removed when the next file begins.
#[derive(Debug)]
pub struct AtomicFile {
    work: Work,
    target: PathBuf,
}

#[derive(Debug)]
enum Work {
    /// Beside a regular file.
    Beside(NamedTempFile, PathBuf),
    /// For a target that is no file: in an unnamed temporary file, as formats are written with seeks.
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

    /// Path of the final file.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes everything to the disk and gives the file its name, replacing an older one; within [`together`], with the others at its end.
    pub fn commit(self) -> Result<(), Error> {
        if let Work::Beside(temporary, _) = &self.work {
            let done = temporary.as_file().sync_all();
            done.map_err(|source| Error::Io { path: self.target.clone(), action: "write", source })?;
        }
        let alone = TOGETHER.with_borrow_mut(|files| match files {
            Some(files) => {
                files.push(self);
                None
            }
            None => Some(self),
        });
        alone.map_or(Ok(()), |file| file.place().map(drop))
    }

    /// Gives a complete file its name; returns the path if no file had that name before.
    fn place(self) -> Result<Option<PathBuf>, Error> {
        let Self { work, target } = self;
        let done = match work {
            Work::Beside(temporary, real) => {
                let made = (!real.exists()).then(|| real.clone());
                rename(temporary, &real).map(|()| made)
            }
            Work::Through(temporary) => hand_over(temporary, &target).map(|()| None),
        };
        let made = done.map_err(|source| Error::Io { path: target, action: "write", source })?;
        WRITTEN.fetch_add(1, Ordering::Relaxed);
        Ok(made)
    }

    /// The open file.
    pub fn file(&mut self) -> &mut File {
        match &mut self.work {
            Work::Beside(temporary, _) => temporary.as_file_mut(),
            Work::Through(temporary) => temporary,
        }
    }
}

/// Files that `work` commits on this thread get their names together once it is done; none of them does where it fails or is stopped.
///
/// The names are given one after another. If one cannot be given, the new files before it are removed again. A file
/// that replaced an older one stays, since the older one is gone. A process that is killed while names are given leaves
/// some of the files.
///
/// # Errors
/// Those of `work`, and of giving the files their names.
pub fn together<R, E: From<Error>>(work: impl FnOnce() -> Result<R, E>) -> Result<R, E> {
    /// Forgets the files of a work that did not come to its end.
    struct Abandoned;
    impl Drop for Abandoned {
        fn drop(&mut self) {
            TOGETHER.set(None);
        }
    }
    if TOGETHER.with_borrow(Option::is_some) {
        return work();
    }
    TOGETHER.set(Some(Vec::new()));
    let abandoned = Abandoned;
    let result = work()?;
    let files = TOGETHER.take().unwrap_or_default();
    drop(abandoned);
    let mut made = Vec::new();
    for file in files {
        match file.place() {
            Ok(path) => made.extend(path),
            Err(error) => {
                // Files that cannot be removed either stay, and the error names them.
                let removed = made.iter().filter(|path| std::fs::remove_file(path).is_ok()).count();
                WRITTEN.fetch_sub(removed, Ordering::Relaxed);
                return Err(error.into());
            }
        }
    }
    Ok(result)
}

/// Unfinished files begun for one target at most.
const ATTEMPTS: usize = 100;

/// An unfinished file beside a target, locked by its writer: the remains of a killed process have such a name and no
/// lock.
fn beside(target: &Path) -> io::Result<NamedTempFile> {
    leftovers::remove_once(target);
    let mut builder = tempfile::Builder::new();
    let prefix = leftovers::prefix(target);
    builder.prefix(&prefix).suffix(SUFFIX).rand_bytes(RANDOM);
    #[cfg(unix)]
    {
        // The permissions that a plain `create` would give; the process's mask takes the rest away.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    for _ in 0..ATTEMPTS {
        let temporary = builder.tempfile_in(folder(target))?;
        // Not every file system has locks; without one a leftover cannot be told from work.
        let _ = temporary.as_file().try_lock();
        // Another command may have taken it for a leftover before it was locked.
        if is_at(temporary.as_file(), temporary.path()) {
            return Ok(temporary);
        }
    }
    Err(io::Error::other(format!(
        "{ATTEMPTS} unfinished files beside it disappeared at once: look for a program that removes them"
    )))
}

fn rename(temporary: NamedTempFile, target: &Path) -> io::Result<()> {
    temporary.persist(target).map_err(|failure| failure.error)?;
    // The rename itself lives in the folder. Not every system can sync a folder, and the data is safe without.
    #[cfg(unix)]
    let _ = File::open(folder(target)).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Writes the content of a temporary file to a device, a pipe or a socket.
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
    fn file_appears_only_when_committed() {
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
        // Other tests of this process write too.
        assert!(written_files() >= 2);
    }

    #[test]
    fn a_set_of_files_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let names = || {
            let mut names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
            names.sort();
            names
        };
        write_atomic(at("a"), b"old").unwrap();
        let failed = together(|| {
            write_atomic(at("a"), b"new")?;
            together(|| write_atomic(at("b"), b"new"))?;
            write_atomic(at("no/such"), b"new")
        });
        assert!(failed.is_err());
        let stopped = std::panic::catch_unwind(|| {
            together(|| {
                write_atomic(at("b"), b"new").unwrap();
                std::panic::resume_unwind(Box::new(()));
                #[allow(unreachable_code)]
                Ok::<(), Error>(())
            })
        });
        assert!(stopped.is_err());
        assert_eq!((names(), std::fs::read(at("a")).unwrap()), (vec!["a".into()], b"old".to_vec()));
        // A name that is taken by a folder in the meantime.
        let taken = together(|| {
            write_atomic(at("b"), b"new")?;
            write_atomic(at("c"), b"new")?;
            std::fs::create_dir(at("c")).unwrap();
            Ok::<(), Error>(())
        });
        assert!(taken.is_err());
        assert_eq!(names(), ["a", "c"]);
        std::fs::remove_dir(at("c")).unwrap();
        together(|| {
            write_atomic(at("a"), b"new")?;
            write_atomic(at("b"), b"new")?;
            assert_eq!(std::fs::read(at("a")).unwrap(), b"old");
            Ok::<(), Error>(())
        })
        .unwrap();
        assert_eq!((names(), std::fs::read(at("a")).unwrap()), (vec!["a".into(), "b".into()], b"new".to_vec()));
    }

    #[test]
    fn leftovers_of_a_killed_process_are_removed_by_the_next() {
        let folder = tempfile::tempdir().unwrap();
        let long = "n".repeat(240);
        for name in ["out.json", &long] {
            let target = folder.path().join(name);
            let file = AtomicFile::create(&target).unwrap();
            // As a killed process does: the file stays, and its lock does not.
            let Work::Beside(temporary, _) = file.work else { panic!("a stream") };
            let (_, left) = temporary.keep().unwrap();
            let busy = AtomicFile::create(&target).unwrap();
            assert!(!left.exists());
            write_atomic(&target, b"one").unwrap();
            busy.commit().unwrap();
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn folder_or_missing_parent_is_an_error() {
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

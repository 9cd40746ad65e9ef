//! Destination of an output: a file that is replaced whole, or a device, a pipe or a socket that is written through.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use crate::error::Error;

/// Links that lead from one to the next; more are a loop.
const MAX_LINKS: usize = 40;

/// Destination behind an output's name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Destination {
    /// A regular file, there or not yet, at the end of all symbolic links.
    File(PathBuf),
    /// A target that takes bytes and is no file: a device, a pipe, a socket, another process's open file.
    Stream(PathBuf),
}

impl Destination {
    /// Follows the symbolic links of a path.
    pub(crate) fn of(path: &Path) -> io::Result<Self> {
        let mut at = path.to_path_buf();
        for _ in 0..MAX_LINKS {
            let identity = match fs::symlink_metadata(&at) {
                Err(problem) if problem.kind() == io::ErrorKind::NotFound => return Ok(Self::File(at)),
                other => other?,
            };
            if identity.is_dir() {
                return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder; name a file in it"));
            }
            if !identity.is_symlink() {
                return Ok(if identity.is_file() { Self::File(at) } else { Self::Stream(path.into()) });
            }
            // The links of open files (`/dev/stdout` leads there) name no path that could be opened.
            if folder(&at).canonicalize()?.starts_with("/proc") {
                return Ok(Self::Stream(path.into()));
            }
            let to = fs::read_link(&at)?;
            at = folder(&at).join(to);
        }
        Err(io::Error::other("too many symbolic links lead from one to the next"))
    }
}

/// Returns true if an output takes bytes but is no file: a device, a pipe, a socket, another process's open file.
/// Nothing is lost by writing to it, and nothing can be kept beside it.
pub fn is_stream(output: &Path) -> bool {
    matches!(Destination::of(output), Ok(Destination::Stream(_)))
}

/// The folder that a file is in.
pub(crate) fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Identity of a file, which all its names share.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Identity {
    /// Device and number of a file that is there: hard links share them.
    #[cfg(unix)]
    Inode(u64, u64),
    /// The real folder and the name of another one.
    Path(PathBuf),
}

/// The identity of a regular file, there or not yet; `None` for any other target, or one that cannot be inspected.
fn identity(path: &Path) -> Option<Identity> {
    let Ok(Destination::File(real)) = Destination::of(path) else { return None };
    #[cfg(unix)]
    if let Ok(existing) = fs::metadata(&real) {
        use std::os::unix::fs::MetadataExt;
        return Some(Identity::Inode(existing.dev(), existing.ino()));
    }
    Some(Identity::Path(folder(&real).canonicalize().ok()?.join(real.file_name()?)))
}

/// Refuses outputs that cannot be written, before any work is done for them. Such are an output that is an input by any
/// path (other spelling, symbolic or hard link), two that are one file, a folder, and a file in a missing folder.
///
/// Devices, pipes and sockets may be named more than once. An input that is a folder stands for the files in it.
///
/// # Errors
/// The first output at fault, with the reason.
pub fn check_outputs<O: AsRef<Path>, I: AsRef<Path>>(outputs: &[O], inputs: &[I]) -> Result<(), Error> {
    let read: Vec<Identity> = inputs.iter().flat_map(|input| identities(input.as_ref())).collect();
    let mut written: BTreeMap<Identity, &Path> = BTreeMap::new();
    for output in outputs.iter().map(AsRef::as_ref) {
        let error = |source| Error::Io { path: output.into(), action: "write", source };
        if output == Path::new("-") {
            let mend =
                "results go into files: name one, or /dev/stdout for the standard output (./- is a file of this name)";
            return Err(error(io::Error::new(io::ErrorKind::InvalidInput, mend)));
        }
        let Destination::File(real) = Destination::of(output).map_err(error)? else { continue };
        fs::metadata(folder(&real)).map_err(error)?;
        let Some(identity) = identity(output) else { continue };
        if read.contains(&identity) {
            return Err(Error::OverwritesInput { path: output.into() });
        }
        if let Some(first) = written.insert(identity, output) {
            return Err(Error::SameOutput { first: first.into(), second: output.into() });
        }
    }
    Ok(())
}

fn identities(input: &Path) -> Vec<Identity> {
    match fs::read_dir(input) {
        Ok(entries) => entries.flatten().filter_map(|entry| identity(&entry.path())).collect(),
        Err(_) => identity(input).into_iter().collect(),
    }
}

/// Returns true if an open file is the one that has this name.
#[cfg(unix)]
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same = |a: fs::Metadata, b: fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    file.metadata().ok().zip(fs::metadata(path).ok()).is_some_and(|(here, there)| same(here, there))
}

/// Returns true if an open file is the one that has this name.
#[cfg(not(unix))]
pub(crate) fn is_at(_file: &File, _path: &Path) -> bool {
    true
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn links_are_followed_to_the_file_and_streams_are_known() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("real.json"), "x").unwrap();
        symlink("real.json", at("link.json")).unwrap();
        symlink("gone.json", at("dangling.json")).unwrap();
        symlink("loop.json", at("loop.json")).unwrap();
        assert_eq!(Destination::of(&at("link.json")).unwrap(), Destination::File(at("real.json")));
        assert_eq!(Destination::of(&at("dangling.json")).unwrap(), Destination::File(at("gone.json")));
        assert!(Destination::of(&at("loop.json")).is_err());
        assert!(Destination::of(folder.path()).is_err());
        let zero = Path::new("/dev/zero");
        assert_eq!(Destination::of(zero).unwrap(), Destination::Stream(zero.into()));
        #[cfg(target_os = "linux")]
        assert!(matches!(Destination::of(Path::new("/dev/stdout")).unwrap(), Destination::Stream(_)));
    }

    #[test]
    fn one_file_by_many_names_is_recognised() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("log.csv"), "x").unwrap();
        symlink("log.csv", at("symbolic.csv")).unwrap();
        fs::hard_link(at("log.csv"), at("hard.csv")).unwrap();
        fs::create_dir(at("sub")).unwrap();
        for name in ["log.csv", "symbolic.csv", "hard.csv", "sub/../log.csv"] {
            let message = check_outputs(&[at(name)], &[at("log.csv")]).unwrap_err().to_string();
            assert!(message.contains("one of the inputs"), "{message}");
        }
        let message = check_outputs(&[at("a.json"), at("sub/../a.json")], &[at("log.csv")]).unwrap_err().to_string();
        assert!(message.contains("one file") && message.contains("sub/../a.json"), "{message}");
        symlink("a.json", at("to-a.json")).unwrap();
        assert!(check_outputs::<_, &Path>(&[at("a.json"), at("to-a.json")], &[]).is_err());
        assert!(check_outputs::<_, &Path>(&[at("no/a.json")], &[]).is_err());
        let message = check_outputs::<_, &Path>(&["-"], &[]).unwrap_err().to_string();
        assert!(message.contains("/dev/stdout"), "{message}");
        // A folder is the recording in it.
        assert!(check_outputs(&[at("log.csv")], &[folder.path()]).is_err());
        check_outputs::<_, &Path>(&[at("a.json"), at("b.json")], &[&at("log.csv")]).unwrap();
        check_outputs(&["/dev/zero", "/dev/zero"], &["/dev/zero"]).unwrap();
    }
}

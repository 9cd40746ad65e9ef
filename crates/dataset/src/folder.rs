//! A folder of logs that a command writes: its files appear all together or not at all, and never among those of an earlier command.

use fleetfoot_data::setting::FORCE;

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use fleetfoot_log::Format as LogFormat;
use fleetfoot_output::{WriteLock, check_outputs};
use tempfile::TempDir;

use crate::error::Error;

/// The recipe's name.
pub const RECIPE: &str = "robot.toml";

/// The beginning of the name of a hidden folder that files are made in.
const STAGING: &str = ".generating-";

/// The hidden file that one command at a time holds.
const LOCK: &str = ".generating.lock";

/// A folder under construction: files are made in a hidden folder inside of it, and moved out by [`Folder::commit`]. One command at a time works on it.
pub struct Folder {
    target: PathBuf,
    staging: TempDir,
    /// Files of an earlier command, that this one replaces.
    old: Vec<PathBuf>,
    /// Hidden folders of killed commands, which were removed.
    removed: Vec<PathBuf>,
    /// Hidden folders that may be another command's: the file system has no locks.
    leftovers: Vec<PathBuf>,
    _lock: WriteLock,
    // After the lock, whose file is in the folder.
    _made: Option<Made>,
}

/// A folder that was made for what is written: it goes again if nothing is in it in the end.
struct Made(PathBuf);

impl Drop for Made {
    fn drop(&mut self) {
        // A folder with files in it stays, and that is no error.
        let _ = fs::remove_dir(&self.0);
    }
}

impl Folder {
    /// Makes the folder if it is not there.
    ///
    /// # Errors
    /// A folder that holds recordings, which `fit FOLDER` would mix with the new ones. With `force`, those that have names of the command's `own`
    /// are replaced by the new ones, all of them; any other recording is refused still. A folder
    /// that another command is working on; one of the `inputs` among what would be replaced.
    pub fn create(target: &Path, force: bool, inputs: &[PathBuf], is_ours: fn(&str) -> bool) -> Result<Self, Error> {
        let error = |path: &Path, source| Error::Write { path: path.to_owned(), source };
        let is_there = target.exists();
        fs::create_dir_all(target).map_err(|source| error(target, source))?;
        let made = (!is_there).then(|| Made(target.to_owned()));
        let lock = WriteLock::take(target.join(LOCK), target)?;
        let old = Self::check(target, force, is_ours)?;
        check_outputs(&old, inputs)?;
        let (mut removed, mut leftovers) = (Vec::new(), left_in(target).map_err(|source| error(target, source))?);
        // Whoever made them is gone: the lock is here.
        if lock.is_exclusive() || force {
            std::mem::swap(&mut removed, &mut leftovers);
        }
        for left in &removed {
            fs::remove_dir_all(left).map_err(|source| error(left, source))?;
        }
        let staging = tempfile::Builder::new().prefix(STAGING).tempdir_in(target);
        let staging = staging.map_err(|source| error(target, source))?;
        Ok(Self { target: target.to_owned(), staging, old, removed, leftovers, _lock: lock, _made: made })
    }

    /// Notes on the folder, for the user.
    pub fn notes(&self) -> Vec<String> {
        let removed = |left: &PathBuf| format!("removed {}, which a killed command had left", left.display());
        let left =
            |left: &PathBuf| format!("a killed command may have left {}: remove it, or give {FORCE}", left.display());
        self.removed.iter().map(removed).chain(self.leftovers.iter().map(left)).collect()
    }

    /// The files that new ones would replace.
    ///
    /// # Errors
    /// Those of [`Folder::create`], and a folder that cannot be listed. A folder that is not there is none.
    pub fn check(target: &Path, force: bool, is_output: fn(&str) -> bool) -> Result<Vec<PathBuf>, Error> {
        let error = |source: io::Error| Error::Write { path: target.to_owned(), source };
        let entries = match fs::read_dir(target) {
            Err(problem) if problem.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            other => other.map_err(error)?,
        };
        let (mut ours, mut foreign) = (Vec::new(), Vec::new());
        for entry in entries {
            let path = entry.map_err(error)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name.starts_with('.') {
                continue;
            }
            if name == RECIPE || is_output(&name) {
                ours.push(path);
            } else if LogFormat::detect(&path).is_some() {
                foreign.push(path);
            }
        }
        ours.sort();
        foreign.sort();
        let advice = match (foreign.first(), ours.first()) {
            (Some(first), _) => format!("{} would be mixed with them: choose another folder", first.display()),
            (None, Some(first)) if !force => {
                format!(
                    "{} exists already: choose another folder, or {FORCE} to replace all logs in it",
                    first.display()
                )
            }
            _ => return Ok(ours),
        };
        Err(Error::output(format!("{}: these logs need an empty folder; {advice}", target.display())))
    }

    /// Path at which a file is written before it is moved.
    pub fn staged(&self, name: &str) -> PathBuf {
        self.staging.path().join(name)
    }

    /// Final path of a file.
    pub fn target(&self, name: &str) -> PathBuf {
        self.target.join(name)
    }

    /// Moves the files of these names out, and removes those of an earlier command.
    pub fn commit(self, names: &[String]) -> Result<(), Error> {
        let error = |path: &Path, source| Error::Write { path: path.to_owned(), source };
        let mut made: Vec<PathBuf> = Vec::new();
        for name in names {
            let (target, staged) = (self.target(name), self.staged(name));
            let is_new = !target.exists();
            if let Err(source) = fs::rename(staged, &target) {
                // All of them, or none: what cannot be removed either stays, and the error says where.
                made.iter().for_each(|path| drop(fs::remove_file(path)));
                return Err(error(&target, source));
            }
            made.extend(is_new.then_some(target));
        }
        for old in self.old.iter().filter(|old| !names.iter().any(|name| self.target(name) == **old)) {
            fs::remove_file(old).map_err(|source| error(old, source))?;
        }
        self.staging.close().map_err(|source| error(&self.target, source))
    }
}

/// The hidden folders in which files are made, of this or other commands.
fn left_in(target: &Path) -> io::Result<Vec<PathBuf>> {
    let mut leftovers = Vec::new();
    for entry in fs::read_dir(target)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with(STAGING) && entry.file_type()?.is_dir() {
            leftovers.push(entry.path());
        }
    }
    leftovers.sort();
    Ok(leftovers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_output(name: &str) -> bool {
        name.ends_with(".mcap") && !name.contains("field")
    }

    #[test]
    fn recordings_of_others_are_never_touched() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("notes.txt.md"), "mine").unwrap();
        Folder::create(folder.path(), false, &[], is_output).unwrap().commit(&[]).unwrap();
        fs::write(folder.path().join("field_day.mcap"), "mine").unwrap();
        for force in [false, true] {
            let message = Folder::create(folder.path(), force, &[], is_output).err().unwrap().to_string();
            assert!(message.contains("field_day.mcap"), "{message}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn abandoned_folder_is_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(RECIPE), "old").unwrap();
        let making = Folder::create(folder.path(), true, &[], is_output).unwrap();
        fs::write(making.staged(RECIPE), "new").unwrap();
        drop(making);
        assert_eq!(fs::read_to_string(folder.path().join(RECIPE)).unwrap(), "old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let making = Folder::create(folder.path(), true, &[], is_output).unwrap();
        fs::write(making.staged("a.md"), "new").unwrap();
        making.commit(&["a.md".to_owned()]).unwrap();
        assert!(!folder.path().join(RECIPE).exists() && folder.path().join("a.md").exists());
    }

    #[test]
    fn folder_of_a_failed_command_is_removed() {
        let parent = tempfile::tempdir().unwrap();
        let target = parent.path().join("clean");
        let making = Folder::create(&target, false, &[], is_output).unwrap();
        fs::write(making.staged("a.md"), "half").unwrap();
        drop(making);
        assert!(!target.exists());
        let making = Folder::create(&target, false, &[], is_output).unwrap();
        fs::write(making.staged("a.md"), "whole").unwrap();
        making.commit(&["a.md".to_owned()]).unwrap();
        assert_eq!(fs::read_to_string(target.join("a.md")).unwrap(), "whole");
    }

    #[test]
    fn second_command_is_refused_and_leftovers_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let left = folder.path().join(".generating-killed");
        fs::create_dir(&left).unwrap();
        fs::write(left.join("hexapod_00.mcap"), "half").unwrap();
        let making = Folder::create(folder.path(), false, &[], is_output).unwrap();
        assert!(
            making.notes()[0].contains("removed ") && making.notes()[0].contains(".generating-killed"),
            "{:?}",
            making.notes()
        );
        assert!(!left.exists());
        let message = Folder::create(folder.path(), true, &[], is_output).err().unwrap().to_string();
        assert!(message.contains("another command"), "{message}");
        making.commit(&[]).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

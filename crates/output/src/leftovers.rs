//! Unfinished files of killed commands: they lie beside the output, and the next command with the same output removes them.

use std::{
    collections::{BTreeMap, HashSet},
    ffi::OsString,
    fs::{self, File},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use crate::destination::{Destination, folder};

/// Random letters and digits in the name of an unfinished file.
pub(crate) const RANDOM: usize = 6;

/// The end of the name of an unfinished file.
pub(crate) const SUFFIX: &str = ".partial";

/// Bytes of a target's name in that of its unfinished file: longer ones leave no room for its prefix and suffix.
const LONGEST_NAME: usize = 200;

/// The beginning of the name of a target's unfinished files.
pub(crate) fn prefix(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    let end = (0..=name.len().min(LONGEST_NAME)).rfind(|&end| name.is_char_boundary(end)).unwrap_or(0);
    format!(".{}.", &name[..end])
}

/// Removes the unfinished files that killed commands have left of an output, and returns their paths. An unfinished file that another command writes is locked
/// and stays. On a file system without locks all of them stay.
pub fn remove_leftovers(output: &Path) -> Vec<PathBuf> {
    let Ok(Destination::File(real)) = Destination::of(output) else { return Vec::new() };
    remove(&real, &unfinished(folder(&real)))
}

/// The same for a regular file that is about to be written. A folder is listed once for all first files of their names
/// in it; a listing for each of many files would take the square of their number.
pub(crate) fn remove_once(target: &Path) {
    let Some(name) = target.file_name() else { return };
    let listed = {
        let mut folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
        if folders.len() >= MOST_FOLDERS {
            folders.clear();
        }
        let begun = folders.get(folder(target)).map_or(0, |folder| folder.begun.len());
        let leftovers = folders.entry(folder(target).to_path_buf()).or_default();
        if begun == 0 || begun >= MOST_NAMES || leftovers.begun.contains(name) {
            *leftovers = Listed { unfinished: Arc::new(unfinished(folder(target))), begun: HashSet::new() };
        }
        leftovers.begun.insert(name.to_owned());
        leftovers.unfinished.clone()
    };
    remove(target, &listed);
}

/// Folders in which this process has begun files.
static FOLDERS: Mutex<BTreeMap<PathBuf, Listed>> = Mutex::new(BTreeMap::new());
/// Folders and names in each that are remembered at most.
const MOST_FOLDERS: usize = 100;
const MOST_NAMES: usize = 10_000;

/// A folder's unfinished files when it was listed, and the names of the files begun since.
#[derive(Default)]
struct Listed {
    unfinished: Arc<Vec<String>>,
    begun: HashSet<OsString>,
}

/// Names of all unfinished files in a folder.
fn unfinished(folder: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    names.filter(|name| name.starts_with('.') && name.ends_with(SUFFIX)).collect()
}

/// Removes those that are a target's.
fn remove(real: &Path, unfinished: &[String]) -> Vec<PathBuf> {
    let prefix = prefix(real);
    let is_of_target = |name: &&String| {
        let random = name.strip_prefix(&prefix).and_then(|rest| rest.strip_suffix(SUFFIX));
        random.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
    };
    let mut removed: Vec<PathBuf> =
        unfinished.iter().filter(is_of_target).map(|name| real.with_file_name(name)).collect();
    // The lock is held until the file is gone, so that nobody can begin to write it.
    removed.retain(|path| File::open(path).is_ok_and(|file| file.try_lock().is_ok() && fs::remove_file(path).is_ok()));
    removed.sort();
    removed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_listed_once_for_many_files() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at(".b.json.a1B2c3.partial"), "half").unwrap();
        remove_once(&at("a.json"));
        // Left since: only the second file of its name looks again.
        fs::write(at(".c.json.a1B2c3.partial"), "half").unwrap();
        remove_once(&at("b.json"));
        assert!(!at(".b.json.a1B2c3.partial").exists());
        remove_once(&at("c.json"));
        assert!(at(".c.json.a1B2c3.partial").exists());
        remove_once(&at("c.json"));
        assert!(!at(".c.json.a1B2c3.partial").exists());
    }

    #[test]
    fn only_abandoned_unfinished_files_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let (target, at) = (folder.path().join("model.json"), |name: &str| folder.path().join(name));
        let busy = crate::atomic::AtomicFile::create(&target).unwrap();
        let others = [
            ".other.json.a1B2c3.partial",
            ".model.json.a1B2c3d.partial",
            "model.json.a1B2c3.partial",
            "model.json.partial",
        ];
        others.iter().for_each(|name| fs::write(at(name), "half").unwrap());
        fs::write(at(".model.json.a1B2c3.partial"), "half").unwrap();
        assert_eq!(remove_leftovers(&target), [at(".model.json.a1B2c3.partial")]);
        assert!(remove_leftovers(&target).is_empty());
        assert!(others.iter().all(|name| at(name).exists()));
        busy.commit().unwrap();
    }
}

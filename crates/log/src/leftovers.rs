//! What killed commands leave beside their outputs: unfinished files, which the next command with the same output removes.

use std::{
    ffi::OsString,
    fs::{self, File},
    path::{Path, PathBuf},
};

use crate::destination::{Destination, folder};

/// Random letters and digits in the name of an unfinished file.
pub(crate) const RANDOM: usize = 6;

/// The end of the name of an unfinished file.
pub(crate) const SUFFIX: &str = ".partial";

/// Bytes of a target's name in that of its unfinished file: longer ones leave no room for what is put around them.
const LONGEST_NAME: usize = 200;

/// The beginning of the name of an unfinished file.
pub(crate) fn prefix(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    let end = (0..=name.len().min(LONGEST_NAME)).rfind(|&end| name.is_char_boundary(end)).unwrap_or(0);
    format!(".{}.", &name[..end])
}

/// Removes what killed commands have left of an output, and tells the paths. An unfinished file that another command writes is locked, and stays; so does one on a file system
/// without locks.
pub fn remove_leftovers(output: &Path) -> Vec<PathBuf> {
    let Ok(Destination::File(real)) = Destination::of(output) else { return Vec::new() };
    let prefix = prefix(&real);
    let Ok(entries) = fs::read_dir(folder(&real)) else { return Vec::new() };
    let is_unfinished = |name: &OsString| {
        let name = name.to_string_lossy();
        let random = name.strip_prefix(&prefix).and_then(|rest| rest.strip_suffix(SUFFIX));
        random.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
    };
    let names = entries.flatten().map(|entry| entry.file_name()).filter(is_unfinished);
    let mut removed: Vec<PathBuf> = names.map(|name| real.with_file_name(name)).collect();
    // The lock is held until the file is gone, so that nobody can begin to write it.
    removed.retain(|path| File::open(path).is_ok_and(|file| file.try_lock().is_ok() && fs::remove_file(path).is_ok()));
    removed.sort();
    removed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unfinished_files_are_removed_only_when_nobody_writes_them() {
        let folder = tempfile::tempdir().unwrap();
        let (target, at) = (folder.path().join("model.json"), |name: &str| folder.path().join(name));
        let busy = crate::AtomicFile::create(&target).unwrap();
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

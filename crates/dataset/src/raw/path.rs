//! Paths from one file to another.

use std::path::{Component, Path, PathBuf};

/// The path of a file from a folder, with `/` between its parts; the whole path where they share no root.
pub(super) fn relative(file: &Path, folder: &Path) -> String {
    let whole = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).unwrap_or(path.to_path_buf());
    let (file, folder) = (whole(file), whole(folder));
    let shared = file.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return file.display().to_string();
    }
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let parts = up.chain(file.components().skip(shared));
    parts.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("/")
}

/// Resolves a path that is relative to the folder of another file.
pub(super) fn beside(prepared: &Path, path: &str) -> PathBuf {
    prepared.parent().unwrap_or(Path::new("")).join(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_relative_path_leads_back() {
        let folder = tempfile::tempdir().unwrap();
        let (runs, clean) = (folder.path().join("runs/a"), folder.path().join("clean"));
        std::fs::create_dir_all(&runs).unwrap();
        std::fs::create_dir_all(&clean).unwrap();
        let log = runs.join("log.csv");
        std::fs::write(&log, "t,x\n").unwrap();
        let path = relative(&log, &clean);
        assert_eq!(path, "../runs/a/log.csv");
        assert_eq!(relative(&clean.join("log.csv"), &clean), "log.csv");
        let path_back = beside(&clean.join("log.clean.parquet"), &path);
        assert_eq!(path_back.canonicalize().unwrap(), log.canonicalize().unwrap());
    }
}

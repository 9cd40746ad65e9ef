//! Arguments to files: names, patterns and folders.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use fleetfoot_data::nearest_one;

use crate::{Error, Format, containers};

/// Folders inside folders are followed this deep: a loop of links ends here.
const MAX_DEPTH: usize = 32;

/// The files that arguments name: files, glob patterns (`runs/**/*.csv`) and folders (recursively, files of known formats).
///
/// A folder that is one recording (rosbag2), named or met on the way, is in the answer by its own path, and its files are not.
///
/// The answer is sorted and each file appears once, so that the order of the arguments does not matter. A named file of an unknown
/// format is an error, and so is an argument that matches nothing; both say what to do.
pub fn paths<P: AsRef<Path>>(arguments: impl IntoIterator<Item = P>) -> Result<Vec<PathBuf>, Error> {
    let mut files = BTreeSet::new();
    for argument in arguments {
        let argument = argument.as_ref();
        if argument.is_dir() {
            let mut inside = BTreeSet::new();
            collect_folder(argument, 0, &mut inside)?;
            if inside.is_empty() {
                return Err(Error::EmptyFolder { path: argument.into() });
            }
            files.append(&mut inside);
        } else if argument.exists() {
            if Format::of(argument).is_none() {
                return Err(Error::UnknownFormat { path: argument.into() });
            }
            files.insert(argument.to_path_buf());
        } else {
            collect_pattern(argument, &mut files)?;
        }
    }
    if files.is_empty() {
        return Err(Error::NoFiles);
    }
    Ok(distinct(files))
}

/// One path for each file, whatever ways lead to it.
pub(crate) fn distinct(files: BTreeSet<PathBuf>) -> Vec<PathBuf> {
    let mut seen = BTreeSet::new();
    files.into_iter().filter(|path| seen.insert(fs::canonicalize(path).unwrap_or_else(|_| path.clone()))).collect()
}

fn collect_folder(folder: &Path, depth: usize, paths: &mut BTreeSet<PathBuf>) -> Result<(), Error> {
    if depth > MAX_DEPTH {
        return Ok(());
    }
    if let Some(readable) = containers::folder(folder) {
        readable?;
        paths.insert(folder.into());
        return Ok(());
    }
    // Its rows; the tables beside them are about episodes and tasks.
    if is_lerobot(folder) {
        return collect_folder(&folder.join("data"), depth + 1, paths);
    }
    let error = |source: io::Error| Error::Io { path: folder.into(), action: "list", source };
    for entry in fs::read_dir(folder).map_err(error)? {
        let path = entry.map_err(error)?.path();
        // Hidden files are unfinished or not meant.
        if path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b".")) {
            continue;
        }
        if path.is_dir() {
            collect_folder(&path, depth + 1, paths)?;
        } else if Format::detect(&path).is_some() {
            paths.insert(path);
        }
    }
    drop_converted(paths);
    Ok(())
}

/// True if a folder is a data set of LeRobot: `meta/info.json` has the version of its format.
fn is_lerobot(folder: &Path) -> bool {
    let info = fs::File::open(folder.join("meta/info.json"));
    let mut start = Vec::new();
    let read = info.is_ok_and(|file| io::Read::read_to_end(&mut io::Read::take(file, 1 << 20), &mut start).is_ok());
    read && memchr::memmem::find(&start, b"\"codebase_version\"").is_some() && folder.join("data").is_dir()
}

/// Leaves out recordings beside which a copy lies that was converted to MCAP: the same rows would come twice. Leaves out arrays beside logs, too:
/// they are calibrations or exported models, not rows.
fn drop_converted(paths: &mut BTreeSet<PathBuf>) {
    let is_array = |path: &PathBuf| matches!(Format::of(path), Some(Format::Npy | Format::Npz | Format::Mat));
    if !paths.iter().all(is_array) {
        paths.retain(|path| !is_array(path));
    }
    let older = |path: &PathBuf| matches!(Format::of(path), Some(Format::Bag(_) | Format::Db3(_)));
    let copies: Vec<PathBuf> =
        paths.iter().filter(|path| older(path) && paths.contains(&path.with_extension("mcap"))).cloned().collect();
    copies.iter().for_each(|path| {
        paths.remove(path);
    });
}

fn collect_pattern(argument: &Path, files: &mut BTreeSet<PathBuf>) -> Result<(), Error> {
    let pattern = argument.to_string_lossy().into_owned();
    let missing = || Error::NoMatch { pattern: pattern.clone(), nearest: nearest_path(argument) };
    if !pattern.contains(['*', '?', '[']) {
        return Err(missing());
    }
    // Hidden files must be named as such, as in a shell.
    let options = glob::MatchOptions { require_literal_leading_dot: true, ..glob::MatchOptions::new() };
    let matches = glob::glob_with(&pattern, options)
        .map_err(|problem| Error::Pattern { pattern: pattern.clone(), problem: problem.to_string() })?;
    let (mut paths, mut unknown) = (BTreeSet::new(), None);
    for path in matches {
        let path =
            path.map_err(|failure| Error::Io { path: failure.path().into(), action: "list", source: failure.into() })?;
        if path.is_dir() {
            collect_folder(&path, 1, &mut paths)?;
        } else if Format::detect(&path).is_some() {
            paths.insert(path);
        } else {
            unknown = Some(path);
        }
    }
    drop_converted(&mut paths);
    // A pattern such as `runs/*` may catch notes beside the logs; only when it catches nothing else is that an error.
    match (paths.is_empty(), unknown) {
        (false, _) => files.append(&mut paths),
        // Opening it says what it is instead of a log.
        (true, Some(path)) if Format::of(&path).is_some() => {
            files.insert(path);
        }
        (true, unknown) => {
            return Err(unknown.map_or_else(missing, |path| Error::UnknownFormat { path }));
        }
    }
    Ok(())
}

/// An existing path that looks like `wanted`: the nearest name in the deepest folder that exists.
fn nearest_path(wanted: &Path) -> Option<String> {
    let mut folder = wanted.parent()?;
    let mut name = wanted.file_name()?;
    loop {
        let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        if let Ok(entries) = fs::read_dir(listed) {
            let names: BTreeSet<String> =
                entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
            let best = nearest_one(&name.to_string_lossy(), names.iter().map(String::as_str))?;
            return Some(folder.join(best).to_string_lossy().into_owned());
        }
        name = folder.file_name()?;
        folder = folder.parent()?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    #[test]
    fn folders_patterns_and_files_give_a_sorted_set() {
        let folder = folder(&["b.csv", "a.parquet", "sub/c.csv.gz", "notes.md", ".hidden.csv", "sub/d.tsv"]);
        let root = folder.path();
        let all = paths([root]).unwrap();
        let names: Vec<_> = all.iter().map(|path| path.strip_prefix(root).unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["a.parquet", "b.csv", "sub/c.csv.gz", "sub/d.tsv"]);
        assert_eq!(paths([root.join("*.csv"), root.join("b.csv"), root.join("sub/../b.csv")]).unwrap().len(), 1);
        assert_eq!(paths([root.join("**/*.csv*")]).unwrap().len(), 2);
        assert_eq!(paths([root.join("*")]).unwrap().len(), 4);
        assert_eq!(
            paths([root.join("sub"), root.join("a.parquet")]).unwrap(),
            paths([root.join("a.parquet"), root.join("sub")]).unwrap()
        );
    }

    #[test]
    fn rosbag2_folder_is_one_recording() {
        let folder =
            folder(&["runs/bag/a.mcap", "runs/bag/b.mcap", "runs/c.mcap", "old/x.bag", "old/y.bag", "db/z.db3"]);
        let root = folder.path();
        let metadata =
            "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [b.mcap, a.mcap]\n";
        fs::write(root.join("runs/bag/metadata.yaml"), metadata).unwrap();
        assert_eq!(paths([root.join("runs")]).unwrap(), [root.join("runs/bag"), root.join("runs/c.mcap")]);
        assert_eq!(paths([root.join("runs/*")]).unwrap(), [root.join("runs/bag"), root.join("runs/c.mcap")]);
        assert_eq!(paths([root.join("runs/bag")]).unwrap(), [root.join("runs/bag")]);
        assert_eq!(paths([root.join("old")]).unwrap(), [root.join("old/x.bag"), root.join("old/y.bag")]);
        assert_eq!(paths([root.join("db")]).unwrap(), [root.join("db/z.db3")]);
        fs::write(root.join("old/x.mcap"), "").unwrap();
        for argument in ["old", "old/*"] {
            assert_eq!(paths([root.join(argument)]).unwrap(), [root.join("old/x.mcap"), root.join("old/y.bag")]);
        }
        // One that is named is wanted.
        assert_eq!(paths([root.join("old/x.bag")]).unwrap(), [root.join("old/x.bag")]);
        let sqlite = "rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n  relative_file_paths: [z.db3]\n";
        fs::write(root.join("db/metadata.yaml"), sqlite).unwrap();
        assert_eq!(paths([root.join("db")]).unwrap(), [root.join("db")]);
        // A recording whose file is missing is an error wherever it lies.
        fs::remove_file(root.join("runs/bag/b.mcap")).unwrap();
        assert!(paths([root]).unwrap_err().to_string().contains("b.mcap does not exist"));
    }

    #[test]
    fn mistakes_name_the_argument_and_the_nearest_file() {
        let folder = folder(&["wind35.csv", "notes.md", "empty/readme"]);
        let root = folder.path();
        let message = paths([root.join("wnd35.csv")]).unwrap_err().to_string();
        assert!(message.contains("wnd35.csv") && message.contains("wind35.csv"), "{message}");
        let message = paths([root.join("notes.md")]).unwrap_err().to_string();
        assert!(message.contains("notes.md") && message.contains(".parquet"), "{message}");
        assert!(matches!(paths([root.join("*.md")]), Err(Error::UnknownFormat { .. })));
        assert!(matches!(paths([root.join("*.parquet")]), Err(Error::NoMatch { .. })));
        assert!(matches!(paths([root.join("empty")]), Err(Error::EmptyFolder { .. })));
        assert!(matches!(paths([root.join("a[")]), Err(Error::Pattern { .. })));
        assert!(matches!(paths::<&Path>([]), Err(Error::NoFiles)));
    }
}

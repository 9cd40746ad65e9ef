//! Known inputs from fuzzing, run through the functions of the fuzz targets: repaired faults stay repaired, in every
//! build and without a nightly compiler.

use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

#[path = "../../../../fuzz/fuzz_targets/body/cdr.rs"]
mod cdr;
#[path = "../../../../fuzz/fuzz_targets/body/reader.rs"]
mod reader;

/// Duration that the targets call a hang.
const HANG: Duration = Duration::from_secs(10);

/// The inputs of a target, in the order of their names.
fn corpus(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let entries = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).filter(|path| path.is_file()).collect();
    files.sort();
    assert!(!files.is_empty(), "{} is empty: the corpus is part of the repository", folder.display());
    files
}

/// Runs a target on its inputs, and names those that it fails on.
fn replay(target: &str, run: fn(&[u8])) {
    let mut failed = Vec::new();
    for file in corpus(target) {
        let data = fs::read(&file).unwrap();
        let start = Instant::now();
        let outcome = std::panic::catch_unwind(|| run(&data));
        if outcome.is_err() || start.elapsed() > HANG {
            failed.push(file);
        }
    }
    assert!(failed.is_empty(), "{target} fails on {failed:#?}");
}

#[test]
fn messages() {
    replay("cdr", cdr::run);
}

#[test]
fn files() {
    replay("reader", reader::run);
}

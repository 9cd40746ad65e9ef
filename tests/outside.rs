//! Needs of tests from outside the checkout: recordings of real machines, and a Python with other readers and writers.
//!
//! These are named by `FLEETFOOT_DATA` and `FLEETFOOT_PYTHON`, or lie beside the checkout. A test then fails if a part
//! of them is missing. In a fresh clone alone the tests pass, and print the parts that they skipped.

#![allow(dead_code, reason = "each test binary includes this file and uses what it needs")]

use std::{
    ffi::OsString,
    path::{Path, PathBuf},
    process::Command,
};

/// A file or folder of the recordings: in `FLEETFOOT_DATA`, else in `shared/data` beside the checkout. `None`, with a
/// printed line, if neither has it.
///
/// # Panics
/// The folder is there, or was named, and has no such file.
pub(crate) fn data(name: &str) -> Option<PathBuf> {
    let (folder, named) = match std::env::var_os("FLEETFOOT_DATA").filter(|folder| !folder.is_empty()) {
        Some(folder) => (PathBuf::from(folder), true),
        None => (beside_the_checkout("shared/data"), false),
    };
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(!named && !folder.is_dir(), "{name} is not in {}", folder.display());
    eprintln!("skipped: there is no {} (set FLEETFOOT_DATA)", folder.display());
    None
}

/// The interpreter of `FLEETFOOT_PYTHON`, which can import these packages. `None`, with a printed line, if the variable
/// is not set.
///
/// # Panics
/// It does not run, or lacks a package.
pub(crate) fn python(packages: &str) -> Option<OsString> {
    let Some(python) = std::env::var_os("FLEETFOOT_PYTHON").filter(|python| !python.is_empty()) else {
        eprintln!("skipped: FLEETFOOT_PYTHON names no Python with {packages} (tests/peers/requirements.txt)");
        return None;
    };
    let tried = Command::new(&python).args(["-c", &format!("import {packages}")]).output();
    let tried = tried.unwrap_or_else(|problem| panic!("FLEETFOOT_PYTHON={} does not run: {problem}", python.display()));
    let errors = String::from_utf8_lossy(&tried.stderr);
    assert!(tried.status.success(), "FLEETFOOT_PYTHON={} lacks a package: {}", python.display(), errors.trim());
    Some(python)
}

/// A path beside the checkout, whose root holds the lock file.
fn beside_the_checkout(name: &str) -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = manifest.ancestors().find(|folder| folder.join("Cargo.lock").exists()).unwrap_or(manifest);
    root.join("..").join(name)
}

//! Whole log files, none of their bytes to be trusted.
//!
//! An input is a file: `.bag`, `.db3`, `.bin`, `.log`, `.wpilog`, `.npy`, `.npz` or `.mat` where it begins as these do, `.mcap.zstd` where it begins as Zstandard does, else `.mcap`. It is inspected, its fields are opened as a recording, and
//! every row is read. Errors are fine; panics, hangs, memory beyond measure and rows that break their own promises are not.

use std::path::Path;

use fleetfoot_data::{Halo, Silent, Source};
use fleetfoot_log::{Base, JoinSpec, Recording, Selection, Stamp, inspect, inspect_values, open};

/// More columns than these only cost time.
const MAX_COLUMNS: usize = 32;

/// The names of the columns that can be read.
fn columns(path: &Path) -> Vec<String> {
    let quick = inspect(path);
    let scanned = inspect_values(path, &Silent);
    let listed = scanned.or(quick).map(|info| info.columns).unwrap_or_default();
    listed
        .into_iter()
        .filter(|column| column.unsupported.is_none())
        .take(MAX_COLUMNS)
        .map(|column| column.name)
        .collect()
}

/// Reads all rows of a recording.
fn read(recording: &Recording) {
    for (place, episode) in recording.episodes().iter().enumerate() {
        assert!(episode.start <= episode.end, "{} ends before it begins", episode.name);
        let Ok(block) = recording.read(place, 0..episode.rows, Halo::default()) else { continue };
        assert_eq!(block.rows, episode.rows);
        assert_eq!(block.columns.len(), recording.columns().len());
        assert!(block.columns.iter().all(|column| column.len() == episode.rows));
        assert!(block.stamps().windows(2).all(|pair| pair[0] < pair[1]), "stamps of {} do not increase", episode.name);
    }
}

/// Reads one input to its last row; panics where a promise is broken.
pub(crate) fn run(data: &[u8]) {
    let kinds: [(&[u8], &str); 9] = [
        (&[0x28, 0xB5, 0x2F, 0xFD], ".mcap.zstd"),
        (b"#ROSBAG V", ".bag"),
        (b"SQLite format 3\0", ".db3"),
        (&[0xA3, 0x95, 0x80], ".bin"),
        (b"FMT,", ".log"),
        (b"WPILOG", ".wpilog"),
        (b"\x93NUMPY", ".npy"),
        (b"PK\x03\x04", ".npz"),
        (b"MATLAB 5.0", ".mat"),
    ];
    let suffix = kinds.iter().find(|(magic, _)| data.starts_with(magic)).map_or(".mcap", |(_, suffix)| suffix);
    let Ok(file) = tempfile::Builder::new().suffix(suffix).tempfile() else { return };
    if std::fs::write(file.path(), data).is_err() {
        return;
    }
    let columns = columns(file.path());
    if columns.is_empty() {
        return;
    }
    for join in
        [JoinSpec::default(), JoinSpec { stamp: Some(Stamp::Log), base: Some(Base::Rate(20.0)), ..JoinSpec::default() }]
    {
        let selection = Selection { join, ..Selection::new(columns.clone()) };
        if let Ok(recording) = open(&[file.path()], &selection) {
            read(&recording);
        }
    }
}

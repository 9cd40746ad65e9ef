//! The cache, and independence of the answer from threads and memory.

use std::{fs, path::PathBuf};

use fleetfoot_data::{Silent, with_threads};
use fleetfoot_log::{Base, Cache, Selection, Stamp, estimate};

use super::logs::{Log, MILLISECOND, Written, copy, episodes, usual, whole};

const COLUMNS: [&str; 4] =
    ["/odom.pose.pose.position.x", "/force.vector.x", "/odom.child_frame_id", "/odom.pose.pose.orientation.z"];

fn cached(log: &Written) -> (Selection, PathBuf) {
    let folder = log.folder.path().join("deep/cache");
    let mut selection = Selection::new(COLUMNS);
    selection.join.cache = Some(Cache { folder: folder.clone(), least_bytes: 0 });
    (selection, folder)
}

fn files(folder: &PathBuf) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn decoded_columns_are_kept_and_read_again() {
    let log = usual();
    let (selection, folder) = cached(&log);
    let plain = log.open(&Selection::new(COLUMNS));
    assert!(!estimate(&[&log.path], &selection, &Silent).unwrap().unwrap().cached);
    let first = log.open(&selection);
    let kept = files(&folder);
    assert_eq!(kept.len(), 1);
    assert!(estimate(&[&log.path], &selection, &Silent).unwrap().unwrap().cached);
    let second = log.open(&selection);
    assert_eq!(files(&folder), kept);
    for recording in [&first, &second] {
        assert_eq!(whole(recording), whole(&plain));
        assert_eq!(fleetfoot_data::Source::columns(recording), fleetfoot_data::Source::columns(&plain));
        assert_eq!(recording.log_offset(0), 2 * MILLISECOND);
        assert_eq!(recording.notes(), plain.notes());
    }
    // It is the kept columns that are read: with those of another log in their place, other values come.
    let mut other = Log::new();
    other.drive(|_, at| Some((at + 7, at + 9)));
    let other = other.finish();
    let (selection_of_other, folder_of_other) = cached(&other);
    let rows_of_other = whole(&other.open(&selection_of_other));
    assert_ne!(rows_of_other, whole(&plain));
    copy(&files(&folder_of_other)[0], &kept[0]);
    assert_eq!(whole(&log.open(&selection)), rows_of_other);
}

#[test]
fn damaged_columns_are_decoded_anew() {
    let log = usual();
    let (selection, folder) = cached(&log);
    let truth = whole(&log.open(&selection));
    let kept = files(&folder).remove(0);
    let sound = fs::read(&kept).unwrap();
    for broken in [&b""[..], b"PAR1PAR1", &sound[..sound.len() / 2], &sound[sound.len() / 2..]] {
        fs::write(&kept, broken).unwrap();
        assert_eq!(whole(&log.open(&selection)), truth);
        assert_eq!(fs::read(&kept).unwrap(), sound, "and kept again");
    }
}

#[test]
fn each_selection_has_separate_cached_columns() {
    let log = usual();
    let (selection, folder) = cached(&log);
    log.open(&selection);
    let changes: [fn(&mut Selection); 6] = [
        |choice| choice.columns.truncate(2),
        |choice| choice.join.stamp = Some(Stamp::Log),
        |choice| choice.join.base = Some(Base::Channel("/force".into())),
        |choice| choice.join.reorder_seconds = 0.2,
        |choice| choice.join.renames = vec![("/odometry".into(), "/nothing".into())],
        |choice| {
            choice.join.columns.insert("/force.vector.x".into(), fleetfoot_log::ColumnJoin::default());
        },
    ];
    for (place, change) in changes.iter().enumerate() {
        let mut other = selection.clone();
        change(&mut other);
        log.open(&other);
        assert_eq!(files(&folder).len(), place + 2);
    }
    // A change that keeps the columns opens no file again.
    log.open(&Selection { memory_budget: 0, ..selection.clone() });
    assert_eq!(files(&folder).len(), changes.len() + 1);
    // Small files are not worth it.
    let mut large = selection;
    let unused = log.folder.path().join("unused");
    large.join.cache = Some(Cache { folder: unused.clone(), least_bytes: 1 << 30 });
    log.open(&large);
    assert!(!unused.exists());
}

#[test]
fn threads_and_memory_change_no_bit() {
    let mut log = Log::with_chunks(1000);
    log.drive(|topic, at| Some((at + if topic == "/force" { at % 7 } else { 0 }, at + 2 * MILLISECOND)));
    let log = log.finish();
    let mut selection = Selection::new(COLUMNS);
    for base in [None, Some(Base::Rate(333.0))] {
        selection.join.base = base;
        let truth = episodes(&log.open(&selection));
        assert!(truth[0].stamps.len() >= 80);
        for threads in [1, 2, 7] {
            assert_eq!(with_threads(threads, || episodes(&log.open(&selection))), truth, "{threads}");
        }
        let small = Selection { memory_budget: 0, ..selection.clone() };
        assert_eq!(episodes(&log.open(&small)), truth);
    }
}

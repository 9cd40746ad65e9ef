//! Recordings that their recorder split into numbered files.

use std::path::{Path, PathBuf};

use fleetfoot_data::{Halo, Silent, Source};
use fleetfoot_log::{Selection, estimate, open};
use fleetfoot_message::write::Float64;
use fleetfoot_output::{McapOptions, McapWriter};

/// Messages of `/x` at 100 Hz, by their numbers, and of another topic.
fn write(path: &Path, rows: std::ops::Range<i64>, other: &str) -> PathBuf {
    let mut writer = McapWriter::create(path, &McapOptions::default()).unwrap();
    let (x, y) = (writer.channel::<Float64>("/x").unwrap(), writer.channel::<Float64>(other).unwrap());
    for row in rows {
        let stamp = 1_700_000_000_000_000_000 + row * 10_000_000;
        for channel in [x, y] {
            writer.write(channel, stamp, stamp, &Float64 { data: row as f64 }).unwrap();
        }
    }
    writer.finish().unwrap();
    path.into()
}

#[test]
fn files_that_go_on_are_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let selection = Selection::new(["/x.data", "/y.data"]);
    // Eleven files, so that the order is that of the numbers; a pause of ten seconds before the last.
    let mut files: Vec<PathBuf> =
        (0..11).map(|part| write(&at(&format!("run_{part}.mcap")), part * 20..(part + 1) * 20, "/y")).collect();
    files.push(write(&at("run_11.mcap"), 1220..1240, "/y"));
    let recording = open(&files, &selection).unwrap();
    let rows: Vec<usize> = recording.episodes().iter().map(|episode| episode.rows).collect();
    assert_eq!(rows, [220, 20]);
    let block = recording.read(0, 0..220, Halo::default()).unwrap();
    assert!(block.column(0).iter().zip(0..).all(|(&value, row)| value == f64::from(row)));
    assert!(
        recording.notes().iter().any(|note| note.contains("11 files, up to run_10.mcap")),
        "{:?}",
        recording.notes()
    );
    assert_eq!(estimate(&files, &selection, &Silent).unwrap().unwrap().rows, 240);
    // The same as one file.
    let whole = write(&at("whole.mcap"), 0..220, "/y");
    assert_eq!(open(&[whole], &selection).unwrap().episodes()[0].id, recording.episodes()[0].id);
    // One of other topics, and one whose number does not follow, stay alone.
    let other = write(&at("run_1.mcap"), 20..40, "/z");
    let alone = Selection::new(["/x.data"]);
    for pair in [[&files[0], &other], [&files[2], &files[4]]] {
        assert_eq!(open(&pair, &alone).unwrap().episodes().len(), 2);
    }
}

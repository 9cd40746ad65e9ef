use std::{
    fs,
    path::{Path, PathBuf},
};

use fleetfoot_data::{ColumnKind, Halo, Silent, Source};

use crate::{Format, Selection, TimeSpec, inspect, inspect_values, open};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/arrays").join(name)
}

fn scrap(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// An array of version 1 with such a head.
fn npy(head: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head.as_bytes());
    bytes.extend(data);
    bytes
}

fn refusal(name: &str, bytes: &[u8]) -> String {
    let (_folder, path) = scrap(name, bytes);
    let message = inspect(&path).unwrap_err().to_string();
    assert!(message.contains(name), "{message}");
    message
}

/// Every number and text of files of numpy and scipy, as these told them.
#[test]
fn every_number_of_arrays() {
    let truth = fs::read_to_string(fixture("truth.jsonl")).unwrap();
    let mut numbers = 0;
    for line in truth.lines() {
        let expected: serde_json::Value = serde_json::from_str(line).unwrap();
        let (name, columns) = (expected["file"].as_str().unwrap(), expected["columns"].as_object().unwrap());
        let names: Vec<&str> = columns.keys().map(String::as_str).collect();
        let listed = inspect(fixture(name)).unwrap();
        let mut columns_read: Vec<&str> = listed
            .columns
            .iter()
            .filter(|column| column.unsupported.is_none())
            .map(|column| column.name.as_str())
            .collect();
        columns_read.sort_unstable();
        assert_eq!(columns_read, names, "{name}");
        let selection = Selection { time: TimeSpec::Uniform { dt_seconds: 1.0 }, ..Selection::new(names) };
        let recording = open(&[fixture(name)], &selection).unwrap();
        let rows = expected["rows"].as_u64().unwrap() as usize;
        let block = recording.read(0, 0..rows, Halo::default()).unwrap();
        for (place, (column, values)) in columns.iter().enumerate() {
            for (row, value) in values.as_array().unwrap().iter().enumerate() {
                let read_value = block.column(place)[row];
                numbers += 1;
                match (value.as_str(), &recording.columns()[place].kind) {
                    (Some(text), ColumnKind::Category(names)) => {
                        assert_eq!(names[read_value as usize], text, "{column}")
                    }
                    (None, _) if value.is_null() => assert!(read_value.is_nan(), "{name}: {column}, row {row}"),
                    _ => assert_eq!(Some(read_value), value.as_f64(), "{name}: {column}, row {row}"),
                }
            }
        }
    }
    assert!(numbers > 2000, "{numbers}");
}

#[test]
fn clocks_kinds_and_omissions() {
    let info = inspect_values(fixture("stored.npz"), &Silent).unwrap();
    assert_eq!((info.format, info.rows), (Format::Npz, Some(40)));
    assert_eq!(info.clock.as_ref().map(|clock| clock.column.as_str()), Some("t"));
    let note = |info: &crate::FileInfo, words: &[&str]| {
        assert!(info.notes.iter().any(|note| words.iter().all(|word| note.contains(word))), "{:?}", info.notes);
    };
    note(&info, &["not have 40 rows", "gain (one value)", "short (5)"]);
    let info = inspect(fixture("packed.mat")).unwrap();
    note(&info, &["not have 40 rows", "mass (1 x 1)", "inertia (3 x 3)", "log.dt (1 x 1)"]);
    note(&info, &["not arrays of numbers", "cells (a cell array)", "log.title (a text)"]);
    let kind = |name: &str| info.columns.iter().find(|column| column.name == name).unwrap().kind.clone();
    assert_eq!(["t", "on", "counts"].map(kind), [ColumnKind::Float, ColumnKind::Boolean, ColumnKind::Integer]);
    let recording = open(&[fixture("packed.mat")], &Selection::new(["log.imu.gyro[2]"])).unwrap();
    assert_eq!((recording.episodes().len(), recording.episodes()[0].rows), (1, 40));
    // Stamps of a type of time.
    let spec = TimeSpec::Column { name: "stamp".into(), unit: None };
    let recording = open(&[fixture("fields.npy")], &Selection { time: spec, ..Selection::new(["t"]) }).unwrap();
    let block = recording.read(0, 0..2, Halo::default()).unwrap();
    assert_eq!(block.stamps(), [1_795_780_800_000_000_000, 1_795_780_800_010_000_000]);
    let message = open(&[fixture("fields.npy")], &Selection::new(["z"])).unwrap_err().to_string();
    assert!(message.contains("`z`") && message.contains("c16"), "{message}");
}

#[test]
fn unreadable_files_are_refused_with_a_remedy() {
    let message = refusal("a.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64");
    assert!(message.contains("-v7") && message.contains("h5py") && message.contains("ff.open"), "{message}");
    assert!(refusal("a.mat", &fs::read(fixture("old.mat")).unwrap()).contains("not MATLAB (.mat)"));
    assert!(refusal("a.npz", b"\x93NUMPY\x01\x00").contains("extension .npy"));
    assert!(
        refusal("a.npy", &npy("{'descr': '|O', 'fortran_order': False, 'shape': (3,), }", b"")).contains("objects")
    );
    assert!(
        refusal("a.npy", &npy("{'descr': '<f8', 'fortran_order': False, 'shape': (), }", &[0; 8]))
            .contains("one value")
    );
    assert!(refusal("a.npy", &npy("{'descr': '<f8', 'shape': (", &[0; 8])).contains("cannot be understood"));
    let deep = format!("{{'descr': {}", "[".repeat(5000));
    assert!(refusal("a.npy", &npy(&deep, &[0; 8])).contains("cannot be understood"));
    let wide = "{'descr': '<f8', 'fortran_order': False, 'shape': (3, 9000000000), }";
    assert!(refusal("a.npy", &npy(wide, &[0; 64])).contains("a.npy"));
    let huge = "{'descr': '<f8', 'fortran_order': True, 'shape': (9000000000, 9000000000), }";
    assert!(refusal("a.npy", &npy(huge, &[0; 64])).contains("a.npy"));
}

#[test]
fn arrays_beside_logs_are_no_rows_of_a_folder() {
    let (folder, path) = scrap("model.npz", &fs::read(fixture("stored.npz")).unwrap());
    assert_eq!(crate::paths([folder.path()]).unwrap(), std::slice::from_ref(&path));
    let log = folder.path().join("run.csv");
    fs::write(&log, "t,x\n0,1\n").unwrap();
    assert_eq!(crate::paths([folder.path()]).unwrap(), std::slice::from_ref(&log));
    assert_eq!(crate::paths([&path, &log]).unwrap(), [path.clone(), log.clone()]);
}

#[test]
fn damage_is_reported_and_the_rest_is_read() {
    let whole = fs::read(fixture("plain.npy")).unwrap();
    let (_folder, path) = scrap("a.npy", &whole[..whole.len() - 30]);
    let info = inspect(&path).unwrap();
    assert_eq!(info.rows, Some(38));
    assert!(info.notes[0].contains("38 of 40 rows"), "{:?}", info.notes);
    // A changed byte of a file in an archive is found by its checksum.
    for name in ["stored.npz", "deflated.npz"] {
        let mut bytes = fs::read(fixture(name)).unwrap();
        let place = memchr::memmem::find(&bytes, b"v.npy").unwrap() + 200;
        bytes[place] ^= 0x10;
        let (_folder, path) = scrap("a.npz", &bytes);
        let info = inspect(&path).unwrap();
        assert!(info.notes.iter().any(|note| note.contains("damaged: v")), "{name}: {:?}", info.notes);
        assert!(info.columns.iter().any(|column| column.name == "t"));
        assert!(refusal("a.npz", &bytes[..bytes.len() - 30]).contains("list of files"), "{name}");
    }
    let mut bytes = fs::read(fixture("packed.mat")).unwrap();
    let end = bytes.len();
    bytes.truncate(end - 20);
    let (_folder, path) = scrap("a.mat", &bytes);
    let info = inspect(&path).unwrap();
    assert!(info.notes.iter().any(|note| note.contains("cut or damaged at byte")), "{:?}", info.notes);
}

#[test]
fn formats_that_python_reads_are_named() {
    for (name, package) in
        [("run.h5", "h5py"), ("run.HDF5", "h5py"), ("run.feather", "pyarrow"), ("run.arrow", "pyarrow")]
    {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, b"any").unwrap();
        for message in [
            crate::inspect(&path).unwrap_err().to_string(),
            crate::paths([path.clone()]).unwrap_err().to_string(),
            crate::open(&[&path], &Selection::default()).unwrap_err().to_string(),
        ] {
            let mend = format!("is read in Python alone, as ff.open(\"{name}\") with {package}");
            assert!(message.contains(&mend) && message.contains("CSV"), "{message}");
        }
    }
}

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::{Database, Table, Value};
use crate::Compression;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// Row ids, times and lengths of the data of all messages.
fn rows(path: &Path) -> Vec<(i64, i64, usize)> {
    let database = Database::open(path, Compression::None).unwrap();
    let table = Table::of(&database, "messages").unwrap();
    let leaves = table.leaves(&database);
    assert!(leaves.damaged.is_empty());
    let [time, data] = ["timestamp", "data"].map(|name| table.column(name).unwrap());
    let rows = leaves.pages.iter().flat_map(|&page| table.rows(&database, page)).map(|row| {
        let row = row.unwrap();
        let Some(Value::Blob(bytes)) = row.value(data) else { panic!("no bytes") };
        (row.id, row.integers([time]).unwrap()[0], bytes.len())
    });
    rows.collect()
}

#[test]
fn rows_keep_order_and_overflow_bytes() {
    let rows = rows(&fixture("plain.db3"));
    assert_eq!(rows.len(), 72);
    assert!(rows.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 <= pair[1].1));
    // One name of 21,000 characters goes over six pages.
    assert_eq!(rows.iter().filter(|row| row.2 > 20_000).count(), 1);
}

#[test]
fn only_committed_wal_pages_count() {
    let rows = rows(&fixture("ahead.db3"));
    assert_eq!(rows.len(), 144);
    assert!(rows.iter().all(|row| row.1 > 7));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db3");
    fs::copy(fixture("ahead.db3"), &path).unwrap();
    let log = fs::read(fixture("ahead.db3-wal")).unwrap();
    let beside = folder.path().join("a.db3-wal");
    // Without the log, with one of another database, with one whose first frame is torn: the file as it is.
    let torn: Vec<u8> = log.iter().enumerate().map(|(at, &byte)| if at == 100 { byte ^ 1 } else { byte }).collect();
    for bytes in [None, Some(&log[..40]), Some(&torn[..])] {
        let _ = fs::remove_file(&beside);
        if let Some(bytes) = bytes {
            fs::write(&beside, bytes).unwrap();
        }
        assert_eq!(self::rows(&path).len(), 72);
    }
}

#[test]
fn missing_columns_of_a_row_are_null() {
    let database = Database::open(&fixture("plain.db3"), Compression::None).unwrap();
    let table = Table::of(&database, "TOPICS").unwrap();
    let row = table.rows(&database, table.leaves(&database).pages[0]).next().unwrap().unwrap();
    assert_eq!(row.value(99), Some(Value::Null));
    assert_eq!(table.integer(&row, table.column("id").unwrap()), Some(row.id));
    assert_eq!(row.value(table.column("name").unwrap()), Some(Value::Text("/imu".to_owned())));
    assert_eq!(Table::of(&database, "nothing"), None);
}

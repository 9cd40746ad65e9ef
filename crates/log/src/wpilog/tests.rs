use std::{
    fs,
    path::{Path, PathBuf},
};

use fleetfoot_data::Silent;

use super::WpilogContainer;
use crate::{Compression, Messages, container::Container, inspect, metadata};

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/robot.wpilog")
}

/// A file of records with one byte of entry, four of size and eight of time.
fn file(records: &[(u8, u64, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = b"WPILOG\x00\x01\x00\x00\x00\x00".to_vec();
    for (entry, time, payload) in records {
        bytes.extend([0x7c, *entry]);
        bytes.extend((payload.len() as u32).to_le_bytes());
        bytes.extend(time.to_le_bytes());
        bytes.extend(payload);
    }
    bytes
}

fn start(entry: u32, name: &str, kind: &str) -> Vec<u8> {
    let mut payload = vec![0];
    payload.extend(entry.to_le_bytes());
    for text in [name, kind, ""] {
        payload.extend((text.len() as u32).to_le_bytes());
        payload.extend(text.as_bytes());
    }
    payload
}

fn opened(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wpilog");
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

#[test]
fn topics_are_entries_with_values() {
    let log = WpilogContainer::open(&fixture(), Compression::None, &Silent).unwrap();
    let topics: Vec<(&str, u64)> =
        log.topics().iter().map(|topic| (topic.name.as_str(), topic.count.unwrap())).collect();
    let expected = [
        ("/DS:enabled", 6),
        ("/NT:/SmartDashboard/count", 60),
        ("/NT:/pose", 60),
        ("/camera", 6),
        ("/drive/current", 60),
        ("/drive/speed", 60),
        ("/limits", 60),
        ("/mode", 6),
        ("/modules", 60),
        ("/names", 6),
        ("/ticks", 60),
        ("/wheels", 60),
        ("/wheels/temperature", 60),
    ];
    assert_eq!(topics, expected);
    assert!(log.damage().is_empty(), "{}", log.damage());
    let camera = log.topic("/camera").unwrap_err().to_string();
    assert!(camera.contains("type `raw`") && camera.contains("not read"), "{camera}");
    let pairs = metadata(fixture()).unwrap();
    let expected = [("header", "written by robotpy-wpiutil"), ("metadata /drive/speed", "{\"source\": \"test\"}")];
    assert_eq!(pairs, expected.map(|(key, value)| (key.to_owned(), value.to_owned())).into());
}

#[test]
fn json_restarts_and_two_types() {
    let value = |number: f64| number.to_le_bytes().to_vec();
    let bytes = file(&[
        (0, 1, start(1, "a", "double")),
        (1, 2, value(1.5)),
        (0, 3, vec![1, 1, 0, 0, 0]),
        // The number goes on with another entry, and the name under another number.
        (0, 4, start(1, "state", "json")),
        (0, 5, start(2, "a", "double")),
        (1, 6, b"{\"x\": 3}".to_vec()),
        (2, 7, value(2.5)),
        (0, 8, start(3, "b", "double")),
        (0, 9, start(4, "/b", "float")),
        (3, 10, value(0.0)),
        (0, 11, start(5, "s", "struct:Gone")),
        (5, 12, value(0.0)),
    ]);
    let (_folder, path) = opened(&bytes);
    let log = Messages::open(&path).unwrap();
    let read = |topic: &str, field: &str| log.columns(topic, Some(&[field.to_owned()]), &Silent).unwrap();
    assert_eq!(
        (read("/a", "value").fields[0].values.clone(), read("/a", "value").log_time),
        (vec![1.5, 2.5], vec![2000, 7000])
    );
    assert_eq!(read("/state", "x").fields[0].values, [3.0]);
    let info = inspect(&path).unwrap();
    let problem = |name: &str| info.topics.iter().find(|topic| topic.name == name).unwrap().problem.clone().unwrap();
    assert!(problem("/b").contains("two types, `double` and `float`"), "{}", problem("/b"));
    assert!(problem("/s").contains("schema of `struct:Gone` is not in the file"), "{}", problem("/s"));
}

#[test]
fn damage_is_counted_and_the_rest_is_read() {
    let bytes = fs::read(fixture()).unwrap();
    let total = |path: &Path| {
        let log = WpilogContainer::open(path, Compression::None, &Silent).unwrap();
        let messages: u64 = (0..log.pieces()).filter_map(|piece| log.messages(piece)).sum();
        (messages, log.damage().to_string())
    };
    let (_folder, path) = opened(&bytes);
    let (whole, _) = total(&path);
    fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    let (messages, damage) = total(&path);
    assert_eq!(messages, whole - 1);
    assert!(damage.contains("the file ends inside a record"), "{damage}");
    // Inside a record.
    let middle = bytes.len() * 3 / 4 + 3;
    fs::write(&path, [&bytes[..middle], &[0xff; 100], &bytes[middle..]].concat()).unwrap();
    let (messages, damage) = total(&path);
    assert!((whole - 3..whole).contains(&messages) && damage.contains("damaged"), "{messages} of {whole}: {damage}");
    fs::write(&path, b"WPILOG\x00\x02").unwrap();
    let message = inspect(&path).unwrap_err().to_string();
    assert!(message.contains("version 2.0") && message.contains("a.wpilog"), "{message}");
    fs::write(&path, b"WPILOG\x00\x01\xff\xff\xff\xff").unwrap();
    assert!(total(&path).1.contains("inside its header"));
}

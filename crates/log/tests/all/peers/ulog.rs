//! ULog files compared with pyulog: every number of every message, and the file's metadata.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use fleetfoot_data::{ColumnKind, Silent};
use fleetfoot_log::{Messages, metadata};

use super::{
    hold::{Held, hold},
    oracle::{PeerLog, read_lines, run},
};
use crate::{outside, ulog_writer::flight};

/// Report of pyulog on a file: its topics and its metadata.
fn read_peer(python: &std::ffi::OsStr, path: &Path) -> (PeerLog, serde_json::Value) {
    let text = run(python, "read_ulogs.py", &[path.as_os_str()]);
    let (lines, about) = text.trim_end().rsplit_once('\n').unwrap();
    let about: serde_json::Value = serde_json::from_str(about).unwrap();
    let mut peer: BTreeMap<String, PeerLog> = read_lines(lines);
    (peer.pop_first().unwrap().1, about["about"].clone())
}

/// The number of a text that metadata holds is that of Python, both rounded to four bytes where they are parameters.
fn same(text: &str, number: &serde_json::Value) -> bool {
    if let Some(word) = number.as_str() {
        return text.eq_ignore_ascii_case(word);
    }
    text.parse::<f64>().is_ok_and(|value_read| number.as_f64().is_some_and(|other| value_read as f32 == other as f32))
}

/// Compares parameters, changes, defaults and information; answers how many values were compared.
fn hold_about(path: &Path, about: &serde_json::Value) -> usize {
    let pairs = metadata(path).unwrap();
    let mut compared = 0;
    for (section, prefix) in [("parameters", "parameter."), ("system", "default.system."), ("setup", "default.setup.")]
    {
        let theirs = about[section].as_object().unwrap();
        for (name, value) in theirs {
            let value_read = &pairs[&format!("{prefix}{name}")];
            assert!(same(value_read, value), "{prefix}{name}: {value_read} instead of {value}");
        }
        assert_eq!(pairs.keys().filter(|key| key.starts_with(prefix)).count(), theirs.len(), "{prefix}");
        compared += theirs.len();
    }
    let mut changes: BTreeMap<&str, Vec<(f64, &serde_json::Value)>> = BTreeMap::new();
    for change in about["changed"].as_array().unwrap() {
        changes.entry(change[1].as_str().unwrap()).or_default().push((change[0].as_f64().unwrap(), &change[2]));
        compared += 1;
    }
    for (name, theirs) in &changes {
        let value_read: Vec<&str> = pairs[&format!("changed.{name}")].split("; ").collect();
        assert_eq!(value_read.len(), theirs.len(), "{name}");
        for (value_read, (time, value)) in value_read.iter().zip(theirs) {
            let (number, when) =
                value_read.strip_suffix(" s").and_then(|value_read| value_read.split_once(" from ")).unwrap();
            assert!(same(number, value), "{name}: {value_read} instead of {value}");
            assert!((when.parse::<f64>().unwrap() - time).abs() < 1e-9, "{name}: {value_read} instead of {time}");
        }
    }
    for (name, value) in about["info"].as_object().unwrap() {
        match value.as_str() {
            Some(text) => assert_eq!(pairs[name], text.trim_end_matches('\0'), "{name}"),
            None => assert!(same(&pairs[name], value), "{name}: {} instead of {value}", pairs[name]),
        }
        compared += 1;
    }
    for (name, values) in about["multiple"].as_object().unwrap() {
        let texts: Vec<String> = values.as_array().unwrap().iter().map(joined).collect();
        if !texts.is_empty() {
            assert_eq!(pairs[name].replace('\0', ""), texts.join("\n").replace('\0', ""), "{name}");
            compared += 1;
        }
    }
    compared
}

/// The parts of a text.
fn joined(parts: &serde_json::Value) -> String {
    parts.as_array().unwrap().iter().map(|part| part.as_str().unwrap()).collect()
}

/// Compares the logged texts.
fn hold_texts(path: &Path, about: &serde_json::Value) -> usize {
    let theirs: Vec<&str> = about["texts"].as_array().unwrap().iter().map(|text| text.as_str().unwrap()).collect();
    if theirs.is_empty() {
        return 0;
    }
    let read =
        Messages::open(path).unwrap().columns("/logged_messages", Some(&["message".to_owned()]), &Silent).unwrap();
    let ColumnKind::Category(names) = &read.fields[0].kind else { panic!("{:?}", read.fields[0].kind) };
    let mut texts_read: Vec<&str> = read.fields[0].values.iter().map(|&code| names[code as usize].as_str()).collect();
    texts_read.sort_unstable();
    assert_eq!(texts_read, theirs, "{}", path.display());
    texts_read.len()
}

fn hold_file(python: &std::ffi::OsStr, path: &Path) -> Held {
    let (peer, about) = read_peer(python, path);
    let held = hold(path, &peer.topics, false);
    let (values, texts) = (hold_about(path, &about), hold_texts(path, &about));
    let Held { topics, messages, numbers, .. } = held;
    eprintln!(
        "{}: {topics} topics, {messages} messages, {numbers} numbers, {values} values of metadata, {texts} texts",
        path.display()
    );
    assert_eq!(held.differences, [""; 0]);
    assert_eq!(held.refused, BTreeMap::new());
    assert!(values > 0);
    held
}

#[test]
fn every_number_of_written_ulogs() {
    let Some(python) = outside::python("pyulog, numpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.ulg");
    fs::write(&path, flight(300).bytes).unwrap();
    let held = hold_file(&python, &path);
    // Gyroscopes: 7 fields; engine: 11; mode: 3; logged texts: 2 and 3.
    assert_eq!((held.topics, held.messages), (6, 300 + 300 + 60 + 30 + 1 + 12));
    assert_eq!(held.numbers, 600 * 7 + 60 * 11 + 30 * 3 + 2 + 12 * 3);
}

#[test]
fn every_number_of_real_ulogs() {
    let (Some(python), Some(folder)) = (outside::python("pyulog, numpy"), outside::data("ulog")) else { return };
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "ulg"));
    paths.sort();
    let mut all = Held::default();
    paths.iter().for_each(|path| all.add(hold_file(&python, path)));
    assert!(
        all.numbers > 1_000_000 && all.missing < all.numbers / 2,
        "{} numbers, {} missing",
        all.numbers,
        all.missing
    );
}

//! Logs of other people's writers, and of real robots, held against other people's decoders: every number of every message.
//!
//! `outside.rs` tells where the peers' Python and the real logs are looked for.

mod arrays;
mod dataflash;
mod hold;
mod oracle;
mod rosbags;
mod ulog;
mod wpilog;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use fleetfoot_data::{Silent, Source};
use fleetfoot_log::{Messages, Selection, open};
use hold::{Held, hold};
use oracle::{PeerLog, python, read_logs, truth, write_logs};

use crate::outside::data;

/// The MCAP files directly in a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| name(path).ends_with(".mcap") || name(path).ends_with(".mcap.zstd"));
    files.sort();
    files
}

fn file_name(path: &Path) -> &str {
    path.file_name().unwrap().to_str().unwrap()
}

fn log_of<'a>(all: &'a BTreeMap<String, PeerLog>, path: &Path) -> &'a PeerLog {
    all.get(file_name(path)).unwrap_or_else(|| panic!("the decoders tell nothing of {}", path.display()))
}

#[test]
fn every_number_of_the_logs_of_other_writers() {
    let Some(python) = python() else { return };
    let folder = write_logs(&python);
    let all = files(folder.path());
    let peer_logs = read_logs(&python, &all, false);
    let (mut held, mut by_truth) = (Held::default(), 0);
    for path in all.iter().filter(|path| file_name(path) != "odd_channels.mcap") {
        let damaged = ["truncated", "corrupt"].iter().any(|word| file_name(path).starts_with(word));
        let of_file = match truth(path) {
            Some(truth) => {
                by_truth += 1;
                hold(path, &truth, damaged)
            }
            None => {
                let peer = log_of(&peer_logs, path);
                assert_eq!(peer.damage, None, "{}", path.display());
                hold(path, &peer.topics, false)
            }
        };
        if file_name(path).starts_with("idl_mutable") {
            let message = of_file.refused.get("/assembly").or(of_file.differences.first()).unwrap();
            assert!(message.contains("/assembly") && message.contains("@mutable"), "{message}");
            continue;
        }
        assert_eq!(of_file.refused, BTreeMap::new(), "{}", path.display());
        assert!(of_file.numbers > 100 || !of_file.differences.is_empty(), "{}: {of_file:?}", path.display());
        held.add(of_file);
    }
    let Held { messages, numbers, missing, .. } = held;
    eprintln!(
        "{} files, {by_truth} by their writer's truth: {messages} messages, {numbers} numbers, {missing} missing",
        all.len()
    );
    assert_eq!(held.differences, [""; 0]);
    assert!(all.len() > 50 && by_truth > 15 && held.numbers > 400_000, "{} {by_truth} {held:?}", all.len());
}

#[test]
fn damage_is_reported() {
    let Some(python) = python() else { return };
    let folder = write_logs(&python);
    for path in files(folder.path()) {
        let info = fleetfoot_log::inspect_values(&path, &Silent).unwrap();
        let damaged = ["truncated", "corrupt"].iter().any(|word| file_name(&path).starts_with(word));
        let tells = info.notes.iter().any(|note| note.contains("damaged") && note.contains("lost"));
        assert_eq!(tells, damaged, "{}: {:?}", path.display(), info.notes);
    }
}

#[test]
fn elements_of_long_arrays_are_read_when_named() {
    let Some(python) = python() else { return };
    let folder = write_logs(&python);
    let path = folder.path().join("ros2_zstd.mcap");
    let peer_logs = read_logs(&python, std::slice::from_ref(&path), true);
    let peer = log_of(&peer_logs, &path);
    let camera = peer.topics.iter().find(|topic| topic.name == "/camera").unwrap();
    let pixels = camera.columns.iter().filter(|(name, _)| name.starts_with("data[")).count();
    assert_eq!(pixels, 10_000);
    let held = hold(&path, &peer.topics, false);
    assert_eq!(held.differences, [""; 0]);
    assert!(held.numbers > pixels * camera.messages, "{held:?}");
}

#[test]
fn unreadable_topics_are_refused_and_the_rest_is_read() {
    let Some(python) = python() else { return };
    let folder = write_logs(&python);
    let path = folder.path().join("odd_channels.mcap");
    let peer_logs = read_logs(&python, std::slice::from_ref(&path), false);
    let held = hold(&path, &log_of(&peer_logs, &path).topics, false);
    assert_eq!(held.differences, [""; 0]);
    let expected = [
        ("/no_schema", &["cdr", "schema"][..]),
        ("/unknown_encoding", &["cbor"]),
        ("/unknown_schema", &["omgidl3"]),
        ("/broken_schema", &["ros2msg", "]"]),
        ("/missing_type", &["nowhere_msgs/", "Lost"]),
    ];
    for (topic, words) in expected {
        let message = &held.refused[topic];
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
        assert!(message.contains(topic) && message.contains("odd_channels.mcap"), "{message}");
    }
    assert_eq!(held.refused.len(), expected.len(), "{:?}", held.refused);
    assert_eq!(held.topics, 3, "the sound one, the empty one and the one of which every second message ends early");
    let listed = Messages::open(&path).unwrap().topics().unwrap();
    for topic in listed {
        let sound = ["/imu", "/empty"].contains(&topic.name.as_str());
        assert_eq!(topic.problem.is_none(), sound, "{topic:?}");
    }
    // As columns of a recording, too.
    for (topic, words) in expected {
        let message = open(&[&path], &Selection::new([format!("{topic}.angular_velocity.x")])).unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)) && message.contains(topic), "{message}");
    }
    let message = open(&[&path], &Selection::new(["/empty.angular_velocity.x"])).unwrap_err().to_string();
    assert!(message.contains("/empty") && message.contains("no messages"), "{message}");
}

#[test]
fn metadata_orders_files_of_a_recording() {
    let Some(python) = python() else { return };
    let folder = write_logs(&python);
    for bag in ["split_bag", "compressed_bag"] {
        let bag = folder.path().join(bag);
        let parts = files(&bag);
        assert_eq!(parts.len(), 3);
        let peer_logs = read_logs(&python, &parts, false);
        // The order of the parts is that of their messages, which is not that of the alphabet.
        let mut parts: Vec<&PeerLog> = peer_logs.values().collect();
        parts.sort_by_key(|part| part.topics.iter().flat_map(|topic| topic.log_time.first()).min().copied());
        let mut whole: Vec<oracle::Topic> = Vec::new();
        for topic in parts.iter().flat_map(|part| &part.topics) {
            if !whole.iter().any(|topic_there| topic_there.name == topic.name) {
                let columns = topic.columns.iter().map(|(name, _)| (name.clone(), Vec::new())).collect();
                whole.push(oracle::Topic { name: topic.name.clone(), columns, ..oracle::Topic::default() });
            }
            let topic_there = whole.iter_mut().find(|topic_there| topic_there.name == topic.name).unwrap();
            topic_there.messages += topic.messages;
            topic_there.log_time.extend(&topic.log_time);
            topic_there.publish_time.extend(&topic.publish_time);
            for ((name, all), (part_name, part)) in topic_there.columns.iter_mut().zip(&topic.columns) {
                assert_eq!(name, part_name);
                all.extend(part);
            }
        }
        let held = hold(&bag, &whole, false);
        assert_eq!(held.differences, [""; 0]);
        assert_eq!((held.topics, held.messages), (2, 6 * (50 + 20)));
        let recording = open(&[&bag], &Selection::new(["/imu.angular_velocity.z"])).unwrap();
        assert_eq!(recording.episodes().len(), 1, "a joint begins no episode");
    }
}

/// The real logs, where there are any.
fn real_logs() -> Option<Vec<PathBuf>> {
    data("mcap").map(|folder| files(&folder))
}

#[test]
fn every_number_of_real_logs() {
    let (Some(python), Some(paths)) = (python(), real_logs()) else { return };
    assert!(!paths.is_empty());
    let peer_logs = read_logs(&python, &paths, false);
    let mut held = Held::default();
    for path in &paths {
        let peer = log_of(&peer_logs, path);
        assert_eq!(peer.damage, None, "{}", path.display());
        let of_file = hold(path, &peer.topics, false);
        let expected: &[(&str, &str)] = match file_name(path) {
            "only_services.mcap" => &[("/add_two_ints/_service_event", "AddTwoInts_Event` is missing")],
            "topics_and_services.mcap" => &[
                ("/add_two_ints/_service_event", "AddTwoInts_Event` is missing"),
                ("/add_two_ints2/_service_event", "AddTwoInts_Event` is missing"),
            ],
            "wrong_rmw_test_0.mcap" => &[("/array_topic", "wrong_format"), ("/test_topic", "wrong_format")],
            _ => &[],
        };
        let refused: Vec<&str> = of_file.refused.keys().map(String::as_str).collect();
        assert_eq!(refused, expected.iter().map(|(topic, _)| *topic).collect::<Vec<_>>(), "{}", path.display());
        for ((_, message), (topic, word)) in of_file.refused.iter().zip(expected) {
            assert!(message.contains(word) && message.contains(topic), "{message}");
            assert!(message.contains(file_name(path)), "{message}");
        }
        eprintln!("{}: {} messages, {} numbers equal", file_name(path), of_file.messages, of_file.numbers);
        held.add(of_file);
    }
    assert_eq!(held.differences, [""; 0]);
    assert!(held.numbers > 0);
}

//! ROS 1 bags and databases of rosbag2, held against the package rosbags.

use std::{
    ffi::{OsStr, OsString},
    fs,
    io::Read,
    path::{Path, PathBuf},
};

use fleetfoot_data::Silent;
use fleetfoot_log::Messages;

use super::{
    hold::hold,
    oracle::{PeerLog, read_lines, run},
};
use crate::outside::data;

fn python() -> Option<OsString> {
    crate::outside::python("rosbags.highlevel, numpy")
}

fn read(python: &OsStr, path: &Path) -> PeerLog {
    let lines = run(python, "read_rosbags.py", &[path.as_os_str()]);
    read_lines(&lines).into_values().next().unwrap_or_default()
}

#[test]
fn every_number_of_the_recordings_of_another_writer() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    run(&python, "write_rosbags.py", &[folder.path().as_os_str()]);
    let kinds =
        ["ros1_none.bag", "ros1_bz2.bag", "ros1_lz4.bag", "ros2_none", "ros2_file", "ros2_message", "ros2_split"];
    for name in kinds.into_iter().chain(["wal/wal.db3"]) {
        let path = folder.path().join(name);
        let peer_read = read(&python, &path);
        let held = hold(&path, &peer_read.topics, false);
        assert_eq!(held.differences, [""; 0], "{name}");
        let rows = if name.starts_with("wal") { 9600 } else { 4800 };
        assert_eq!((held.topics, held.messages), (2, rows), "{name}: {:?}", held.refused);
        assert!(held.numbers > 150_000, "{name}: {}", held.numbers);
    }
    // The files of the split recording by themselves: each goes on where the other ended.
    let files: Vec<PathBuf> = (0..2).map(|k| folder.path().join(format!("ros2_split/ros2_split_{k}.db3"))).collect();
    fs::remove_file(folder.path().join("ros2_split/metadata.yaml")).unwrap();
    let recording = fleetfoot_log::open(&files, &fleetfoot_log::Selection::new(["/imu.angular_velocity.x"])).unwrap();
    assert_eq!(fleetfoot_data::Source::episodes(&recording).len(), 1);
}

#[test]
fn every_number_of_real_recordings() {
    let (Some(python), Some(bags), Some(databases)) = (python(), data("bag"), data("db3")) else { return };
    for (path, topics, numbers) in
        [(bags.join("ekf_test2.bag"), 2, 390_000), (databases.join("all_types.db3"), 94, 1_000)]
    {
        let held = hold(&path, &read(&python, &path).topics, false);
        eprintln!("{}: {} topics, {} messages, {} numbers", path.display(), held.topics, held.messages, held.numbers);
        assert_eq!(held.differences, [""; 0]);
        assert_eq!(held.topics, topics, "{:?}", held.refused);
        assert!(held.numbers > numbers, "{}", held.numbers);
    }
}

/// The log of a paper: types of a package of its own, beside a text with the same numbers.
#[test]
fn types_are_read_from_adjacent_definitions() {
    let Some(databases) = data("db3") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robomaster.db3");
    fs::copy(databases.join("robomaster.db3"), &path).unwrap();
    let log = Messages::open(&path).unwrap();
    let state = |log: &Messages| {
        let topics = log.topics().unwrap();
        topics.into_iter().find(|topic| topic.name == "/robomaster_0/current_state").unwrap()
    };
    let problem = state(&log).problem.unwrap();
    for word in ["freyja_msgs/msg/CurrentState", "CurrentState.msg", "beside the recording", "AMENT_PREFIX_PATH"] {
        assert!(problem.contains(word), "{problem}");
    }
    let definitions = folder.path().join("freyja_msgs/msg");
    fs::create_dir_all(&definitions).unwrap();
    let text = "std_msgs/Header header\nfloat64[13] state_vector\nuint8 state_valid\n";
    fs::write(definitions.join("CurrentState.msg"), text).unwrap();
    let log = Messages::open(&path).unwrap();
    assert_eq!(state(&log).problem, None);
    let fields: Vec<String> = (0..13).map(|k| format!("state_vector[{k}]")).collect();
    let fields: Vec<&str> =
        ["header.stamp.sec", "header.stamp.nanosec"].into_iter().chain(fields.iter().map(String::as_str)).collect();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let failed = log.read("/robomaster_0/current_state", &fields, &Silent, |row| {
        rows.push(row.values.to_vec());
        Ok(())
    });
    assert_eq!((failed.unwrap(), rows.len()), (0, 8972));
    let mut text = String::new();
    let file = fs::File::open(databases.join("robomaster_current_state.csv.gz")).unwrap();
    flate2::read::GzDecoder::new(file).read_to_string(&mut text).unwrap();
    let number = |text: &str| text.trim().parse::<f64>().unwrap();
    for (line, row) in text.lines().skip(1).zip(&rows) {
        let (_, rest) = line.split_once("'secs': ").unwrap();
        let (seconds, rest) = rest.split_once(", 'nsecs': ").unwrap();
        let (nanoseconds, rest) = rest.split_once('}').unwrap();
        let (_, rest) = rest.split_once('[').unwrap();
        let vector = rest.split_once(']').unwrap().0.split(',').map(number);
        let expected: Vec<f64> = [number(seconds), number(nanoseconds)].into_iter().chain(vector).collect();
        assert_eq!(row, &expected);
    }
    assert_eq!(text.lines().count(), 1 + rows.len());
}

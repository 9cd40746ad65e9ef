//! Refusals: one clear message for each kind of unreadable log.

use fleetfoot_log::{Base, Messages, Selection, inspect, open};
use fleetfoot_message::write::{Float64, JointState};

use super::logs::{Log, copy, usual};

fn holds(message: &str, parts: &[&str]) {
    assert!(parts.iter().all(|part| message.contains(part)), "{parts:?}: {message}");
}

#[test]
fn missing_names_are_reported_with_the_nearest() {
    let mut log = Log::new();
    log.drive(|_, at| Some((at, at)));
    log.announce::<Float64>("/quiet");
    log.announce::<JointState<'_>>("/quiet_joints");
    let log = log.finish();
    let refusal = |column: &str| log.refusal(&Selection::new(["/odom.twist.twist.linear.x", column]));
    holds(&refusal("/odm.twist.twist.linear.x"), &["/odm.twist", "`/odom`"]);
    holds(&refusal("/odom.twist.twist.linaer.x"), &["/odom", "linaer", "linear"]);
    holds(&refusal("/odom.twist.twist.linear.x.y"), &["/odom", "linear.x"]);
    holds(&refusal("/odom.twist.twist"), &["/odom", "twist.twist"]);
    holds(&refusal("/odom.twist.covariance[36]"), &["/odom", "covariance", "36"]);
    holds(&refusal("/odom.twist..x"), &["/odom.twist..x", "/topic.field"]);
    holds(&refusal("/odom"), &["/odom", "/topic.field"]);
    holds(&refusal("odom.twist"), &["odom.twist", "/odom"]);
    holds(&refusal("/quiet.data"), &["/quiet", "no messages"]);
    holds(&refusal("/quiet_joints.position[left]"), &["/quiet_joints"]);
    let mut selection = Selection::new(["/odom.twist.twist.linear.x"]);
    selection.join.base = Some(Base::Channel("/forse".into()));
    holds(&log.refusal(&selection), &["/forse", "/force"]);
    for hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e12] {
        selection.join.base = Some(Base::Rate(hz));
        let message = open(&[&log.path], &selection).unwrap_err().to_string();
        holds(&message, &["rate", "rows a second"]);
    }
    selection.join.base = None;
    for window in [-1.0, f64::NAN, 1e9] {
        selection.join.reorder_seconds = window;
        holds(&open(&[&log.path], &selection).unwrap_err().to_string(), &["reordering window"]);
    }
    let quiet = Messages::open(&log.path).unwrap();
    assert_eq!(quiet.read("/quiet", &["data"], &fleetfoot_data::Silent, |_| panic!("no message")).unwrap(), 0);
}

#[test]
fn request_without_columns_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut writer = fleetfoot_output::McapWriter::create(&path, &fleetfoot_output::McapOptions::default()).unwrap();
    let channel = writer.channel::<Float64>("/x").unwrap();
    writer.write(channel, 1, 1, &Float64 { data: 1.0 }).unwrap();
    writer.finish().unwrap();
    for base in [None, Some(Base::Rate(10.0))] {
        let mut selection = Selection::default();
        selection.join.base = base;
        holds(
            &open(&[&path], &selection).unwrap_err().to_string(),
            &["run.mcap", "without a named column", "info --values"],
        );
    }
}

#[test]
fn mislabelled_files_are_refused() {
    let log = usual();
    let at = |name: &str| log.folder.path().join(name);
    for name in ["run.csv", "run.parquet", "run.csv.gz"] {
        copy(&log.path, &at(name));
        let message = open(&[at(name)], &Selection::new(["/odom.twist.twist.linear.x"])).unwrap_err().to_string();
        holds(&message, &[name]);
        assert!(inspect(at(name)).is_err());
    }
    std::fs::write(at("table.mcap"), "t,x\n0,1\n1,2\n").unwrap();
    std::fs::write(at("empty.mcap"), "").unwrap();
    for name in ["table.mcap", "empty.mcap"] {
        let message = open(&[at(name)], &Selection::new(["x"])).unwrap_err().to_string();
        holds(&message, &[name, if name == "empty.mcap" { "is empty" } else { "MCAP" }]);
        holds(&inspect(at(name)).unwrap_err().to_string(), &[name]);
        assert!(Messages::open(at(name)).is_err());
    }
    for (name, word) in [("run.bag", "SQLite"), ("run.db3", "ROS 1 bag")] {
        let bytes: &[u8] = if name == "run.bag" { b"SQLite format 3\0" } else { b"#ROSBAG V2.0\n" };
        std::fs::write(at(name), bytes).unwrap();
        let message = open(&[at(name)], &Selection::new(["x"])).unwrap_err().to_string();
        holds(&message, &[name, word]);
    }
}

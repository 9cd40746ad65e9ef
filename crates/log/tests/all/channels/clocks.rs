//! One clock for all channels, and where episodes begin and end.

use std::fs;

use fleetfoot_data::{Halo, Source};
use fleetfoot_log::{Cache, Error, Selection, Stamp, TimeSpec, TopicClock, open};
use fleetfoot_message::write::Vector3Stamped;
use fleetfoot_output::{McapOptions, McapWriter};

use super::logs::{Log, MILLISECOND, SECOND, START, episodes, near, seconds, stamped, usual, whole};

const BOTH: [&str; 2] = ["/odom.twist.twist.linear.x", "/force.vector.x"];

fn selection(stamp: Option<Stamp>) -> Selection {
    let mut selection = Selection::new(BOTH);
    selection.join.stamp = stamp;
    selection
}

#[test]
fn simulated_headers_and_a_log_of_2026_each_work() {
    let mut log = Log::new();
    log.drive(|_, at| Some((at - START + 10 * SECOND, at + 2 * MILLISECOND)));
    let log = log.finish();
    let by_clock = [None, Some(Stamp::Header), Some(Stamp::Log), Some(Stamp::Publish)]
        .map(|stamp| whole(&log.open(&selection(stamp))));
    assert_eq!(by_clock[0], by_clock[1], "all have headers");
    let starts = [10 * SECOND, START + 2 * MILLISECOND, START + MILLISECOND];
    for (rows, start) in by_clock[1..].iter().zip(starts) {
        assert_eq!(rows.stamps.len(), 80);
        for (row, &stamp) in rows.stamps.iter().enumerate() {
            assert_eq!(stamp, start + row as i64 * 50 * MILLISECOND);
            let t = (row as i64 * 50 * MILLISECOND) as f64 / 1e9;
            assert_eq!(rows.columns[0][row], t);
            near(rows.columns[1][row], -4.0 * t);
        }
    }
    let offset = log.open(&selection(None)).log_offset(0);
    assert_eq!(offset, START + 2 * MILLISECOND - 10 * SECOND);
}

#[test]
fn another_clock_than_the_messages_is_refused() {
    let log = usual();
    let column = TimeSpec::Column { name: "/odom.header.stamp.sec".into(), unit: None };
    for time in [column, TimeSpec::Uniform { dt_seconds: 0.1 }] {
        let message = log.refusal(&Selection { time, ..selection(None) });
        assert!(message.contains("has its own clock") && message.contains("stamp ="), "{message}");
    }
}

#[test]
fn a_topic_without_a_header_has_no_header_stamp() {
    let mut log = Log::new();
    log.drive(|_, at| Some((at, at + 2 * MILLISECOND)));
    (0..40).for_each(|k| log.command(START + k * 100 * MILLISECOND, 1.0));
    let log = log.finish();
    let mut selection = Selection::new([BOTH[0], "/cmd_vel.linear.x"]);
    let recording = log.open(&selection);
    assert!(recording.notes().iter().any(|note| note.contains("/cmd_vel has no header")), "{:?}", recording.notes());
    assert_eq!(whole(&recording).stamps[0], START + 2 * MILLISECOND);
    selection.join.stamp = Some(Stamp::Header);
    let message = log.refusal(&selection);
    assert!(message.contains("/cmd_vel") && message.contains("stamp = \"log\""), "{message}");
}

#[test]
fn disjoint_clocks_are_refused_with_ranges() {
    let mut log = Log::new();
    log.drive(|topic, at| Some((if topic == "/odom" { at - START + SECOND } else { at - START + 100 * SECOND }, at)));
    let log = log.finish();
    let message = log.refusal(&selection(None));
    for part in ["/odom", "1 to 4.95 s", "/force", "100 to 103.98 s", "stamp = \"log\""] {
        assert!(message.contains(part), "{part}: {message}");
    }
    assert_eq!(whole(&log.open(&selection(Some(Stamp::Log)))).stamps.len(), 80);
}

/// A topic of another computer, whose clock is 100 s ahead and 1 % fast: its stamps are corrected before anything is joined, in this log alone, and the cache tells corrected rows from others.
#[test]
fn other_clocks_are_corrected_before_joining() {
    let mut log = Log::new();
    let fast = |at: i64| (at - START) + (at - START) / 100 + 100 * SECOND;
    log.drive(|topic, at| Some((if topic == "/odom" { at - START + SECOND } else { fast(at) + SECOND }, at)));
    let log = log.finish();
    let mut selection = selection(None);
    let folder = tempfile::tempdir().unwrap();
    selection.join.cache = Some(Cache { folder: folder.path().into(), least_bytes: 0 });
    let clock = TopicClock {
        log: None,
        topics: vec!["/for*".into()],
        at: 101 * SECOND,
        offset: 100 * SECOND,
        skew: 0.01 / 1.01,
    };
    selection.join.clocks = vec![clock.clone()];
    let rows = whole(&log.open(&selection));
    assert_eq!(rows.stamps.len(), 80);
    for (row, &stamp) in rows.stamps.iter().enumerate() {
        let t = (stamp - SECOND) as f64 / 1e9;
        // Stamps are whole nanoseconds.
        assert!((rows.columns[0][row] - t).abs() < 1e-8 && (rows.columns[1][row] + 4.0 * t).abs() < 1e-7, "{row}");
    }
    assert_eq!(rows.stamps, whole(&log.open(&selection)).stamps, "the cache has them");
    selection.join.clocks = vec![TopicClock { log: Some("another.mcap".into()), ..clock }];
    assert!(log.refusal(&selection).contains("/force"), "the clock of another log");
}

#[test]
fn empty_headers_are_no_clock() {
    let mut log = Log::new();
    log.drive(|topic, at| Some((if topic == "/odom" { 0 } else { at }, at + 2 * MILLISECOND)));
    let log = log.finish();
    let recording = log.open(&selection(None));
    assert!(recording.notes().iter().any(|note| note.contains("/odom are not filled in")), "{:?}", recording.notes());
    assert_eq!(whole(&recording).stamps[0], START + 2 * MILLISECOND);
    let message = log.refusal(&selection(Some(Stamp::Header)));
    assert!(message.contains("/odom") && message.contains("not filled in"), "{message}");
}

#[test]
fn a_few_zero_stamps_are_left_out_and_counted() {
    let mut log = Log::new();
    log.drive(|topic, at| Some((if topic == "/odom" && at % SECOND == 0 { 0 } else { at }, at)));
    let recording = log.finish().open(&selection(None));
    assert!(
        recording.notes().iter().any(|note| note.contains("/odom: 4 messages with a stamp of zero")),
        "{:?}",
        recording.notes()
    );
    assert_eq!(whole(&recording).stamps.len(), 76);
}

#[test]
fn small_disorder_of_stamps_changes_nothing() {
    let sorted = whole(&usual().open(&selection(None)));
    let mut log = Log::new();
    // Force arrives two by two in the wrong order.
    let mut waiting = None;
    for k in 0..400 {
        let at = START + k * 10 * MILLISECOND;
        if k % 5 == 0 {
            log.odometry(at, at, at + 2 * MILLISECOND);
        }
        if k % 4 == 0 {
            waiting = Some(at);
        } else if k % 4 == 2 {
            log.force(at, at, at + 2 * MILLISECOND);
            log.force(waiting.unwrap(), waiting.unwrap(), at + 3 * MILLISECOND);
        }
    }
    let log = log.finish();
    assert_eq!(whole(&log.open(&selection(None))), sorted);
    let mut narrow = selection(None);
    narrow.join.reorder_seconds = 0.001;
    assert_ne!(episodes(&log.open(&narrow)), [sorted], "the window is what does it");
}

#[test]
fn nothing_is_bridged_over_a_gap() {
    let gap = |at: i64| if at - START < 2 * SECOND { at } else { at + 2 * SECOND };
    let mut log = Log::new();
    log.drive(|_, at| Some((gap(at), gap(at))));
    let recording = log.finish().open(&selection(None));
    let episode_list = episodes(&recording);
    assert_eq!(episode_list.iter().map(|rows| rows.stamps.len()).collect::<Vec<_>>(), [40, 40]);
    assert_eq!((episode_list[0].stamps[0], episode_list[1].stamps[0]), (START, START + 4 * SECOND));
    assert!(episode_list.iter().all(|rows| rows.columns[0].iter().all(|value| value.is_finite())));
    let block = recording.read(1, 0..5, Halo { before: 5, after: 2 }).unwrap();
    assert_eq!((block.before, block.after), (0, 2), "no lag reaches over the gap");
    let block = recording.read(0, 38..40, Halo { before: 1, after: 9 }).unwrap();
    assert_eq!((block.before, block.after), (1, 0));

    // The rows go on, the other channel pauses.
    let mut log = Log::new();
    log.drive(|topic, at| (topic == "/odom" || !(SECOND..3 * SECOND).contains(&(at - START))).then_some((at, at)));
    let rows = whole(&log.finish().open(&selection(None)));
    for (&stamp, &force) in rows.stamps.iter().zip(&rows.columns[1]) {
        let t = seconds(stamp);
        // The last sample before the pause is at 0.98 s.
        let there = t <= 0.98 || t >= 3.0;
        assert_eq!(force.is_finite(), there, "{t}");
        if there {
            near(force, -4.0 * t);
        }
    }
    assert!(rows.stamps.len() == 80 && rows.columns[1][0].is_finite());
}

#[test]
fn the_joints_of_a_split_recording_begin_no_episode() {
    let log = usual();
    let one = whole(&log.open(&Selection::new(["/force.vector.x"])));
    let bag = log.folder.path().join("bag");
    fs::create_dir(&bag).unwrap();
    // Not in the order of the alphabet.
    let names = ["bag_1.mcap", "bag_0.mcap", "bag_2.mcap"];
    for (part, name) in names.iter().enumerate() {
        let mut writer = McapWriter::create(bag.join(name), &McapOptions::default()).unwrap();
        let channel = writer.channel::<Vector3Stamped<'_>>("/force").unwrap();
        for k in (0..200).filter(|k| k / 67 == part as i64) {
            let at = START + k * 20 * MILLISECOND;
            let vector = [-4.0 * seconds(at), 0.0, 0.0];
            writer.write(channel, at + 2 * MILLISECOND, at, &Vector3Stamped { header: stamped(at), vector }).unwrap();
        }
        writer.finish().unwrap();
    }
    let list: String = names.iter().map(|name| format!("    - {name}\n")).collect();
    let metadata = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  relative_file_paths:\n{list}"
    );
    fs::write(bag.join("metadata.yaml"), metadata).unwrap();
    let split = open(&[&bag], &Selection::new(["/force.vector.x"])).unwrap();
    assert_eq!(whole(&split), one, "also the identity is the same");
    let twice = open(&[&bag, &log.path], &Selection::new(["/force.vector.x"])).unwrap_err();
    assert!(matches!(twice, Error::Duplicate { .. }), "{twice}");
}

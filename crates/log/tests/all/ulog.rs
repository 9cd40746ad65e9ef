//! ULog files as recordings: columns, clocks, dropouts, folders.

use std::{fs, path::PathBuf};

use fleetfoot_data::{ColumnKind, Halo, Silent, Source};
use fleetfoot_log::{
    Base, MaxGap, Messages, Recording, Selection, TimeSpec, estimate, inspect, inspect_values, open, paths,
};

use crate::ulog_writer::{Ulog, flight};

struct Scrap {
    folder: tempfile::TempDir,
}

impl Scrap {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn write(&self, name: &str, log: &Ulog) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::write(&path, &log.bytes).unwrap();
        path
    }
}

/// All rows of a column, episode by episode.
fn rows(recording: &Recording, column: usize) -> Vec<Vec<f64>> {
    let read = |(episode, info): (usize, &fleetfoot_data::Episode)| {
        recording.read(episode, 0..info.rows, Halo::default()).unwrap().columns[column].to_vec()
    };
    recording.episodes().iter().enumerate().map(read).collect()
}

#[test]
fn columns_of_several_instances_are_joined() {
    let scrap = Scrap::new();
    let path = scrap.write("flight.ulg", &flight(200));
    let columns = ["/gyro.rate[0]", "/gyro.1.rate[0]", "/engine.esc[1].rpm", "/mode.name", "/engine.one[0]"];
    let recording = open(&[&path], &Selection::new(columns)).unwrap();
    assert_eq!((recording.episodes().len(), recording.episodes()[0].rows), (1, 200));
    assert_eq!(recording.episodes()[0].start, 1_000_000_000);
    let (first_rows, other) = (rows(&recording, 0).remove(0), rows(&recording, 1).remove(0));
    assert!(
        first_rows.iter().zip(&other).all(|(first, other)| *first == -other),
        "the second gyroscope is the first one, mirrored"
    );
    assert_eq!(first_rows[10], f64::from(10_f32.mul_add(0.1, 0.0)));
    // Whole numbers and texts hold.
    let rpm = rows(&recording, 2).remove(0);
    assert_eq!((rpm[5], rpm[9], rpm[10]), (2005.0, 2005.0, 2010.0));
    assert_eq!(recording.columns()[3].kind, ColumnKind::Category(vec!["manual".into(), "position".into()]));
    assert!(rows(&recording, 4)[0][..190].iter().all(|&one| one == 515.0));
    let estimate = estimate(&[&path], &Selection::new(columns), &Silent).unwrap().unwrap();
    assert_eq!(estimate.rows, 200);
    let message = open(&[&path], &Selection::new(["/gyro.3.rate[0]"])).unwrap_err().to_string();
    assert!(message.contains("/gyro"), "{message}");
}

#[test]
fn the_time_of_sampling_is_a_clock() {
    let scrap = Scrap::new();
    let path = scrap.write("flight.ulg", &flight(50));
    let time = TimeSpec::Column { name: "/gyro.timestamp_sample".into(), unit: None };
    let selection = Selection { time, ..Selection::new(["/gyro.rate[1]"]) };
    let recording = open(&[&path], &selection).unwrap();
    assert_eq!(recording.episodes()[0].start, 999_700_000);
    assert!(recording.notes().iter().any(|note| note.contains("in us")), "{:?}", recording.notes());
}

/// Gyroscope 0 each 10 ms, and 1 each 10 ms in between; both lose two samples, with a dropout told or not.
fn lossy(with_dropouts: bool) -> Ulog {
    let mut log = Ulog::new(0);
    log.format("gyro:uint64_t timestamp;float x;")
        .subscribe(0, 0, "gyro")
        .subscribe(1, 1, "gyro")
        .subscribe(2, 2, "gyro");
    for k in 1..=100_u64 {
        if with_dropouts && k == 51 {
            log.dropout(20);
        }
        if k != 50 && k != 51 {
            for id in 0..2_u16 {
                let time = 10_000 * k + 5_000 * u64::from(id);
                log.data(id, &[&time.to_le_bytes(), &(time as f32).to_le_bytes()]);
            }
        }
        // Slow reading loses nothing.
        if k % 20 == 10 {
            log.data(2, &[&(10_000 * k).to_le_bytes(), &(k as f32).to_le_bytes()]);
        }
    }
    log
}

#[test]
fn dropouts_are_gaps() {
    let scrap = Scrap::new();
    let (plain, dropouts) = (scrap.write("plain.ulg", &lossy(false)), scrap.write("told.ulg", &lossy(true)));
    let selection = Selection::new(["/gyro.x", "/gyro.1.x", "/gyro.2.x"]);
    // Two lost samples are bridged where nothing is said about them.
    let recording = open(&[&plain], &selection).unwrap();
    assert_eq!(recording.episodes().len(), 1);
    let recording = open(&[&dropouts], &selection).unwrap();
    assert_eq!(recording.episodes().iter().map(|episode| episode.rows).collect::<Vec<_>>(), [49, 49]);
    let note = recording.notes().join("\n");
    assert!(note.contains("1 dropout of 0.02 s") && note.contains("gaps"), "{note}");
    // The row between the second gyroscope's neighbours has no value where these are none.
    let other = rows(&recording, 1);
    assert!(other[1][0].is_nan() && !other[1][1].is_nan(), "{:?}", &other[1][..3]);
    let bridged = rows(&open(&[&plain], &selection).unwrap(), 1);
    assert!(!bridged[0][49].is_nan());
    // The slow one goes on.
    assert!(!rows(&recording, 2)[1][0].is_nan());
    let unlimited = Selection { max_gap: MaxGap::Unlimited, ..selection };
    assert_eq!(open(&[&dropouts], &unlimited).unwrap().episodes().len(), 1, "who wants no gaps gets none");
    let mut even = unlimited;
    even.join.base = Some(Base::Rate(100.0));
    assert_eq!(open(&[&dropouts], &even).unwrap().episodes().len(), 1);
}

#[test]
fn folders_and_info_know_ulog() {
    let scrap = Scrap::new();
    let path = scrap.write("a.ulg", &flight(30));
    scrap.write("b.ulg", &flight(40));
    assert_eq!(paths([scrap.folder.path()]).unwrap().len(), 2);
    assert_eq!(paths([scrap.folder.path().join("*.ulg")]).unwrap().len(), 2);
    let info = inspect(&path).unwrap();
    assert_eq!(info.format.name(), "ULog");
    let topics: Vec<(&str, &str, Option<u64>)> =
        info.topics.iter().map(|topic| (topic.name.as_str(), topic.type_name.as_str(), topic.messages)).collect();
    assert_eq!(topics[1..3], [("/gyro", "gyro", Some(30)), ("/gyro.1", "gyro", Some(30))]);
    assert_eq!(info.metadata["parameter.SYS_ID"], "-3");
    let names: Vec<&str> = info.columns.iter().map(|column| column.name.as_str()).collect();
    for name in
        ["/gyro.1.rate[2]", "/engine.esc[0].big", "/mode.name", "/logged_messages_tagged.message", "/engine.one[0]"]
    {
        assert!(names.contains(&name), "{names:?}");
    }
    assert!(names.iter().all(|name| !name.contains("padding")), "{names:?}");
    let scanned = inspect_values(&path, &Silent).unwrap();
    let a = scanned.columns.iter().find(|column| column.name == "/gyro.a").unwrap().statistics.unwrap();
    assert_eq!((a.count, a.min, a.max), (30, 0.0, 29.0));
    let read = Messages::open(&path).unwrap().columns("/mode", None, &Silent).unwrap();
    assert_eq!(read.log_time, [1_000_000_000, 1_040_000_000, 1_080_000_000]);
    let fields: Vec<&str> = read.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(fields, ["count", "timestamp", "name", "flags"]);
    assert_eq!(read.fields[0].values, [0.0, 10.0, 20.0]);
}

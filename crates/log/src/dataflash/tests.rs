use std::{
    fs,
    path::{Path, PathBuf},
};

use fleetfoot_data::{Silent, Source};

use super::DataflashContainer;
use crate::{Compression, Error, Format, Messages, container::Container, inspect, inspect_values, metadata, paths};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn open(path: &Path) -> Result<DataflashContainer, Error> {
    DataflashContainer::open(path, Compression::None, &Silent)
}

/// Messages by topic, as reading all pieces gives them.
fn read(log: &DataflashContainer) -> Vec<u64> {
    let mut counts = vec![0; log.topics().len()];
    let all: Vec<usize> = (0..counts.len()).collect();
    for piece in 0..log.pieces() {
        let mut last = i64::MIN;
        log.read_piece(piece, &all, &mut |topic, time, _, _| {
            counts[topic] += 1;
            last = last.max(time);
            Ok(())
        })
        .unwrap();
    }
    counts
}

#[test]
fn topics_are_types_and_their_instances() {
    for name in ["flight.bin", "flight.log"] {
        let log = open(&fixture(name)).unwrap();
        let topics: Vec<(&str, u64)> =
            log.topics().iter().map(|topic| (topic.name.as_str(), topic.count.unwrap())).collect();
        let arrays = ("/ISBD", 2);
        let expected = [
            ("/ATT", 15),
            ("/BAT", 3),
            ("/BIG", 2),
            ("/GPS", 3),
            ("/GPS.1", 3),
            ("/HALF", 2),
            ("/IMU", 60),
            ("/IMU.1", 60),
            arrays,
            ("/MODE", 1),
            ("/MSG", 2),
            ("/NVF.flap", 3),
            ("/NVF.rpm", 3),
            ("/TICK", 2),
        ];
        let expected: Vec<_> =
            expected.into_iter().filter(|expected_name| name == "flight.bin" || *expected_name != arrays).collect();
        assert_eq!(topics, expected, "{name}");
        assert_eq!(read(&log), topics.iter().map(|(_, count)| *count).collect::<Vec<_>>(), "{name}");
        assert!(log.damage().is_empty() && log.notes().is_empty(), "{name}: {} {:?}", log.damage(), log.notes());
        // A type without a clock has the time of the message before.
        let tick = log.topic("/TICK").unwrap();
        assert_eq!(log.indexed_spans(0).unwrap()[&tick].first, 10_000_041_000, "{name}");
    }
}

#[test]
fn units_factors_and_parameters() {
    for name in ["flight.bin", "flight.log"] {
        let info = inspect(fixture(name)).unwrap();
        let unit = |name: &str| {
            info.columns.iter().find(|column| column.name == name).unwrap().unit.clone().unwrap_or_default()
        };
        let units = ["/GPS.Lat", "/GPS.1.Spd", "/IMU.GyrX", "/HALF.Volt", "/IMU.TimeUS", "/IMU.I", "/BIG.Q1"].map(unit);
        assert_eq!(units, ["deglatitude", "m/s", "rad/s", "V", "us", "", ""], "{name}");
        let pairs = metadata(fixture(name)).unwrap();
        let expected = [
            ("changed.RLL2SRV_P", "0.9 from 10.07505 s"),
            ("default.system.RLL2SRV_P", "1"),
            ("default.system.SYSID_THISMAV", "1"),
            ("parameter.ARSPD_RATIO", "1.9936"),
            ("parameter.RLL2SRV_P", "0.75"),
            ("parameter.SYSID_THISMAV", "1"),
        ];
        if name == "flight.bin" {
            assert_eq!(pairs, expected.map(|(key, value)| (key.to_owned(), value.to_owned())).into());
        }
        assert_eq!(pairs["parameter.RLL2SRV_P"], "0.75");
        // 12,345 thousandths of a volt.
        let log = Messages::open(fixture(name)).unwrap();
        let read = log.columns("/HALF", Some(&["Volt".to_owned()]), &Silent).unwrap();
        assert_eq!(read.fields[0].values, [12.345; 2], "{name}");
    }
}

#[test]
fn files_of_others_are_refused_and_left_out_of_folders() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, word) in [
        ("build.log", &b"compiling fleetfoot\n"[..], "it is text"),
        ("scan.bin", &[1, 2, 3, 4], "first bytes"),
        ("run.bin", b"ULog\x01\x12\x35....", "ULog"),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let message = inspect(&path).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("not ArduPilot") && message.contains(word), "{message}");
        assert_eq!((Format::detect(&path), Format::of(&path).is_some()), (None, true));
    }
    assert!(matches!(paths([folder.path()]), Err(Error::EmptyFolder { .. })));
    // A pattern that catches nothing else leaves the reason to opening.
    assert_eq!(paths([folder.path().join("*.bin")]).unwrap().len(), 1);
    let packed = folder.path().join("flight.log.zst");
    fs::write(&packed, zstd::encode_all(&fs::read(fixture("flight.log")).unwrap()[..], 3).unwrap()).unwrap();
    assert_eq!(paths([folder.path()]).unwrap(), std::slice::from_ref(&packed));
    assert_eq!(inspect(&packed).unwrap().topics.len(), 13);
}

#[test]
fn damage_is_counted_and_the_rest_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bin");
    let bytes = fs::read(fixture("flight.bin")).unwrap();
    // Garbage between two messages; pages of a chip that are filled up are none.
    let place = memchr::memmem::find(&bytes, &[0xa3, 0x95, 0x43]).unwrap();
    let torn = [&bytes[..place], &[7; 100], &bytes[place..], &[0xff; 200]].concat();
    fs::write(&path, torn).unwrap();
    let log = open(&path).unwrap();
    let lost = log.damage();
    // The message before is no longer followed by one.
    assert!((100..200).contains(&lost.bytes_lost), "{lost}");
    assert_eq!(read(&log).iter().sum::<u64>(), 160);
    fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    let log = open(&path).unwrap();
    assert!(log.damage().to_string().contains("the file ends inside a message"), "{}", log.damage());
    assert_eq!(read(&log).iter().sum::<u64>(), 160);
    // A line that is cut inside its last number would be another number.
    let path = folder.path().join("a.log");
    let text = fs::read_to_string(fixture("flight.log")).unwrap();
    fs::write(&path, &text[..text.len() - 2]).unwrap();
    let log = open(&path).unwrap();
    assert!(log.damage().to_string().contains("the file ends inside a message"), "{}", log.damage());
    assert_eq!(read(&log).iter().sum::<u64>(), 158);
    let torn = text.replacen("ATT, 10010010, ", "ATT, 1001001x, ", 1).replacen("HALF", "GONE", 1);
    fs::write(&path, torn).unwrap();
    assert!(open(&path).unwrap().damage().to_string().contains("do not fit its format"));
}

#[test]
fn unreadable_formats_are_reported_by_topic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.log");
    let text = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 1, 20, ODD, Qx, TimeUS,A\n\
                FMT, 2, 20, FEW, Qff, TimeUS,A\nFMT, 3, 20, ISB, QaB, TimeUS,x,n\nFMT, 3, 20, ISC, QaB, TimeUS,x,n\n";
    let array: Vec<String> = (0..32).map(|k| (k - 7).to_string()).collect();
    let lines = format!("FEW, 1000, 1.5, 2.5\nISB, 2000, [{}], 5\n", array.join(", "));
    fs::write(&path, format!("{text}{lines}")).unwrap();
    let info = inspect_values(&path, &Silent).unwrap();
    let problem = |name: &str| {
        info.topics.iter().find(|topic| topic.name == name).and_then(|topic| topic.problem.clone()).unwrap_or_default()
    };
    assert!(problem("/FEW").contains("names 2 fields and gives 3 types"), "{:?}", info.topics);
    assert!(info.notes.iter().any(|note| note.contains("type 3 is defined twice")), "{:?}", info.notes);
    let log = Messages::open(&path).unwrap();
    let read = log.columns("/ISB", Some(&["x[31]".to_owned(), "n".to_owned()]), &Silent).unwrap();
    assert_eq!((read.fields[0].values[0], read.fields[1].values[0], read.log_time[0]), (24.0, 5.0, 2_000_000));
}

#[test]
fn joined_columns_keep_their_units() {
    for name in ["flight.bin", "flight.log"] {
        let columns = ["/IMU.GyrX", "/ATT.Roll", "/IMU.I"];
        let recording = crate::open(&[fixture(name)], &crate::Selection::new(columns)).unwrap();
        let units: Vec<_> = recording.columns().iter().map(|column| column.unit.as_deref()).collect();
        assert_eq!(units, [Some("rad/s"), Some("deg"), None], "{name}");
    }
}

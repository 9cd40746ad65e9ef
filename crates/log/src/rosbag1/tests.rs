use std::{
    fs,
    path::{Path, PathBuf},
};

use fleetfoot_data::Silent;

use super::BagContainer;
use crate::{Compression, container::Container};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn open(path: &Path) -> BagContainer {
    BagContainer::open(path, Compression::None, &Silent).unwrap()
}

/// Messages by topic, as reading all pieces gives them.
fn read(bag: &BagContainer) -> [usize; 2] {
    let mut counts = [0; 2];
    for piece in 0..bag.pieces() {
        bag.read_piece(piece, &[0, 1], &mut |topic, _, _, _| {
            counts[topic] += 1;
            Ok(())
        })
        .unwrap();
    }
    counts
}

#[test]
fn indexes_count_the_messages_that_reading_finds() {
    for name in ["none.bag", "lz4.bag", "bz2.bag"] {
        let bag = open(&fixture(name));
        let topics: Vec<_> = bag.topics().iter().map(|topic| (topic.name.as_str(), topic.count)).collect();
        assert_eq!(topics, [("/imu", Some(60)), ("/state", Some(12))], "{name}");
        assert_eq!(read(&bag), [60, 12]);
        let times: usize = (0..bag.pieces()).map(|piece| bag.indexed_times(piece).unwrap()[&0].len()).sum();
        assert_eq!((times, bag.damage().is_empty(), bag.notes().len()), (60, true, 0), "{name}");
        assert_eq!(bag.metadata()["md5sum /imu"].len(), 32);
    }
}

#[test]
fn unclosed_bag_is_read_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bag");
    let bytes = fs::read(fixture("none.bag")).unwrap();
    // The place of the section at the end is not written, and the section is not there.
    let place = memchr::memmem::find(&bytes, b"index_pos=").unwrap() + 10;
    let end = u64::from_le_bytes(*bytes[place..].first_chunk().unwrap());
    let mut cut = bytes[..end as usize].to_vec();
    cut[place..place + 8].fill(0);
    fs::write(&path, &cut).unwrap();
    let bag = open(&path);
    assert_eq!(read(&bag), [60, 12]);
    assert!(bag.notes()[0].contains("did not close"), "{:?}", bag.notes());
    assert!(bag.damage().is_empty(), "{}", bag.damage());
    // A killed recorder leaves the head of a chunk without its size: records follow bare.
    // Size in the header, and behind it the length of the data.
    let head = memchr::memmem::find(&cut, b"compression=none").unwrap();
    let size = memchr::memmem::find(&cut[head..], b"size=").unwrap() + head + 5;
    cut[size..size + 8].fill(0);
    fs::write(&path, &cut).unwrap();
    assert_eq!(read(&open(&path)), [60, 12]);
}

#[test]
fn contradicted_indexes_are_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bag");
    let mut bytes = fs::read(fixture("lz4.bag")).unwrap();
    // Counts of the index record: one message fewer, its entry cut off by as much.
    let index = memchr::memmem::find(&bytes, b"op=\x04").unwrap();
    let count = memchr::memmem::rfind(&bytes[..index + 60], b"count=").unwrap() + 6;
    bytes[count..count + 4].copy_from_slice(&1_u32.to_le_bytes());
    fs::write(&path, &bytes).unwrap();
    let bag = open(&path);
    assert_eq!(read(&bag), [60, 12]);
    assert!(bag.notes().iter().any(|note| note.contains("count different messages")), "{:?}", bag.notes());
}

#[test]
fn other_versions_are_refused_with_the_mend() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bag");
    fs::write(&path, b"#ROSBAG V1.2\nrest").unwrap();
    let message = BagContainer::open(&path, Compression::None, &Silent).unwrap_err().to_string();
    assert!(message.contains("#ROSBAG V1.2") && message.contains("rosbag fix"), "{message}");
}

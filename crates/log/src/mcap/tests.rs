//! The container against files of the `mcap` crate's writer: whole, cut at every byte, and with random bytes changed.

use std::{
    collections::BTreeMap,
    fs,
    io::Cursor,
    path::{Path, PathBuf},
};

use fleetfoot_data::Silent;
use mcap::{Compression as ChunkCompression, WriteOptions, Writer, records::MessageHeader};

use super::*;
use crate::{
    Compression, Error, Format,
    container::{Container, summary},
};

mod damaged;

/// Messages of each topic: log time, publish time, bytes.
type Messages = BTreeMap<String, Vec<(i64, i64, Vec<u8>)>>;

const TOPICS: [(&str, &str); 3] =
    [("/imu", "sensor_msgs/msg/Imu"), ("/odom", "nav_msgs/msg/Odometry"), ("/cmd_vel", "")];

fn options() -> WriteOptions {
    WriteOptions::new().profile("ros2").library("test").chunk_size(Some(4000))
}

/// The ways in which logs are written.
fn variants() -> Vec<(&'static str, WriteOptions)> {
    let index_free = |options: WriteOptions| options.emit_message_indexes(false);
    let bare = |options: WriteOptions| {
        options.emit_summary_records(false).emit_summary_offsets(false).repeat_channels(false).repeat_schemas(false)
    };
    vec![
        ("zstd", options().compression(Some(ChunkCompression::Zstd))),
        ("lz4", options().compression(Some(ChunkCompression::Lz4))),
        ("none", options().compression(None)),
        ("unchunked", options().use_chunks(false)),
        ("no summary", bare(options().compression(Some(ChunkCompression::Zstd)))),
        ("no index", index_free(options().compression(Some(ChunkCompression::Lz4)))),
        ("neither", index_free(bare(options().compression(Some(ChunkCompression::Zstd))))),
        ("unchunked, no summary", bare(options().use_chunks(false))),
    ]
}

/// A message that cannot be mistaken for another.
fn payload(topic: usize, i: u64) -> Vec<u8> {
    let mut state = (i * 3 + topic as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let noise = (0..3 + i % 4).flat_map(|_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state.to_le_bytes()
    });
    noise.chain([0; 20]).chain(i.to_le_bytes()).collect()
}

/// Messages of the test files: topic, log time, publish time.
fn schedule(count: u64) -> impl Iterator<Item = (usize, u64, u64, Vec<u8>)> {
    (0..count).map(|i| {
        let topic = if i % 10 == 9 { 2 } else { usize::from(i % 3 == 2) };
        (topic, 1_000_000_000 + i * 10_000_000, 1_000_000_000 + i * 10_000_000 - 3, payload(topic, i))
    })
}

fn truth(count: u64) -> Messages {
    let mut messages = Messages::new();
    for (topic, log, publish, data) in schedule(count) {
        messages.entry(TOPICS[topic].0.into()).or_default().push((log as i64, publish as i64, data));
    }
    messages
}

fn write(options: WriteOptions, count: u64) -> Vec<u8> {
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options).unwrap();
    let channels = TOPICS.map(|(topic, kind)| {
        let schema = if kind.is_empty() { 0 } else { writer.add_schema(kind, "ros2msg", b"float64 x\n").unwrap() };
        writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
    });
    for (topic, log_time, publish_time, data) in schedule(count) {
        let header = MessageHeader { channel_id: channels[topic], sequence: 0, log_time, publish_time };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn open(path: &Path) -> Result<McapContainer, Error> {
    let Some(Format::Mcap(compression)) = Format::of(path) else { panic!("{} is no MCAP file", path.display()) };
    McapContainer::open(path, compression, &Silent)
}

/// A file in a folder of its own.
struct Scrap {
    folder: tempfile::TempDir,
}

impl Scrap {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("run.mcap")
    }

    fn open(&self, bytes: &[u8]) -> Result<McapContainer, Error> {
        fs::write(self.path(), bytes).unwrap();
        open(&self.path())
    }
}

fn read(container: &dyn Container, wanted: &[usize]) -> Messages {
    let mut messages = Messages::new();
    for piece in 0..container.pieces() {
        container
            .read_piece(piece, wanted, &mut |topic, log, publish, data| {
                let name = container.topics()[topic].name.clone();
                messages.entry(name).or_default().push((log, publish, data.to_vec()));
                Ok(())
            })
            .unwrap();
    }
    messages
}

fn read_all(container: &dyn Container) -> Messages {
    read(container, &(0..container.topics().len()).collect::<Vec<_>>())
}

#[test]
fn every_way_of_writing_gives_the_same_messages() {
    let (scrap, truth) = (Scrap::new(), truth(1000));
    for (name, options) in variants() {
        let container = scrap.open(&write(options, 1000)).unwrap();
        assert_eq!(read_all(&container), truth, "{name}");
        assert!(container.damage().is_empty(), "{name}: {}", container.damage());
        assert_eq!(container.notes(), Vec::<String>::new(), "{name}");
        let kinds: Vec<_> =
            container.topics().iter().map(|topic| (topic.name.as_str(), topic.type_name.as_str())).collect();
        assert_eq!(
            kinds,
            [("/cmd_vel", ""), ("/imu", "sensor_msgs/msg/Imu"), ("/odom", "nav_msgs/msg/Odometry")],
            "{name}"
        );
        let schema = container.topics()[1].schema.as_ref().unwrap();
        assert_eq!((schema.encoding.as_str(), &*schema.data), ("ros2msg", &b"float64 x\n"[..]));
        let counts = container.topics().iter().map(|topic| topic.count);
        let expected: Vec<_> = truth.values().map(|messages| messages.len() as u64).collect();
        if name != "neither" {
            assert!(counts.eq(expected.iter().map(|&count| Some(count))), "{name}");
        }
        // One topic alone.
        let odom = container.topic("/odom").unwrap();
        let alone = read(&container, &[odom]);
        assert_eq!(alone.len(), 1);
        assert_eq!(alone["/odom"], truth["/odom"], "{name}");
    }
}

#[test]
fn counts_rates_and_gaps_come_from_the_indexes() {
    let (scrap, truth) = (Scrap::new(), truth(1000));
    for (name, options) in variants() {
        let container = scrap.open(&write(options, 1000)).unwrap();
        let info = summary(&container, &Silent).unwrap();
        for (topic, times) in container.topics().iter().zip(&info.topics) {
            let stamps: Vec<i64> = truth[&topic.name].iter().map(|message| message.0).collect();
            assert_eq!(
                (times.count, times.first, times.last),
                (stamps.len() as u64, stamps.first().copied(), stamps.last().copied())
            );
            let mut periods: Vec<i64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
            periods.sort_unstable();
            assert_eq!(times.largest_gap, periods.last().map(|&period| period as f64 * 1e-9), "{name}");
            let span = (stamps[stamps.len() - 1] - stamps[0]) as f64 * 1e-9;
            let rate = (stamps.len() - 1) as f64 / span;
            assert!(
                times.rate.is_some_and(|measured_rate| (measured_rate - rate).abs() < 1e-9 * rate),
                "{name}: {:?}",
                times.rate
            );
            assert_eq!(times.gaps, Some(0));
        }
        assert_eq!(info.notes.is_empty(), !matches!(name, "no index" | "neither"), "{name}: {:?}", info.notes);
    }
}

#[test]
fn a_piece_without_a_wanted_topic_is_not_decompressed() {
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options()).unwrap();
    let early = writer.add_channel(0, "/early", "json", &BTreeMap::new()).unwrap();
    let late = writer.add_channel(0, "/late", "json", &BTreeMap::new()).unwrap();
    for i in 0..400_u64 {
        let header =
            MessageHeader { channel_id: if i < 200 { early } else { late }, sequence: 0, log_time: i, publish_time: i };
        writer.write_to_known_channel(&header, &payload(0, i)).unwrap();
    }
    writer.finish().unwrap();
    let mut bytes = writer.into_inner().into_inner();
    let scrap = Scrap::new();
    let container = scrap.open(&bytes).unwrap();
    let (late, pieces) = (container.topic("/late").unwrap(), container.pieces());
    let skipped = (0..pieces).filter(|&piece| container.wanted_messages(piece, &[late]) == Some(0)).count();
    assert!(skipped > 1 && skipped < pieces, "{skipped} of {pieces}");
    // Damage in a piece that is skipped costs nothing, and is counted once by whoever reads it.
    let first = container.file.pieces[0].bytes.end - 10;
    bytes[first] ^= 0xff;
    let container = scrap.open(&bytes).unwrap();
    assert_eq!(read(&container, &[late])["/late"].len(), 200);
    assert!(container.damage().is_empty());
    for _ in 0..2 {
        read_all(&container);
        let damage = container.damage();
        assert_eq!(
            (damage.chunks_lost, damage.more_lost, Some(damage.messages_lost)),
            (1, false, container.messages(0))
        );
        assert!(damage.to_string().contains("lost 1 chunk"), "{damage}");
    }
}

#[test]
fn a_folder_of_rosbag2_is_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = [write(options(), 300), write(options().compression(Some(ChunkCompression::Lz4)), 500)];
    fs::write(folder.path().join("b.mcap"), &bytes[0]).unwrap();
    fs::write(folder.path().join("a.mcap.zstd"), zstd::encode_all(&bytes[1][..], 3).unwrap()).unwrap();
    let yaml =
        "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [b.mcap, a.mcap.zstd]\n";
    fs::write(folder.path().join("metadata.yaml"), yaml).unwrap();
    assert_eq!(crate::paths([folder.path()]).unwrap(), [folder.path()]);
    assert_eq!(
        crate::paths([folder.path().parent().unwrap().join(folder.path().file_name().unwrap())]).unwrap().len(),
        1
    );
    let container = crate::containers::open(folder.path(), Format::Rosbag2, &[], &Silent).unwrap();
    let mut both = truth(300);
    for (topic, messages) in truth(500) {
        both.get_mut(&topic).unwrap().extend(messages);
    }
    assert_eq!(read_all(container.as_ref()), both);
    assert_eq!(
        container.topic("/imu").map(|topic| container.topics()[topic].count).unwrap(),
        Some(both["/imu"].len() as u64)
    );
    assert_eq!(container.files().len(), 2);
    // The same files without metadata are two recordings.
    fs::remove_file(folder.path().join("metadata.yaml")).unwrap();
    assert_eq!(crate::paths([folder.path()]).unwrap().len(), 2);
}

#[test]
fn contradictory_topics_are_refused_on_use() {
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options()).unwrap();
    let one = writer.add_schema("a/One", "ros2msg", b"float64 x").unwrap();
    let two = writer.add_schema("a/Two", "ros2msg", b"float64 y").unwrap();
    for (schema, topic) in [(one, "/same"), (one, "/same"), (one, "/differs"), (two, "/differs")] {
        // Other metadata makes another channel.
        let metadata = BTreeMap::from([("schema".to_owned(), format!("{schema}{topic}{}", writer_id()))]);
        let channel_id = writer.add_channel(schema, topic, "cdr", &metadata).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, b"12345678").unwrap();
    }
    writer.finish().unwrap();
    let scrap = Scrap::new();
    let container = scrap.open(&writer.into_inner().into_inner()).unwrap();
    let same = container.topic("/same").unwrap();
    let channels = container.topic_of.iter().filter(|(_, topic)| **topic == same).map(|(channel, _)| *channel);
    assert_eq!(channels.collect::<Vec<_>>(), [1, 2]);
    assert_eq!(read(&container, &[same])["/same"].len(), 2);
    let message = container.topic("/differs").unwrap_err().to_string();
    assert!(message.contains("a/One") && message.contains("a/Two") && message.contains("/differs"), "{message}");
    assert!(container.topic("/sane").unwrap_err().to_string().contains("/same"));
}

/// A number that is new each time.
fn writer_id() -> usize {
    static NEXT: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
    NEXT.fetch_add(1, std::sync::atomic::Ordering::Relaxed)
}

#[test]
fn unknown_compressions_and_compressed_files() {
    let scrap = Scrap::new();
    let bytes = write(options(), 200);
    let mut unknown = bytes.clone();
    for at in 0..unknown.len() - 4 {
        if &unknown[at..at + 4] == b"zstd" {
            unknown[at..at + 4].copy_from_slice(b"brot");
        }
    }
    let message = scrap.open(&unknown).unwrap_err().to_string();
    assert!(message.contains("`brot`") && message.contains("lz4"), "{message}");
    for (name, packed) in [("run.mcap.zst", zstd::encode_all(&bytes[..], 3).unwrap()), ("x.mcap.gz", gzip(&bytes))] {
        let path = scrap.folder.path().join(name);
        fs::write(&path, &packed).unwrap();
        assert_eq!(read_all(&open(&path).unwrap()), truth(200));
        // Cut: what is left is read.
        fs::write(&path, &packed[..packed.len() / 2]).unwrap();
        if let Ok(container) = open(&path) {
            assert!(!container.damage().is_empty(), "{name}");
        }
    }
    assert!(matches!(Format::of(Path::new("A.MCAP.ZSTD")), Some(Format::Mcap(Compression::Zstd))));
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut encoder, bytes).unwrap();
    encoder.finish().unwrap()
}

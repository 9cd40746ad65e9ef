//! Messages into MCAP files, streamed chunk by chunk; the file appears whole or not at all.

use std::{
    collections::{BTreeMap, HashMap},
    fmt,
    io::{self, BufWriter},
    path::{Path, PathBuf},
};

use fleetfoot_message::write::{MESSAGE_ENCODING, Message, SCHEMA_ENCODING};
use mcap::{
    Compression, McapError, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
};

use crate::{atomic::AtomicFile, destination::check_outputs, error::Error};

/// The metadata record of an MCAP file that is ours.
pub const METADATA_RECORD: &str = "fleetfoot";

/// Channels of one file. MCAP numbers them by 16 bits.
const MAX_CHANNELS: usize = 65_000;

/// Options of an MCAP file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct McapOptions {
    /// Files that must not be overwritten: the inputs of the command.
    pub inputs: Vec<PathBuf>,
    /// Key-value metadata of the file: a metadata record named `fleetfoot`.
    pub metadata: BTreeMap<String, String>,
    /// Compress with Zstandard.
    pub compress: bool,
    /// Uncompressed bytes of a chunk, reached by its last message. A reader decompresses whole chunks, and skips whole chunks.
    pub chunk_bytes: u64,
}

impl Default for McapOptions {
    fn default() -> Self {
        Self { inputs: Vec::new(), metadata: BTreeMap::new(), compress: true, chunk_bytes: 1 << 20 }
    }
}

/// A topic of an [`McapWriter`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ChannelId(usize);

/// Facts about a channel.
struct Channel {
    /// Its number in the file.
    id: u16,
    topic: String,
    /// The type of its messages.
    kind: &'static str,
    /// The sequence number of its next message.
    sequence: u32,
}

/// Writes ROS 2 messages into an indexed MCAP file. Dropping it before [`McapWriter::finish`] leaves nothing behind.
///
/// The same calls give the same bytes: nothing depends on the wall clock, and compression runs in this thread.
pub struct McapWriter {
    path: PathBuf,
    writer: Writer<BufWriter<AtomicFile>>,
    channels: Vec<Channel>,
    by_topic: HashMap<String, ChannelId>,
    /// The message being encoded.
    message: Vec<u8>,
    /// The system refused something: half a record may stand in the file, so it must not get its name even if there is room again.
    failed: bool,
}

impl fmt::Debug for McapWriter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("McapWriter")
            .field("path", &self.path)
            .field("channels", &self.channels.len())
            .finish_non_exhaustive()
    }
}

impl McapWriter {
    /// Begins a file.
    ///
    /// # Errors
    /// A target that is one of the inputs, a folder, or in a folder that is not there.
    pub fn create(path: impl Into<PathBuf>, options: &McapOptions) -> Result<Self, Error> {
        let path = path.into();
        check_outputs(&[&path], &options.inputs)?;
        let file = BufWriter::new(AtomicFile::create(&path)?);
        let mut writer = WriteOptions::new()
            .profile("ros2")
            .library(concat!("fleetfoot ", env!("CARGO_PKG_VERSION")))
            .compression(options.compress.then_some(Compression::Zstd))
            // In this thread: how others share the work decides the bytes.
            .compression_threads(0)
            .chunk_size(Some(options.chunk_bytes))
            .create(file)
            .map_err(|problem| write_error(&path, problem))?;
        if !options.metadata.is_empty() {
            // Before any channel, which would open a chunk that this record then closes without a message.
            let record = Metadata { name: METADATA_RECORD.to_owned(), metadata: options.metadata.clone() };
            writer.write_metadata(&record).map_err(|problem| write_error(&path, problem))?;
        }
        Ok(Self { path, writer, channels: Vec::new(), by_topic: HashMap::new(), message: Vec::new(), failed: false })
    }

    /// The channel of a topic with messages of one type; the same one for the same topic.
    ///
    /// # Errors
    /// A topic without a name or with messages of another type; more channels than a file can have; refusals of the
    /// system.
    pub fn channel<M: Message>(&mut self, topic: &str) -> Result<ChannelId, Error> {
        if let Some(&known) = self.by_topic.get(topic) {
            self.check_type::<M>(known)?;
            return Ok(known);
        }
        if topic.is_empty() {
            return Err(self.misuse("a topic without a name; give it one".to_owned()));
        }
        if self.channels.len() >= MAX_CHANNELS {
            return Err(self.misuse(format!("more than {MAX_CHANNELS} topics; write several files")));
        }
        self.refuse_after_failure()?;
        let added = self.writer.add_schema(M::NAME, SCHEMA_ENCODING, M::SCHEMA.as_bytes()).and_then(|schema| {
            // The profile wants the key; an empty text says that no quality of service was recorded.
            let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
            self.writer.add_channel(schema, topic, MESSAGE_ENCODING, &metadata)
        });
        let id = added.map_err(|problem| self.failure(problem))?;
        let channel = ChannelId(self.channels.len());
        self.channels.push(Channel { id, topic: topic.to_owned(), kind: M::NAME, sequence: 0 });
        self.by_topic.insert(topic.to_owned(), channel);
        Ok(channel)
    }

    /// Appends a message; stamps are nanoseconds since 1970. Messages may come in any order, but readers are quicker when log times ascend.
    ///
    /// # Errors
    /// A message of another type than the channel's, a stamp before 1970, a message of 4 GiB or more; refusals of the
    /// system.
    pub fn write<M: Message>(
        &mut self,
        channel: ChannelId,
        log_time: i64,
        publish_time: i64,
        message: &M,
    ) -> Result<(), Error> {
        self.refuse_after_failure()?;
        self.check_type::<M>(channel)?;
        let log_time = self.stamp(channel, "log", log_time)?;
        let publish_time = self.stamp(channel, "publish", publish_time)?;
        message.encode(&mut self.message);
        if u32::try_from(self.message.len()).is_err() {
            let length = self.message.len();
            return Err(self.misuse(format!(
                "a {} on {} of {length} bytes; the most is 4 GiB: write shorter arrays",
                M::NAME,
                self.topic(channel)
            )));
        }
        let Some(entry) = self.channels.get_mut(channel.0) else {
            return Err(self.foreign());
        };
        let header = MessageHeader { channel_id: entry.id, sequence: entry.sequence, log_time, publish_time };
        entry.sequence = entry.sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, &self.message).map_err(|problem| self.failure(problem))
    }

    /// Completes the file, with its index, and gives it its name.
    ///
    /// # Errors
    /// A refusal of the system, now or before; there is then no file.
    pub fn finish(self) -> Result<(), Error> {
        self.refuse_after_failure()?;
        let Self { path, mut writer, .. } = self;
        writer.finish().map_err(|problem| write_error(&path, problem))?;
        let file =
            writer.into_inner().into_inner().map_err(|failure| write_error(&path, failure.into_error().into()))?;
        file.commit()
    }

    /// Path of the final file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn topic(&self, channel: ChannelId) -> &str {
        self.channels.get(channel.0).map_or("?", |channel| &channel.topic)
    }

    fn check_type<M: Message>(&self, channel: ChannelId) -> Result<(), Error> {
        let known = self.channels.get(channel.0).ok_or_else(|| self.foreign())?;
        if known.kind == M::NAME {
            return Ok(());
        }
        let problem = format!(
            "the topic {} has messages of type {}, not {}; choose another topic",
            known.topic,
            known.kind,
            M::NAME
        );
        Err(self.misuse(problem))
    }

    fn stamp(&self, channel: ChannelId, kind: &str, stamp: i64) -> Result<u64, Error> {
        u64::try_from(stamp).map_err(|_| {
            let topic = self.topic(channel);
            self.misuse(format!(
                "a message on {topic} has the {kind} time {stamp} ns, before 1970, which MCAP cannot hold"
            ))
        })
    }

    fn refuse_after_failure(&self) -> Result<(), Error> {
        if self.failed { Err(self.misuse("an earlier write failed; write the file again".to_owned())) } else { Ok(()) }
    }

    fn failure(&mut self, problem: McapError) -> Error {
        self.failed = true;
        write_error(&self.path, problem)
    }

    fn foreign(&self) -> Error {
        self.misuse("a channel of another file".to_owned())
    }

    /// An error of the caller.
    pub(crate) fn misuse(&self, problem: String) -> Error {
        Error::BadBatch { path: self.path.clone(), problem }
    }
}

fn write_error(path: &Path, problem: McapError) -> Error {
    let source = match problem {
        McapError::Io(inner) => inner,
        other => io::Error::other(other),
    };
    Error::Io { path: path.into(), action: "write", source }
}

#[cfg(test)]
mod tests {
    use fleetfoot_message::write::{Float64, Header, Time, Twist, Vector3Stamped};

    use super::*;

    /// The topic, type, stamps and bytes of every message, in file order.
    fn messages(bytes: &[u8]) -> Vec<(String, String, u64, u64, u32, Vec<u8>)> {
        mcap::MessageStream::new(bytes)
            .unwrap()
            .map(|message| {
                let message = message.unwrap();
                let schema = message.channel.schema.as_ref().unwrap();
                assert_eq!(message.channel.message_encoding, "cdr");
                assert_eq!(schema.encoding, "ros2msg");
                (
                    message.channel.topic.clone(),
                    schema.name.clone(),
                    message.log_time,
                    message.publish_time,
                    message.sequence,
                    message.data.to_vec(),
                )
            })
            .collect()
    }

    fn write_some(path: &Path, options: &McapOptions) {
        let mut writer = McapWriter::create(path, options).unwrap();
        let force = writer.channel::<Vector3Stamped<'_>>("/force").unwrap();
        let speed = writer.channel::<Float64>("/speed").unwrap();
        let other = writer.channel::<Float64>("/other").unwrap();
        assert_eq!(writer.channel::<Float64>("/speed").unwrap(), speed);
        for row in 0..1000 {
            let stamp = 1_700_000_000_000_000_000 + row * 10_000_000;
            writer.write(speed, stamp + 5, stamp, &Float64 { data: row as f64 }).unwrap();
            let header = Header { stamp: Time::from_nanoseconds(stamp).unwrap(), frame_id: "foot" };
            writer.write(force, stamp, stamp, &Vector3Stamped { header, vector: [row as f64, 0.5, -1.0] }).unwrap();
        }
        writer.write(other, 3, 0, &Float64 { data: -1.0 }).unwrap();
        writer.finish().unwrap();
    }

    #[test]
    fn written_messages_are_read_by_index() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.mcap");
        let metadata = BTreeMap::from([("recipe".to_owned(), "x = 1".to_owned())]);
        for compress in [true, false] {
            write_some(
                &path,
                &McapOptions { metadata: metadata.clone(), compress, chunk_bytes: 10_000, ..Default::default() },
            );
            let bytes = std::fs::read(&path).unwrap();
            let written = messages(&bytes);
            assert_eq!(written.len(), 2001);
            let mut speed = vec![0, 1, 0, 0];
            speed.extend(7f64.to_le_bytes());
            let expected = (
                "/speed".into(),
                "std_msgs/msg/Float64".into(),
                1_700_000_000_070_000_005,
                1_700_000_000_070_000_000,
                7,
                speed,
            );
            assert_eq!(written[14], expected);
            // After the header: stamp 8, length 4, "foot\0" 5, padding 7.
            assert_eq!(written[15].5.len(), 4 + 8 + 4 + 5 + 7 + 24);
            assert_eq!(written[15].5[4 + 24..][..8], 7f64.to_le_bytes());
            assert_eq!((written[2000].2, written[2000].3), (3, 0));

            let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
            let statistics = summary.stats.as_ref().unwrap();
            assert_eq!((statistics.message_count, statistics.schema_count, statistics.channel_count), (2001, 2, 3));
            assert_eq!(statistics.message_start_time, 3);
            assert!(summary.chunk_indexes.len() > 5, "{}", summary.chunk_indexes.len());
            let mut indexed = 0;
            for chunk in &summary.chunk_indexes {
                assert_eq!(chunk.compression, if compress { "zstd" } else { "" });
                assert!(chunk.message_start_time > 0 && chunk.uncompressed_size < 11_000);
                indexed += summary.stream_chunk(&bytes, chunk).unwrap().map(Result::unwrap).count();
                let entries = summary.read_message_indexes(&bytes, chunk).unwrap();
                assert!(!entries.is_empty());
            }
            assert_eq!(indexed, 2001);
            for channel in summary.channels.values() {
                assert_eq!(channel.metadata, BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]));
            }
            let record = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
            assert_eq!((record.name.as_str(), &record.metadata), ("fleetfoot", &metadata));
        }
    }

    #[test]
    fn the_header_names_the_profile_and_the_writer() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty.mcap");
        McapWriter::create(&path, &McapOptions::default()).unwrap().finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(messages(&bytes).is_empty());
        let Some(Ok(mcap::records::Record::Header(header))) = mcap::read::LinearReader::new(&bytes).unwrap().next()
        else {
            panic!("no header");
        };
        assert_eq!(
            (header.profile.as_str(), header.library),
            ("ros2", format!("fleetfoot {}", env!("CARGO_PKG_VERSION")))
        );
        assert_eq!(mcap::Summary::read(&bytes).unwrap().unwrap().stats.unwrap().message_count, 0);
    }

    #[test]
    fn the_same_calls_give_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let files = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
        for options in [McapOptions::default(), McapOptions { chunk_bytes: 3000, ..Default::default() }] {
            let bytes = files.each_ref().map(|path| {
                write_some(path, &options);
                std::fs::read(path).unwrap()
            });
            assert!(bytes[0] == bytes[1]);
        }
    }

    #[test]
    fn abandoned_file_leaves_the_older_file_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.mcap");
        std::fs::write(&path, b"older").unwrap();
        let mut writer = McapWriter::create(&path, &McapOptions { chunk_bytes: 1, ..Default::default() }).unwrap();
        let channel = writer.channel::<Twist>("/cmd_vel").unwrap();
        for time in 0..100 {
            writer.write(channel, time, time, &Twist::default()).unwrap();
        }
        drop(writer);
        assert_eq!(std::fs::read(&path).unwrap(), b"older");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn misuse_errors_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.mcap");
        let mut writer = McapWriter::create(&path, &McapOptions::default()).unwrap();
        let channel = writer.channel::<Twist>("/cmd_vel").unwrap();
        let cases = [
            (writer.channel::<Float64>("/cmd_vel").map(drop), "std_msgs/msg/Float64"),
            (writer.channel::<Float64>("").map(drop), "without a name"),
            (writer.write(channel, 0, 0, &Float64 { data: 0.0 }), "/cmd_vel"),
            (writer.write(channel, -1, 0, &Twist::default()), "log time -1"),
            (writer.write(channel, 0, -2, &Twist::default()), "publish time -2"),
            (writer.write(ChannelId(9), 0, 0, &Twist::default()), "another file"),
        ];
        for (result, part) in cases {
            let message = result.unwrap_err().to_string();
            assert!(message.contains(part) && message.contains("out.mcap"), "{message}");
        }
        writer.finish().unwrap();
        assert!(messages(&std::fs::read(&path).unwrap()).is_empty());
        let inputs = vec![path.clone()];
        let error = McapWriter::create(&path, &McapOptions { inputs, ..Default::default() }).unwrap_err();
        assert!(matches!(error, Error::OverwritesInput { .. }), "{error}");
    }

    #[test]
    fn a_refused_channel_number_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = McapWriter::create(folder.path().join("out.mcap"), &McapOptions::default()).unwrap();
        for topic in 0..MAX_CHANNELS {
            writer.channel::<Float64>(&format!("/{topic}")).unwrap();
        }
        let message = writer.channel::<Float64>("/one_more").unwrap_err().to_string();
        assert!(message.contains("several files"), "{message}");
    }
}

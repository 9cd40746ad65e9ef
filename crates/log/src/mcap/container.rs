//! A recording of one or several MCAP files, by topic and by piece.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use fleetfoot_data::{Progress, nearest_one, parallel_map};

use super::{
    channels::SchemaRecord,
    chunk,
    damage::{Damage, Lost},
    file::McapFile,
    layout::PieceKind,
    record::for_each_message,
};
use crate::{Error, Format, rosbag2};

/// A recording: one file, or the files of a rosbag2 folder in their order.
#[derive(Debug)]
pub(crate) struct Container {
    path: PathBuf,
    pub(super) files: Vec<McapFile>,
    topics: Vec<Topic>,
    /// For each file, the topic of each channel id.
    pub(super) topic_of: Vec<BTreeMap<u16, usize>>,
    pieces: Vec<PieceInfo>,
    /// What reading has lost, by piece, so that a second reading counts nothing twice.
    lost: Mutex<BTreeMap<usize, Damage>>,
}

/// A topic with all channels that carry it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Topic {
    /// e.g. `/odom`.
    pub(crate) name: String,
    /// e.g. `nav_msgs/msg/Odometry`; empty without a schema.
    pub(crate) type_name: String,
    /// e.g. `cdr`.
    pub(crate) message_encoding: String,
    pub(crate) schema: Option<SchemaRecord>,
    /// Its channel ids in each file.
    pub(crate) channels: Vec<Vec<u16>>,
    /// Messages, where all files tell.
    pub(crate) count: Option<u64>,
    /// Why its messages cannot be decoded.
    pub(crate) problem: Option<String>,
}

/// A part of the recording that is read as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PieceInfo {
    /// The file that it is in.
    pub(crate) file: usize,
    /// Its place among the pieces of that file.
    pub(super) place: usize,
    /// Its bytes in the file.
    pub(crate) bytes: usize,
    /// Its messages of all topics, where the file tells.
    pub(crate) messages: Option<u64>,
}

/// Takes a message: its topic, log time and publish time in nanoseconds, and its bytes.
pub(crate) type Each<'a> = dyn FnMut(usize, i64, i64, &[u8]) -> Result<(), Error> + 'a;

/// What reading a piece gave.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct PieceReport {
    /// Messages handed over.
    pub(crate) messages: u64,
    /// The piece was known to have no wanted message, and was not decompressed.
    pub(crate) skipped: bool,
    /// What was lost in it.
    pub(crate) damage: Damage,
}

impl Container {
    /// Opens an MCAP file or a rosbag2 folder: maps its files, finds their pieces and channels.
    ///
    /// # Errors
    /// Files that are not there or are not MCAP, metadata that cannot be read, compressions that are not known, a user who stops. Damage
    /// inside a file is no error.
    pub(crate) fn open(path: &Path, format: Format, progress: &dyn Progress) -> Result<Self, Error> {
        let paths = match format {
            Format::Mcap(compression) => vec![(path.to_path_buf(), compression)],
            Format::Rosbag2 => rosbag2::files(path)?,
            _ => return Err(Error::UnknownFormat { path: path.into() }),
        };
        // One after the other: each may use all threads to look for channels.
        let files: Vec<McapFile> = paths
            .iter()
            .map(|(path, compression)| McapFile::open(path, *compression, progress))
            .collect::<Result<_, _>>()?;
        let topics = topics(&files);
        let mut topic_of = vec![BTreeMap::new(); files.len()];
        for (t, topic) in topics.iter().enumerate() {
            for (own, channels) in topic_of.iter_mut().zip(&topic.channels) {
                own.extend(channels.iter().map(|&channel| (channel, t)));
            }
        }
        let pieces = files.iter().enumerate().flat_map(|(file, own)| {
            let pieces = own.pieces.iter().enumerate();
            pieces.map(move |(place, piece)| PieceInfo {
                file,
                place,
                bytes: piece.bytes.len(),
                messages: piece.messages(),
            })
        });
        let pieces = pieces.collect();
        Ok(Self { path: path.into(), files, topics, topic_of, pieces, lost: Mutex::default() })
    }

    /// The MCAP files, in order.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|file| file.path.as_path())
    }

    /// The topics, sorted by name.
    pub(crate) fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// The place of a topic among [`Self::topics`].
    ///
    /// # Errors
    /// A topic that the recording does not have, with the nearest name; one whose definitions contradict each other or are not there.
    pub(crate) fn topic(&self, name: &str) -> Result<usize, Error> {
        let Ok(place) = self.topics.binary_search_by(|topic| topic.name.as_str().cmp(name)) else {
            let nearest = nearest_one(name, self.topics.iter().map(|topic| topic.name.as_str()));
            return Err(Error::MissingColumn { path: self.path.clone(), column: name.into(), nearest });
        };
        match self.topics.get(place).and_then(|topic| topic.problem.clone()) {
            Some(problem) => Err(Error::UnusableTopic { path: self.path.clone(), topic: name.into(), problem }),
            None => Ok(place),
        }
    }

    /// The pieces, in the order of the recording.
    pub(crate) fn pieces(&self) -> &[PieceInfo] {
        &self.pieces
    }

    /// Messages of some topics in a piece, where the file tells without decompression. `Some(0)`: reading it would be skipped.
    pub(crate) fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64> {
        let info = self.pieces.get(piece)?;
        let topic_of = self.topic_of.get(info.file)?;
        let counts = self.files.get(info.file)?.pieces.get(info.place)?.counts.as_ref()?;
        let wanted =
            counts.iter().filter(|(channel, _)| topic_of.get(channel).is_some_and(|topic| wanted.contains(topic)));
        Some(wanted.map(|(_, count)| count).sum())
    }

    /// Hands over the messages of the wanted topics in a piece, in the order of the file: topic, log time and publish time in nanoseconds,
    /// and the message's bytes in place. An error of `each` ends the reading.
    ///
    /// Whatever is damaged in the piece is counted and passed over.
    ///
    /// # Errors
    /// Only those of `each`.
    pub(crate) fn read_piece(&self, piece: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<PieceReport, Error> {
        let mut report = PieceReport::default();
        let Some((info, file, topic_of)) = self
            .pieces
            .get(piece)
            .and_then(|info| Some((info, self.files.get(info.file)?, self.topic_of.get(info.file)?)))
        else {
            return Ok(report);
        };
        let Some(own) = file.pieces.get(info.place) else { return Ok(report) };
        if self.wanted_messages(piece, wanted) == Some(0) {
            report.skipped = true;
            return Ok(report);
        }
        let mut reader = Reader { route: Route::new(topic_of, wanted), seen: 0, late: 0, unknown: 0, messages: 0 };
        let start = own.bytes.start;
        match chunk::with_records(&file.map, own, |records| reader.read(records, each)) {
            Ok(torn) => {
                if let Some((rest, why)) = torn? {
                    let messages = own.messages().map(|all| all.saturating_sub(reader.seen));
                    let why = format!("inside a chunk: {why}");
                    report.damage.add(start, &why, Lost { bytes: rest, chunk: false, messages });
                }
            }
            Err(why) => {
                let lost =
                    Lost { bytes: own.bytes.len(), chunk: own.kind == PieceKind::Chunk, messages: own.messages() };
                report.damage.add(start, &why, lost);
            }
        }
        file.map.release(own.bytes.clone());
        reader.tell(start, &mut report.damage);
        report.messages = reader.messages;
        if !report.damage.is_empty() {
            let mut lost = self.lost.lock().unwrap_or_else(PoisonError::into_inner);
            lost.insert(piece, report.damage.clone());
        }
        Ok(report)
    }

    /// What opening and all reading up to now have lost.
    pub(crate) fn damage(&self) -> Damage {
        let mut damage = Damage::default();
        self.files.iter().for_each(|file| damage.merge(&file.damage));
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).values().for_each(|lost| damage.merge(lost));
        damage
    }

    /// What a person should know of the files, besides damage.
    pub(crate) fn notes(&self) -> Vec<String> {
        let several = self.files.len() > 1;
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let told = |file: &McapFile, note: &String| {
            if several { format!("{}: {note}", name(&file.path)) } else { note.clone() }
        };
        self.files.iter().flat_map(|file| file.notes.iter().map(move |note| told(file, note))).collect()
    }

    /// Reads all pieces with a wanted topic, in parallel, each by a `work` of its own; the answers are in the order of the pieces.
    pub(super) fn map_pieces<R: Send>(
        &self,
        progress: &dyn Progress,
        work: impl Fn(usize) -> Result<R, Error> + Sync,
    ) -> Result<Vec<R>, Error> {
        parallel_map(self.pieces.len(), progress, work)
    }
}

/// Which topic a channel belongs to, fast.
struct Route {
    /// By channel id: the topic, or one of the two marks.
    topics: Vec<usize>,
}

impl Route {
    /// A channel that nothing defines.
    const UNKNOWN: usize = usize::MAX;
    /// A channel that is not wanted.
    const OTHER: usize = usize::MAX - 1;

    fn new(topic_of: &BTreeMap<u16, usize>, wanted: &[usize]) -> Self {
        let length = topic_of.last_key_value().map_or(0, |(&last, _)| usize::from(last) + 1);
        let mut topics = vec![Self::UNKNOWN; length];
        for (&channel, &topic) in topic_of {
            if let Some(slot) = topics.get_mut(usize::from(channel)) {
                *slot = if wanted.contains(&topic) { topic } else { Self::OTHER };
            }
        }
        Self { topics }
    }

    fn of(&self, channel: u16) -> usize {
        self.topics.get(usize::from(channel)).copied().unwrap_or(Self::UNKNOWN)
    }
}

/// Counts while a piece is read.
struct Reader {
    route: Route,
    /// Messages of any topic.
    seen: u64,
    /// Wanted messages with a time that is no `i64`.
    late: u64,
    /// Messages of channels that nothing defines.
    unknown: u64,
    /// Messages handed over.
    messages: u64,
}

impl Reader {
    /// Hands over the wanted messages. The answer is how many bytes could not be read, and why.
    fn read(&mut self, records: &[u8], each: &mut Each<'_>) -> Result<Option<(usize, &'static str)>, Error> {
        let torn = for_each_message(records, |message| {
            self.seen += 1;
            let topic = match self.route.of(message.channel) {
                Route::OTHER => return Ok(()),
                Route::UNKNOWN => {
                    self.unknown += 1;
                    return Ok(());
                }
                topic => topic,
            };
            match (i64::try_from(message.log_time), i64::try_from(message.publish_time)) {
                (Ok(log), Ok(publish)) => {
                    self.messages += 1;
                    each(topic, log, publish, message.data)
                }
                _ => {
                    self.late += 1;
                    Ok(())
                }
            }
        })?;
        Ok(torn.map(|torn| (records.len() - torn.at, torn.why)))
    }

    /// Adds what was passed over.
    fn tell(&self, at: usize, damage: &mut Damage) {
        for (count, why) in
            [(self.late, "messages with times beyond the year 2262"), (self.unknown, "messages of undefined channels")]
        {
            if count > 0 {
                damage.add(at, &format!("{count} {why}"), Lost { messages: Some(count), ..Lost::default() });
            }
        }
    }
}

/// Matches the channels of all files by topic.
fn topics(files: &[McapFile]) -> Vec<Topic> {
    let mut topics: BTreeMap<&str, Topic> = BTreeMap::new();
    for (f, file) in files.iter().enumerate() {
        for (&id, channel) in &file.definitions.channels {
            let schema = file.definitions.schemas.get(&channel.schema).filter(|_| channel.schema != 0);
            let topic = topics.entry(&channel.topic).or_insert_with(|| Topic {
                name: channel.topic.clone(),
                type_name: schema.map(|schema| schema.name.clone()).unwrap_or_default(),
                message_encoding: channel.encoding.clone(),
                schema: schema.cloned(),
                channels: vec![Vec::new(); files.len()],
                count: Some(0),
                problem: None,
            });
            let name =
                |schema: Option<&SchemaRecord>| schema.map_or("no type", |schema| schema.name.as_str()).to_owned();
            let problem = if channel.schema != 0 && schema.is_none() {
                Some(format!("its channel names schema {}, which is not in the file", channel.schema))
            } else if topic.message_encoding != channel.encoding {
                Some(format!("its messages are encoded as `{}` and as `{}`", topic.message_encoding, channel.encoding))
            } else if topic.schema.as_ref() != schema {
                let (first, second) = (name(topic.schema.as_ref()), name(schema));
                let differ = if first == second { "in two definitions" } else { "in two types" };
                Some(format!("its messages come {differ}, `{first}` and `{second}`"))
            } else {
                None
            };
            topic.problem = topic.problem.take().or(problem);
            if let Some(channels) = topic.channels.get_mut(f) {
                channels.push(id);
            }
            let own = file.counts.as_ref().map(|counts| counts.get(&id).copied().unwrap_or(0));
            topic.count = topic.count.zip(own).map(|(sum, own)| sum.saturating_add(own));
        }
    }
    let mut topics: Vec<Topic> = topics.into_values().collect();
    for topic in &mut topics {
        // A file without this topic adds nothing, but only if it is known to be whole.
        let told = |(file, channels): (&McapFile, &Vec<u16>)| file.counts.is_some() || !channels.is_empty();
        if !files.iter().zip(&topic.channels).all(told) {
            topic.count = None;
        }
    }
    topics
}

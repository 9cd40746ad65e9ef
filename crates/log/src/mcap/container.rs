//! A recording of one or several MCAP files, by topic and by piece.

use std::{
    collections::{BTreeMap, HashSet},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use fleetfoot_data::Progress;
use fleetfoot_output::METADATA_RECORD;

use super::{
    chunk,
    file::McapFile,
    layout::{Piece, PieceKind},
    metadata::pairs,
    record::for_each_message,
};
use crate::{
    Compression, Error,
    container::{Container, Damage, Each, Lost, SchemaRecord, Span, Topic},
};

/// A recording: one file, or the files of a rosbag2 folder in their order.
#[derive(Debug)]
pub(crate) struct McapContainer {
    path: PathBuf,
    pub(super) files: Vec<McapFile>,
    topics: Vec<Topic>,
    /// For each file, the topic of each channel id.
    pub(super) topic_of: Vec<BTreeMap<u16, usize>>,
    pub(super) pieces: Vec<PieceInfo>,
    /// Losses from reading, by piece, so that a second reading counts nothing twice.
    lost: Mutex<BTreeMap<usize, Damage>>,
}

/// Place of a piece: its file, and its index there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PieceInfo {
    /// The file that it is in.
    pub(super) file: usize,
    /// Its place among the pieces of that file.
    pub(super) place: usize,
}

impl McapContainer {
    /// Opens the files of a recording, each with how it is compressed: maps them, finds their pieces and channels.
    ///
    /// # Errors
    /// Files that are not there or are not MCAP, compressions that are not known, a user who stops. Damage inside a file is no error.
    pub(crate) fn open(path: &Path, files: &[(PathBuf, Compression)], progress: &dyn Progress) -> Result<Self, Error> {
        // One after the other: each may use all threads to look for channels.
        let files: Vec<McapFile> = files
            .iter()
            .map(|(path, compression)| McapFile::open(path, *compression, progress))
            .collect::<Result<_, _>>()?;
        let mut topic_of = vec![BTreeMap::new(); files.len()];
        let mut topics = Vec::new();
        for (place, (topic, channels)) in carried(&files).into_iter().enumerate() {
            for (own, channels) in topic_of.iter_mut().zip(channels) {
                own.extend(channels.into_iter().map(|channel| (channel, place)));
            }
            topics.push(topic);
        }
        let pieces = files.iter().enumerate().flat_map(|(file, own)| {
            let places = 0..own.pieces.len();
            places.map(move |place| PieceInfo { file, place })
        });
        let pieces = pieces.collect();
        Ok(Self { path: path.into(), files, topics, topic_of, pieces, lost: Mutex::default() })
    }

    /// A piece with its file and the topics of that file's channels.
    fn piece(&self, piece: usize) -> Option<(&McapFile, &Piece, &BTreeMap<u16, usize>)> {
        let info = self.pieces.get(piece)?;
        let file = self.files.get(info.file)?;
        Some((file, file.pieces.get(info.place)?, self.topic_of.get(info.file)?))
    }
}

impl Container for McapContainer {
    fn path(&self) -> &Path {
        &self.path
    }

    fn files(&self) -> Vec<PathBuf> {
        self.files.iter().map(|file| file.path.clone()).collect()
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn pieces(&self) -> usize {
        self.pieces.len()
    }

    fn messages(&self, piece: usize) -> Option<u64> {
        self.piece(piece)?.1.messages()
    }

    fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64> {
        let (_, own, topic_of) = self.piece(piece)?;
        let counts = own.counts.as_ref()?.iter();
        // Of one topic, which is asked most, and of many.
        let several: HashSet<usize> = if wanted.len() > 1 { wanted.iter().copied().collect() } else { HashSet::new() };
        let is_wanted = |topic: &usize| if let [one] = wanted { topic == one } else { several.contains(topic) };
        Some(counts.filter(|(channel, _)| topic_of.get(channel).is_some_and(is_wanted)).map(|(_, count)| count).sum())
    }

    fn topics_of(&self, piece: usize) -> Option<Vec<usize>> {
        let (_, own, topic_of) = self.piece(piece)?;
        let some = own.counts.as_ref()?.iter().filter(|(_, count)| *count > 0);
        Some(some.filter_map(|(channel, _)| topic_of.get(channel).copied()).collect())
    }

    fn read_piece(&self, piece: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<(), Error> {
        let Some((file, own, topic_of)) = self.piece(piece) else { return Ok(()) };
        // It need not be decompressed.
        if self.wanted_messages(piece, wanted) == Some(0) {
            return Ok(());
        }
        let mut damage = Damage::default();
        let mut reader = Reader { route: Route::new(topic_of, wanted), seen: 0, late: 0, unknown: 0 };
        let start = own.bytes.start;
        match chunk::with_records(&file.map, own, |records| reader.read(records, each)) {
            Ok(torn) => {
                if let Some((rest, why)) = torn? {
                    let messages = own.messages().map(|all| all.saturating_sub(reader.seen));
                    let why = format!("inside a chunk: {why}");
                    damage.add(start, &why, Lost { bytes: rest, chunk: false, messages });
                }
            }
            Err(why) => {
                let lost =
                    Lost { bytes: own.bytes.len(), chunk: own.kind == PieceKind::Chunk, messages: own.messages() };
                damage.add(start, &why, lost);
            }
        }
        file.map.release(own.bytes.clone());
        reader.tell(start, &mut damage);
        if !damage.is_empty() {
            self.lost.lock().unwrap_or_else(PoisonError::into_inner).insert(piece, damage);
        }
        Ok(())
    }

    fn indexed_times(&self, piece: usize) -> Option<BTreeMap<usize, Vec<i64>>> {
        self.indexed(piece).map(|index| index.times())
    }

    fn indexed_spans(&self, piece: usize) -> Option<BTreeMap<usize, Span>> {
        self.indexed(piece).map(|index| index.spans())
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        let bodies =
            self.files.iter().flat_map(|file| file.metadata.iter().filter_map(|body| file.map.get(body.clone())));
        bodies.filter_map(|body| pairs(body, METADATA_RECORD)).flatten().collect()
    }

    fn damage(&self) -> Damage {
        let mut damage = Damage::default();
        self.files.iter().for_each(|file| damage.merge(&file.damage));
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).values().for_each(|lost| damage.merge(lost));
        damage
    }

    fn notes(&self) -> Vec<String> {
        let several = self.files.len() > 1;
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let told = |file: &McapFile, note: &String| {
            if several { format!("{}: {note}", name(&file.path)) } else { note.clone() }
        };
        self.files.iter().flat_map(|file| file.notes.iter().map(move |note| told(file, note))).collect()
    }

    fn release(&self) {
        self.files.iter().for_each(|file| file.map.release(0..file.map.len()));
    }
}

/// Fast map from channels to topics.
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
        let wanted: HashSet<usize> = wanted.iter().copied().collect();
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
                (Ok(log), Ok(publish)) => each(topic, log, publish, message.data),
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

/// A topic, and its channel ids in each file.
type Carried = (Topic, Vec<Vec<u16>>);

/// Matches the channels of all files by topic.
fn carried(files: &[McapFile]) -> Vec<Carried> {
    let mut topics: BTreeMap<&str, Carried> = BTreeMap::new();
    for (f, file) in files.iter().enumerate() {
        for (&id, channel) in &file.definitions.channels {
            let schema = file.definitions.schemas.get(&channel.schema).filter(|_| channel.schema != 0);
            let (topic, channels) = topics.entry(&channel.topic).or_insert_with(|| {
                let topic = Topic {
                    name: channel.topic.clone(),
                    type_name: schema.map(|schema| schema.name.clone()).unwrap_or_default(),
                    message_encoding: channel.encoding.clone(),
                    schema: schema.cloned(),
                    count: Some(0),
                    problem: None,
                };
                (topic, vec![Vec::new(); files.len()])
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
            if let Some(channels) = channels.get_mut(f) {
                channels.push(id);
            }
            let own = file.counts.as_ref().map(|counts| counts.get(&id).copied().unwrap_or(0));
            topic.count = topic.count.zip(own).map(|(sum, own)| sum.saturating_add(own));
        }
    }
    let mut topics: Vec<Carried> = topics.into_values().collect();
    for (topic, channels) in &mut topics {
        // A file without this topic adds nothing, but only if it is known to be whole.
        let told = |(file, channels): (&McapFile, &Vec<u16>)| file.counts.is_some() || !channels.is_empty();
        if !files.iter().zip(channels.iter()).all(told) {
            topic.count = None;
        }
    }
    topics
}

//! A recording of one MCAP file, by topic and by piece.

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
    container::{Container, Damage, Each, Lost, Span, Topic},
};

/// An open file.
#[derive(Debug)]
pub(crate) struct McapContainer {
    pub(super) file: McapFile,
    topics: Vec<Topic>,
    /// The topic of each channel id.
    pub(super) topic_of: BTreeMap<u16, usize>,
    /// Losses of reading, by piece, so that a second reading counts nothing twice.
    lost: Mutex<BTreeMap<usize, Damage>>,
}

impl McapContainer {
    /// Opens a file: maps it, finds its pieces and channels.
    ///
    /// # Errors
    /// A file that is not there or is not MCAP, compressions that are not known, a user who stops. Damage inside the file is no error.
    pub(crate) fn open(path: &Path, compression: Compression, progress: &dyn Progress) -> Result<Self, Error> {
        let file = McapFile::open(path, compression, progress)?;
        let (topics, topic_of) = carried(&file);
        Ok(Self { file, topics, topic_of, lost: Mutex::default() })
    }

    fn piece(&self, piece: usize) -> Option<&Piece> {
        self.file.pieces.get(piece)
    }
}

impl Container for McapContainer {
    fn path(&self) -> &Path {
        &self.file.path
    }

    fn files(&self) -> Vec<PathBuf> {
        vec![self.file.path.clone()]
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn pieces(&self) -> usize {
        self.file.pieces.len()
    }

    fn messages(&self, piece: usize) -> Option<u64> {
        self.piece(piece)?.messages()
    }

    fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64> {
        let counts = self.piece(piece)?.counts.as_ref()?.iter();
        // Of one topic, which is asked most, and of many.
        let several: HashSet<usize> = if wanted.len() > 1 { wanted.iter().copied().collect() } else { HashSet::new() };
        let is_wanted = |topic: &usize| if let [one] = wanted { topic == one } else { several.contains(topic) };
        Some(
            counts
                .filter(|(channel, _)| self.topic_of.get(channel).is_some_and(is_wanted))
                .map(|(_, count)| count)
                .sum(),
        )
    }

    fn topics_of(&self, piece: usize) -> Option<Vec<usize>> {
        let some = self.piece(piece)?.counts.as_ref()?.iter().filter(|(_, count)| *count > 0);
        Some(some.filter_map(|(channel, _)| self.topic_of.get(channel).copied()).collect())
    }

    fn read_piece(&self, index: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<(), Error> {
        let Some(piece) = self.piece(index) else { return Ok(()) };
        // It need not be decompressed.
        if self.wanted_messages(index, wanted) == Some(0) {
            return Ok(());
        }
        let mut damage = Damage::default();
        let mut reader = Reader { route: Route::new(&self.topic_of, wanted), seen: 0, late: 0, unknown: 0 };
        let start = piece.bytes.start;
        match chunk::with_records(&self.file.map, piece, |records| reader.read(records, each)) {
            Ok(torn) => {
                if let Some((rest, why)) = torn? {
                    let messages = piece.messages().map(|all| all.saturating_sub(reader.seen));
                    let why = format!("inside a chunk: {why}");
                    damage.add(start, &why, Lost { bytes: rest, chunk: false, messages });
                }
            }
            Err(why) => {
                let lost = Lost {
                    bytes: piece.bytes.len(),
                    chunk: piece.kind == PieceKind::Chunk,
                    messages: piece.messages(),
                };
                damage.add(start, &why, lost);
            }
        }
        self.file.map.release(piece.bytes.clone());
        reader.tell(start, &mut damage);
        if !damage.is_empty() {
            self.lost.lock().unwrap_or_else(PoisonError::into_inner).insert(index, damage);
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
        let bodies = self.file.metadata.iter().filter_map(|body| self.file.map.get(body.clone()));
        bodies.filter_map(|body| pairs(body, METADATA_RECORD)).flatten().collect()
    }

    fn damage(&self) -> Damage {
        let mut damage = self.file.damage.clone();
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).values().for_each(|lost| damage.merge(lost));
        damage
    }

    fn notes(&self) -> Vec<String> {
        self.file.notes.clone()
    }

    fn release(&self) {
        self.file.map.release(0..self.file.map.len());
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

/// The topics, sorted by name, and the place of each channel among them.
fn carried(file: &McapFile) -> (Vec<Topic>, BTreeMap<u16, usize>) {
    let mut topics: BTreeMap<&str, (Topic, Vec<u16>)> = BTreeMap::new();
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
            (topic, Vec::new())
        });
        let problem = if channel.schema != 0 && schema.is_none() {
            Some(format!("its channel names schema {}, which is not in the file", channel.schema))
        } else {
            topic.contradiction(&channel.encoding, schema)
        };
        topic.problem = topic.problem.take().or(problem);
        channels.push(id);
        let counted = file.counts.as_ref().map(|counts| counts.get(&id).copied().unwrap_or(0));
        topic.count = topic.count.zip(counted).map(|(sum, counted)| sum.saturating_add(counted));
    }
    let mut topic_of = BTreeMap::new();
    let topics = topics.into_values().enumerate().map(|(place, (topic, channels))| {
        topic_of.extend(channels.into_iter().map(|channel| (channel, place)));
        topic
    });
    (topics.collect(), topic_of)
}

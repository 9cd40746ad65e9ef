//! A recording of one bag, by topic and by piece.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use fleetfoot_data::Progress;

use super::{
    FIRST_LINE, KIND,
    record::{entry_time, op},
    scan::{Connection, Piece, Scan, for_each_record, scan},
};
use crate::{
    Compression, Error,
    container::{Container, Damage, Each, Lost, Map, Span, Topic},
};

/// An open bag.
#[derive(Debug)]
pub(crate) struct BagContainer {
    path: PathBuf,
    map: Map,
    scan: Scan,
    topics: Vec<Topic>,
    /// The topic of each connection.
    topic_of: BTreeMap<u32, usize>,
    /// Losses of reading, by piece, so that a second reading counts nothing twice.
    lost: Mutex<BTreeMap<usize, Damage>>,
}

impl BagContainer {
    /// Opens a bag, and hops over its records.
    ///
    /// # Errors
    /// A file that is not there or is no bag, a version that is not read, a user who stops. Damage is no error.
    pub(crate) fn open(path: &Path, compression: Compression, progress: &dyn Progress) -> Result<Self, Error> {
        let map = Map::open(path, compression, KIND)?;
        if !map.starts_with(FIRST_LINE) {
            let line = map.get(..map.len().min(32)).unwrap_or_default().split(|&byte| byte == b'\n').next();
            let problem =
                format!("a bag of an unsupported version: {}", String::from_utf8_lossy(line.unwrap_or_default()));
            let mend = "convert it to version 2.0 with `rosbag fix in.bag out.bag`";
            return Err(Error::WrongFormat { path: path.into(), problem, mend });
        }
        let scan = scan(&map, progress)?;
        let (topics, topic_of) = topics(&scan);
        Ok(Self { path: path.into(), map, scan, topics, topic_of, lost: Mutex::default() })
    }

    fn piece(&self, piece: usize) -> Option<&Piece> {
        self.scan.pieces.get(piece)
    }

    /// Times in the index of a piece, by topic.
    fn times<'a>(&'a self, piece: &'a Piece) -> Option<impl Iterator<Item = (usize, i64)> + 'a> {
        let whole = piece.counts.is_some() && !piece.index.is_empty();
        let times = piece.index.iter().filter_map(|(connection, data)| {
            let (entries, _) = self.map.get(data.clone())?.as_chunks::<12>();
            let topic = *self.topic_of.get(connection)?;
            Some(entries.iter().filter_map(move |entry| Some((topic, entry_time(entry)?))))
        });
        whole.then(|| times.flatten())
    }
}

/// The topics, sorted by name, with the place of each connection among them.
fn topics(scan: &Scan) -> (Vec<Topic>, BTreeMap<u32, usize>) {
    let names: BTreeSet<&str> = scan.connections.values().map(|connection| connection.topic.as_str()).collect();
    let places: BTreeMap<&str, usize> = names.iter().enumerate().map(|(place, name)| (*name, place)).collect();
    let topic_of = scan.connections.iter().map(|(id, connection)| (*id, places[connection.topic.as_str()])).collect();
    let topics = names.iter().map(|name| {
        let mut of_name = scan.connections.iter().filter(|(_, connection)| connection.topic == *name);
        let (first_id, first) = of_name.next()?;
        let mut ids = vec![*first_id];
        let mut problem = None;
        for (id, connection) in of_name {
            ids.push(*id);
            if connection.schema != first.schema {
                problem = Some(contradiction(first, connection));
            }
        }
        let counted = |piece: &Piece| {
            let counts = piece.counts.as_ref()?;
            Some(ids.iter().filter_map(|id| counts.get(id)).sum::<u64>())
        };
        Some(Topic {
            name: first.topic.clone(),
            type_name: first.schema.name.clone(),
            message_encoding: "ros1".to_owned(),
            schema: Some(first.schema.clone()),
            count: scan.pieces.iter().map(counted).sum(),
            problem,
        })
    });
    (topics.flatten().collect(), topic_of)
}

/// Words for two connections of a topic whose messages differ.
fn contradiction(first: &Connection, second: &Connection) -> String {
    let (a, b) = (&first.schema.name, &second.schema.name);
    if a == b {
        format!("its messages come in two definitions of `{a}` (md5 {} and {})", first.md5, second.md5)
    } else {
        format!("its messages come in two types, `{a}` and `{b}`")
    }
}

impl Container for BagContainer {
    fn path(&self) -> &Path {
        &self.path
    }

    fn files(&self) -> Vec<PathBuf> {
        vec![self.path.clone()]
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn pieces(&self) -> usize {
        self.scan.pieces.len()
    }

    fn messages(&self, piece: usize) -> Option<u64> {
        Some(self.piece(piece)?.counts.as_ref()?.values().sum())
    }

    fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64> {
        let counts = self.piece(piece)?.counts.as_ref()?.iter();
        let is_wanted = |connection| self.topic_of.get(connection).is_some_and(|topic| wanted.contains(topic));
        Some(counts.filter(|(connection, _)| is_wanted(connection)).map(|(_, count)| count).sum())
    }

    fn read_piece(&self, index: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<(), Error> {
        let Some(piece) = self.piece(index) else { return Ok(()) };
        if self.wanted_messages(index, wanted) == Some(0) {
            return Ok(());
        }
        let mut damage = Damage::default();
        let (mut seen, mut unknown, mut untimed) = (0, 0, 0);
        let start = piece.bytes.start;
        let read = piece.with_records(&self.map, |records| {
            let torn = for_each_record(records, |record| -> Result<(), Error> {
                if record.op != op::MESSAGE {
                    return Ok(());
                }
                seen += 1;
                let topic = record.header.u32("conn").and_then(|connection| self.topic_of.get(&connection));
                match (topic, record.header.time("time")) {
                    (None, _) => unknown += 1,
                    (Some(topic), Some(time)) if wanted.contains(topic) => each(*topic, time, time, record.data)?,
                    (Some(_), Some(_)) => {}
                    (Some(topic), None) => untimed += u64::from(wanted.contains(topic)),
                }
                Ok(())
            })?;
            Ok::<_, Error>(torn.map(|at| records.len() - at))
        });
        let all: Option<u64> = piece.counts.as_ref().map(|counts| counts.values().sum());
        match read {
            Ok(torn) => {
                if let Some(bytes) = torn? {
                    let messages = all.map(|all| all.saturating_sub(seen));
                    damage.add(
                        start,
                        "inside a chunk: bytes that are not a record",
                        Lost { bytes, chunk: false, messages },
                    );
                }
            }
            Err(why) => damage.add(start, &why, Lost { bytes: piece.bytes.len(), chunk: true, messages: all }),
        }
        for (count, what) in [(unknown, "messages of undefined connections"), (untimed, "messages without a time")] {
            if count > 0 {
                damage.add(start, &format!("{count} {what}"), Lost { messages: Some(count), ..Lost::default() });
            }
        }
        self.map.release(piece.bytes.clone());
        if !damage.is_empty() {
            self.lost.lock().unwrap_or_else(PoisonError::into_inner).insert(index, damage);
        }
        Ok(())
    }

    fn indexed_times(&self, piece: usize) -> Option<BTreeMap<usize, Vec<i64>>> {
        let mut times: BTreeMap<usize, Vec<i64>> = BTreeMap::new();
        self.times(self.piece(piece)?)?.for_each(|(topic, time)| times.entry(topic).or_default().push(time));
        Some(times)
    }

    fn indexed_spans(&self, piece: usize) -> Option<BTreeMap<usize, Span>> {
        let mut spans: BTreeMap<usize, Span> = BTreeMap::new();
        self.times(self.piece(piece)?)?.for_each(|(topic, time)| {
            let span = Span { count: 1, first: time, last: time };
            spans.entry(topic).and_modify(|known_span| known_span.join(&span)).or_insert(span);
        });
        Some(spans)
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        let sums = self.scan.connections.values().filter(|connection| !connection.md5.is_empty());
        sums.map(|connection| (format!("md5sum {}", connection.topic), connection.md5.clone())).collect()
    }

    fn damage(&self) -> Damage {
        let mut damage = self.scan.damage.clone();
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).values().for_each(|lost| damage.merge(lost));
        damage
    }

    fn notes(&self) -> Vec<String> {
        self.scan.notes.clone()
    }

    fn release(&self) {
        self.map.release(0..self.map.len());
    }
}

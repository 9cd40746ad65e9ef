//! Recordings of rosbag2 in an SQLite database (`.db3`), by topic and by piece.
//!
//! The tables are those of rosbag2's own writer: `topics` (id, name, type, serialization_format), `messages` (topic_id, timestamp, data) and, since
//! Iron, `message_definitions`. Messages of older writers have no definitions in the file: they are looked for elsewhere (`Definitions`).
//! A piece is a run of leaves of the table `messages`, about a megabyte of records.

use std::{
    collections::BTreeMap,
    ops::Range,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use fleetfoot_data::{Cancelled, Progress, parallel_map};
use zstd::zstd_safe::get_frame_content_size;

use super::definitions::Definitions;
use crate::{
    Compression, Error,
    container::{Container, Damage, Each, Lost, Packing, SchemaRecord, Span, Topic, with_unpacked},
    sqlite::{Database, Row, Table, Value},
};

/// Bytes of records after which a piece ends.
const PIECE: usize = 1 << 20;

/// Leaves that a thread looks over at a time.
const LEAVES: usize = 64;

/// First bytes of a message that was packed alone (`compression_mode: MESSAGE`); one in CDR begins with 0.
const ZSTD: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// An open database.
#[derive(Debug)]
pub(crate) struct DatabaseContainer {
    database: Database,
    messages: Messages,
    topics: Vec<Topic>,
    /// The place among the topics of each id.
    topic_of: BTreeMap<i64, usize>,
    /// Leaves of the table of messages.
    leaves: Vec<u32>,
    pieces: Vec<Piece>,
    metadata: BTreeMap<String, String>,
    damage: Damage,
    notes: Vec<String>,
    /// Losses of reading, by piece, so that a second reading counts nothing twice.
    lost: Mutex<BTreeMap<usize, Damage>>,
}

/// The table of messages and its columns.
#[derive(Debug)]
struct Messages {
    table: Table,
    topic: usize,
    received: usize,
    sent: usize,
    data: usize,
}

/// A run of leaves.
#[derive(Debug, Default)]
struct Piece {
    /// Places among the leaves.
    leaves: Range<usize>,
    /// Messages by topic.
    spans: BTreeMap<usize, Span>,
}

/// Content of a leaf page.
#[derive(Debug, Default)]
struct Leaf {
    bytes: usize,
    spans: BTreeMap<usize, Span>,
    /// Rows that are damaged, and rows of topics that nothing defines.
    damaged: u64,
    unknown: u64,
}

impl DatabaseContainer {
    /// Opens a database, and looks over the heads of all its messages.
    ///
    /// # Errors
    /// A file that is not there or is no database, a database that is no recording of rosbag2, a user who stops. Damage is no error.
    pub(crate) fn open(path: &Path, compression: Compression, progress: &dyn Progress) -> Result<Self, Error> {
        let database = Database::open(path, compression)?;
        let foreign = |problem: String| Error::WrongFormat {
            path: path.into(),
            problem,
            mend: "give the file that `ros2 bag record` wrote; a damaged one: `sqlite3 FILE .recover | sqlite3 NEW.db3`",
        };
        let table = |name: &str| {
            Table::of(&database, name).ok_or_else(|| {
                foreign(format!("an SQLite database without a table `{name}`, so not a rosbag2 recording"))
            })
        };
        let lacks = |table: &str, column: &str| foreign(format!("the table `{table}` has no column `{column}`"));
        let messages = table("messages")?;
        let column = |name: &str| messages.column(name);
        let received = column("recv_timestamp").or(column("timestamp"));
        let received = received.ok_or_else(|| lacks("messages", "timestamp"))?;
        let messages = Messages {
            topic: column("topic_id").ok_or_else(|| lacks("messages", "topic_id"))?,
            received,
            sent: column("send_timestamp").unwrap_or(received),
            data: column("data").ok_or_else(|| lacks("messages", "data"))?,
            table: messages,
        };
        let (topics, topic_of) = topics(&database, &table("topics")?).map_err(|column| lacks("topics", column))?;
        let mut opened = Self {
            messages,
            topics,
            topic_of,
            leaves: Vec::new(),
            pieces: Vec::new(),
            metadata: distribution(&database),
            damage: Damage::default(),
            notes: database.notes.clone(),
            lost: Mutex::default(),
            database,
        };
        opened.find_pieces(progress)?;
        opened.database.release();
        Ok(opened)
    }

    /// Groups the leaves of the table of messages into pieces.
    fn find_pieces(&mut self, progress: &dyn Progress) -> Result<(), Error> {
        progress.stage("finding messages");
        let leaves = self.messages.table.leaves(&self.database);
        for &page in &leaves.damaged {
            let lost = Lost { bytes: self.database.page_size(), chunk: false, messages: None };
            let why = self.database.cut().filter(|_| self.database.place(page) != 0);
            let why = why.unwrap_or_else(|| "a malformed page of the table of messages".to_owned());
            self.damage.add(self.database.place(page), &why, lost);
        }
        self.leaves = leaves.pages;
        let groups: Vec<&[u32]> = self.leaves.chunks(LEAVES).collect();
        let seen = parallel_map(groups.len(), progress, |group| {
            if progress.cancelled() {
                return Err(Error::from(Cancelled));
            }
            let leaves = groups[group].iter().map(|&page| self.leaf(page)).collect::<Vec<Leaf>>();
            self.database.release_around(groups[group]);
            Ok(leaves)
        })?;
        let room = self
            .leaves
            .len()
            .max(1)
            .saturating_add(self.database.file_pages())
            .saturating_mul(self.database.page_size());
        let (mut unknown, mut unknown_at, mut total) = (0, 0, 0_usize);
        let mut piece = Piece::default();
        let mut bytes = 0;
        let mut pieces = Vec::new();
        let mut damage = std::mem::take(&mut self.damage);
        for (place, leaf) in seen.into_iter().flatten().enumerate() {
            let at = self.database.place(self.leaves[place]);
            total = total.saturating_add(leaf.bytes);
            if total > room {
                // Rows do not share bytes: lengths that add up to more than the file would be read again and again.
                damage.add(
                    at,
                    "rows with more bytes than the file has",
                    Lost { bytes: 0, chunk: false, messages: None },
                );
                break;
            }
            if leaf.damaged > 0 {
                let why = format!("{} malformed rows of messages", leaf.damaged);
                damage.add(at, &why, Lost { messages: Some(leaf.damaged), ..Lost::default() });
            }
            if leaf.unknown > 0 && unknown == 0 {
                unknown_at = at;
            }
            unknown += leaf.unknown;
            piece.leaves = piece.leaves.start..place + 1;
            for (topic, span) in leaf.spans {
                piece.spans.entry(topic).and_modify(|known_span| known_span.join(&span)).or_insert(span);
            }
            bytes += leaf.bytes;
            if bytes >= PIECE {
                pieces.push(std::mem::replace(&mut piece, Piece { leaves: place + 1..place + 1, ..Piece::default() }));
                bytes = 0;
            }
        }
        if !piece.spans.is_empty() {
            pieces.push(piece);
        }
        if unknown > 0 {
            let why = format!("{unknown} messages of undefined topics, the first of them");
            damage.add(unknown_at, &why, Lost { messages: Some(unknown), ..Lost::default() });
        }
        if let Some(cut) = self.database.cut().filter(|_| damage.is_empty()) {
            damage.add(
                self.database.place(self.database.file_pages() as u32 + 1),
                &cut,
                Lost { bytes: 0, chunk: false, messages: None },
            );
        }
        for piece in &pieces {
            for (&topic, span) in &piece.spans {
                let count = &mut self.topics[topic].count;
                *count = count.map(|count| count + span.count);
            }
        }
        (self.pieces, self.damage) = (pieces, damage);
        Ok(())
    }

    /// Looks over the heads of a leaf's rows.
    fn leaf(&self, page: u32) -> Leaf {
        let mut leaf = Leaf::default();
        for row in self.messages.table.rows(&self.database, page) {
            let Some((row, (topic, time, _))) = row.and_then(|row| Some((row, self.head(&row)?))) else {
                leaf.damaged += 1;
                continue;
            };
            leaf.bytes = leaf.bytes.saturating_add(row.length());
            let Some(&topic) = self.topic_of.get(&topic) else {
                leaf.unknown += 1;
                continue;
            };
            let span = Span { count: 1, first: time, last: time };
            leaf.spans.entry(topic).and_modify(|known_span| known_span.join(&span)).or_insert(span);
        }
        leaf
    }

    /// Topic id, time of reception and time of sending of a message.
    fn head(&self, row: &Row<'_>) -> Option<(i64, i64, i64)> {
        let Messages { topic, received, sent, .. } = self.messages;
        let [topic, received, sent] = row.integers([topic, received, sent])?;
        Some((topic, received, sent))
    }
}

/// The topics, sorted by name, and the place of each id among them; else the column that their table lacks.
fn topics(database: &Database, table: &Table) -> Result<(Vec<Topic>, BTreeMap<i64, usize>), &'static str> {
    let column = |name: &'static str| table.column(name).ok_or(name);
    let (id, name, kind) = (column("id")?, column("name")?, column("type")?);
    let encoding = column("serialization_format")?;
    let (definitions, beside) = (definitions(database), Definitions::beside(database.path()));
    let mut rows: BTreeMap<String, (Topic, Vec<i64>)> = BTreeMap::new();
    for row in table.leaves(database).pages.iter().flat_map(|&page| table.rows(database, page)).flatten() {
        let text = |column| match row.value(column) {
            Some(Value::Text(text)) => Some(text),
            _ => None,
        };
        let (Some(id), Some(name), Some(kind)) = (table.integer(&row, id), text(name), text(kind)) else { continue };
        let schema = definitions.get(&kind).cloned().map_or_else(|| beside.schema(&kind), Ok);
        let (schema, problem) = schema.map_or_else(|problem| (None, Some(problem)), |schema| (Some(schema), None));
        let topic = Topic {
            name: name.clone(),
            type_name: kind,
            message_encoding: text(encoding).unwrap_or_default(),
            schema,
            count: Some(0),
            problem,
        };
        let (first_topic, ids) = rows.entry(name).or_insert_with(|| (topic.clone(), Vec::new()));
        if first_topic.type_name != topic.type_name {
            let (a, b) = (&first_topic.type_name, &topic.type_name);
            first_topic.problem = Some(format!("its messages come in two types, `{a}` and `{b}`"));
        }
        ids.push(id);
    }
    let places = rows.values().enumerate().flat_map(|(place, (_, ids))| ids.iter().map(move |&id| (id, place)));
    let topic_of = places.collect();
    Ok((rows.into_values().map(|(topic, _)| topic).collect(), topic_of))
}

/// Definitions that the file has, by type.
fn definitions(database: &Database) -> BTreeMap<String, SchemaRecord> {
    let Some(table) = Table::of(database, "message_definitions") else { return BTreeMap::new() };
    let columns = ["topic_type", "encoding", "encoded_message_definition"].map(|name| table.column(name));
    let [Some(kind), Some(encoding), Some(definition)] = columns else { return BTreeMap::new() };
    let rows = table.leaves(database).pages;
    let rows = rows.iter().flat_map(|&page| table.rows(database, page)).flatten();
    rows.filter_map(|row| {
        let text = |column| match row.value(column) {
            Some(Value::Text(text)) if !text.is_empty() => Some(text),
            _ => None,
        };
        let name = text(kind)?;
        let schema =
            SchemaRecord { name: name.clone(), encoding: text(encoding)?, data: text(definition)?.into_bytes().into() };
        Some((name, schema))
    })
    .collect()
}

/// The distribution of ROS that wrote the file, where it says so.
fn distribution(database: &Database) -> BTreeMap<String, String> {
    let find = || {
        let table = Table::of(database, "schema")?;
        let column = table.column("ros_distro")?;
        let pages = table.leaves(database).pages;
        let row = pages.iter().flat_map(|&page| table.rows(database, page)).flatten().next()?;
        match row.value(column)? {
            Value::Text(text) => Some(text),
            _ => None,
        }
    };
    find().map(|name| ("ros_distro".to_owned(), name)).into_iter().collect()
}

impl Container for DatabaseContainer {
    fn path(&self) -> &Path {
        self.database.path()
    }

    fn files(&self) -> Vec<PathBuf> {
        vec![self.database.path().to_path_buf()]
    }

    fn topics(&self) -> &[Topic] {
        &self.topics
    }

    fn pieces(&self) -> usize {
        self.pieces.len()
    }

    fn messages(&self, piece: usize) -> Option<u64> {
        Some(self.pieces.get(piece)?.spans.values().map(|span| span.count).sum())
    }

    fn wanted_messages(&self, piece: usize, wanted: &[usize]) -> Option<u64> {
        let spans = &self.pieces.get(piece)?.spans;
        Some(wanted.iter().filter_map(|topic| spans.get(topic)).map(|span| span.count).sum())
    }

    fn read_piece(&self, index: usize, wanted: &[usize], each: &mut Each<'_>) -> Result<(), Error> {
        let Some(piece) = self.pieces.get(index).filter(|_| self.wanted_messages(index, wanted) != Some(0)) else {
            return Ok(());
        };
        let mut damage = Damage::default();
        for &page in &self.leaves[piece.leaves.clone()] {
            // Damaged rows were counted when the file was opened.
            for row in self.messages.table.rows(&self.database, page).flatten() {
                let Some((topic, received, sent)) = self.head(&row) else { continue };
                let Some(topic) = self.topic_of.get(&topic).copied().filter(|topic| wanted.contains(topic)) else {
                    continue;
                };
                let mut lose = |why: &str| {
                    let lost = Lost { bytes: row.length(), chunk: false, messages: Some(1) };
                    damage.add(self.database.place(page), why, lost);
                };
                match row.value(self.messages.data) {
                    Some(Value::Blob(data)) if data.starts_with(ZSTD) => {
                        let size = get_frame_content_size(&data).ok().flatten().unwrap_or(1 << 30);
                        match with_unpacked(Packing::Zstd, &data, size, |data| Ok(each(topic, received, sent, data))) {
                            Ok(answer) => answer?,
                            Err(why) => lose(&why.replace("a chunk", "a message")),
                        }
                    }
                    Some(Value::Blob(data)) => each(topic, received, sent, &data)?,
                    _ => lose("a message whose pages are missing"),
                }
            }
        }
        self.database.release_around(&self.leaves[piece.leaves.clone()]);
        if !damage.is_empty() {
            self.lost.lock().unwrap_or_else(PoisonError::into_inner).insert(index, damage);
        }
        Ok(())
    }

    fn indexed_spans(&self, piece: usize) -> Option<BTreeMap<usize, Span>> {
        Some(self.pieces.get(piece)?.spans.clone())
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        self.metadata.clone()
    }

    fn damage(&self) -> Damage {
        let mut damage = self.damage.clone();
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).values().for_each(|lost| damage.merge(lost));
        damage
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn release(&self) {
        self.database.release();
    }
}

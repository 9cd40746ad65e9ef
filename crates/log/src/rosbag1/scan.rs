//! Places of a bag's parts, found by hopping from record to record.

use std::{collections::BTreeMap, ops::Range, sync::Arc};

use fleetfoot_data::{Cancelled, Progress, parallel_map};
use memchr::memmem;

use super::{
    FIRST_LINE,
    record::{Header, Record, index_entries, op},
};
use crate::{
    Error,
    container::{Damage, Lost, Map, Packing, SchemaRecord, with_unpacked},
};

/// Bytes after which a run of bare messages ends.
const RUN: usize = 1 << 20;

/// Contradictions that are noted of a file.
const MAX_NOTES: usize = 5;

/// A part of a file that is read as a whole.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// Place of the chunk's data, or of the bare records.
    pub(super) bytes: Range<usize>,
    pub(super) kind: PieceKind,
    /// Places of the index records' data behind the chunk, by connection.
    pub(super) index: Vec<(u32, Range<usize>)>,
    /// Messages by connection, where indexes are there and are believed.
    pub(super) counts: Option<BTreeMap<u32, u64>>,
    /// Place of the chunk's record, by which the section at the end names it.
    place: usize,
}

/// Packing of a piece.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum PieceKind {
    /// Records one after the other.
    Bare,
    /// A packed chunk, with the bytes that it has when it is unpacked.
    Packed(Packing, u64),
    /// A chunk in a packing that is not known.
    Unknown(String),
}

impl Piece {
    /// Hands the records of the piece on, or says why they are lost.
    pub(super) fn with_records<R>(&self, file: &[u8], use_records: impl FnOnce(&[u8]) -> R) -> Result<R, String> {
        let bytes = file.get(self.bytes.clone()).ok_or("it leaves the file")?;
        match &self.kind {
            PieceKind::Bare => Ok(use_records(bytes)),
            PieceKind::Packed(packing, size) => with_unpacked(*packing, bytes, *size, |records| {
                if records.len() as u64 != *size {
                    return Err(format!("a chunk of {} bytes where its head says {size}", records.len()));
                }
                Ok(use_records(records))
            }),
            PieceKind::Unknown(name) => Err(format!("a chunk compressed by `{name}`; readable are lz4, bz2 and none")),
        }
    }
}

/// A connection: a publisher's messages on a topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Connection {
    pub(super) topic: String,
    pub(super) md5: String,
    pub(super) schema: SchemaRecord,
}

impl Connection {
    /// From its record: the header names the topic, the data hold the publisher's own header.
    fn parse(record: &Record<'_>) -> Option<(u32, Self)> {
        let publisher = Header::parse(record.data)?;
        let name = publisher.text("type")?;
        let data: Arc<[u8]> = publisher.get("message_definition").unwrap_or_default().into();
        let schema = SchemaRecord { name, encoding: "ros1msg".to_owned(), data };
        let topic =
            record.header.text("topic").filter(|topic| !topic.is_empty()).or_else(|| publisher.text("topic"))?;
        Some((record.header.u32("conn")?, Self { topic, md5: publisher.text("md5sum").unwrap_or_default(), schema }))
    }
}

/// Parts of a bag.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// In the order of the file.
    pub(super) pieces: Vec<Piece>,
    pub(super) connections: BTreeMap<u32, Connection>,
    pub(super) damage: Damage,
    pub(super) notes: Vec<String>,
    /// Counts of the section at the end, by the place of the chunk's record.
    infos: BTreeMap<u64, BTreeMap<u32, u64>>,
    /// True if the file gives the offset of its last section.
    closed: bool,
}

/// Finds the parts of a bag.
///
/// # Errors
/// A user who stops.
pub(super) fn scan(map: &Map, progress: &dyn Progress) -> Result<Scan, Error> {
    let mut scan = Scan::default();
    progress.stage("finding messages");
    let mut at = FIRST_LINE.len();
    while at < map.len() {
        if scan.pieces.len().is_multiple_of(64) && progress.cancelled() {
            return Err(Cancelled.into());
        }
        at = match Record::at(map, at) {
            Some(record) => scan.add(map, at, &record),
            None => scan.damaged(map, at),
        };
    }
    if !scan.closed {
        scan.notes.push("its recorder did not close it: it has no index at its end".to_owned());
    }
    scan.believe_indexes();
    if !scan.explained() {
        scan.look_into_pieces(map, progress)?;
    }
    map.release(0..map.len());
    Ok(scan)
}

impl Scan {
    /// Adds a record of the file; the answer is where the next one is.
    fn add(&mut self, map: &[u8], at: usize, record: &Record<'_>) -> usize {
        match record.op {
            op::BAG => self.closed = record.header.u64("index_pos").is_some_and(|place| place != 0),
            op::CHUNK => {
                let size = u64::from(record.header.u32("size").unwrap_or(0));
                let kind = match record.header.get("compression").unwrap_or(b"none") {
                    b"none" | b"" => PieceKind::Bare,
                    b"lz4" => PieceKind::Packed(Packing::Lz4, size),
                    b"bz2" => PieceKind::Packed(Packing::Bzip2, size),
                    other => PieceKind::Unknown(String::from_utf8_lossy(other).into_owned()),
                };
                let bytes = record.data_range.clone();
                // The chunk that a killed recorder was writing has no data yet: its records follow bare.
                if !bytes.is_empty() {
                    self.pieces.push(Piece { bytes, kind, index: Vec::new(), counts: None, place: at });
                }
            }
            op::INDEX => {
                if let (Some((connection, _)), Some(piece)) = (index_entries(record), self.pieces.last_mut()) {
                    piece.index.push((connection, record.data_range.clone()));
                }
            }
            op::CONNECTION => self.connect(record),
            op::CHUNK_INFO => self.add_info(record),
            op::MESSAGE => match self.pieces.last_mut() {
                Some(piece) if piece.place == usize::MAX && piece.bytes.end == at && piece.bytes.len() < RUN => {
                    piece.bytes.end = record.end();
                }
                _ => self.pieces.push(Piece {
                    bytes: at..record.end(),
                    kind: PieceKind::Bare,
                    index: Vec::new(),
                    counts: None,
                    place: usize::MAX,
                }),
            },
            _ => {}
        }
        debug_assert!(record.end() > at && record.end() <= map.len());
        record.end()
    }

    /// The first definition of a connection stays.
    fn connect(&mut self, record: &Record<'_>) {
        let Some((id, connection)) = Connection::parse(record) else { return };
        self.join(id, connection);
    }

    fn join(&mut self, id: u32, connection: Connection) {
        let known = self.connections.entry(id).or_insert_with(|| connection.clone());
        if *known != connection && self.notes.len() < MAX_NOTES {
            self.notes.push(format!(
                "connection {id} is defined twice, as {} and differently as {}: the first is used",
                known.topic, connection.topic
            ));
        }
    }

    fn add_info(&mut self, record: &Record<'_>) {
        let (entries, _) = record.data.as_chunks::<8>();
        let count = |[a, b, c, d, e, f, g, h]: [u8; 8]| {
            (u32::from_le_bytes([a, b, c, d]), u64::from(u32::from_le_bytes([e, f, g, h])))
        };
        if let Some(place) = record.header.u64("chunk_pos") {
            self.infos.insert(place, entries.iter().copied().map(count).collect());
        }
    }

    /// Passes over bytes that are not a record, up to the next place where one is; the answer is that place.
    fn damaged(&mut self, map: &Map, start: usize) -> usize {
        // Every header has this field, at most two others before it.
        const FIELD: &[u8] = b"\x04\0\0\0op=";
        const BEFORE: usize = 96;
        let rest = map.get(start + 1..).unwrap_or_default();
        let record_before = |field: usize| {
            let earliest = field.saturating_sub(BEFORE).max(start + 1);
            (earliest..field.saturating_sub(3)).find(|&at| {
                Record::at(map, at).is_some_and(|record| (op::MESSAGE..=op::CONNECTION).contains(&record.op))
            })
        };
        let next = memmem::find_iter(rest, FIELD).find_map(|place| record_before(start + 1 + place));
        let end = next.unwrap_or(map.len());
        let cut =
            map.cut.as_deref().unwrap_or("the file ends inside a record: it was cut, or its recorder was stopped");
        let why = if next.is_none() { cut } else { "bytes that are not a record" };
        self.damage.add(start, why, Lost { bytes: end - start, chunk: false, messages: None });
        end
    }

    /// Takes the counts of indexes, but not of one that the section at the end contradicts: messages would be lost in silence.
    fn believe_indexes(&mut self) {
        let mut contradicted = 0;
        for piece in self.pieces.iter_mut().filter(|piece| !piece.index.is_empty()) {
            let mut counts: BTreeMap<u32, u64> = BTreeMap::new();
            for (connection, data) in &piece.index {
                *counts.entry(*connection).or_default() += (data.len() / 12) as u64;
            }
            let info = self.infos.get(&(piece.place as u64));
            match info.is_none_or(|info| *info == counts) {
                true => piece.counts = Some(counts),
                false => contradicted += 1,
            }
        }
        if contradicted > 0 {
            let which = if contradicted == 1 { "1 chunk".to_owned() } else { format!("{contradicted} chunks") };
            self.notes.push(format!(
                "{which}: the index and the section at the end count different messages; both are ignored, and the chunks read"
            ));
        }
    }

    /// True if every known connection of the pieces is defined.
    fn explained(&self) -> bool {
        let mut used = self.pieces.iter().map(|piece| piece.counts.as_ref());
        self.closed
            && used.all(|counts| counts.is_some_and(|counts| counts.keys().all(|id| self.connections.contains_key(id))))
    }

    /// Looks into all pieces for connections, and counts the messages of those without an index.
    fn look_into_pieces(&mut self, map: &Map, progress: &dyn Progress) -> Result<(), Error> {
        progress.stage("looking for connections");
        let pieces = &self.pieces;
        let seen = parallel_map(pieces.len(), progress, |i| {
            let piece = &pieces[i];
            let mut connections = Vec::new();
            let mut counts: BTreeMap<u32, u64> = BTreeMap::new();
            let whole = piece.with_records(map, |records| {
                for_each_record(records, |record| {
                    match record.op {
                        op::CONNECTION => connections.extend(Connection::parse(record)),
                        op::MESSAGE => *counts.entry(record.header.u32("conn").unwrap_or(u32::MAX)).or_default() += 1,
                        _ => {}
                    }
                    Ok::<_, std::convert::Infallible>(())
                })
            });
            map.release(piece.bytes.clone());
            let whole = matches!(whole, Ok(Ok(None)));
            Ok::<_, Error>((connections, whole.then_some(counts)))
        })?;
        for (place, (connections, counts)) in seen.into_iter().enumerate() {
            connections.into_iter().for_each(|(id, connection)| self.join(id, connection));
            self.pieces[place].counts = counts.or_else(|| self.pieces[place].counts.take());
        }
        Ok(())
    }
}

/// Hands over the records of a chunk; the answer is where bytes begin that are no record, if any.
pub(super) fn for_each_record<E>(
    records: &[u8],
    mut each: impl FnMut(&Record<'_>) -> Result<(), E>,
) -> Result<Option<usize>, E> {
    let mut at = 0;
    while at < records.len() {
        let Some(record) = Record::at(records, at) else { return Ok(Some(at)) };
        each(&record)?;
        at = record.end();
    }
    Ok(None)
}

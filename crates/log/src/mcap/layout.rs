//! Layout of the messages in a file, from its record heads; chunks are not opened.

use std::ops::Range;

use mcap::{MAGIC, records::op};

use super::record::{Chunk, Message, MessageIndex, RECORD_HEAD, Record, record_at, sound_record_at};
use crate::container::{Damage, Lost};

/// Bytes after which a run of messages outside chunks is cut.
const RUN: usize = 4 << 20;

/// Sound records in a row that make a place after damage believable.
const CHAIN: usize = 4;

/// A part of a file that is read as a whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Piece {
    pub(super) kind: PieceKind,
    /// Its bytes in the file: of a chunk, the record's body; of a run, all records.
    pub(super) bytes: Range<usize>,
    /// Messages of each channel that has some, in the order of first mention, where the file tells without decompression.
    pub(super) counts: Option<Vec<(u16, u64)>>,
    /// The index records behind a chunk; empty for a run.
    pub(super) index: Range<usize>,
}

impl Piece {
    /// Messages in it, where the file tells.
    pub(super) fn messages(&self) -> Option<u64> {
        self.counts.as_ref().map(|counts| counts.iter().map(|(_, count)| count).sum())
    }
}

/// Kind of a [`Piece`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PieceKind {
    /// A chunk record.
    Chunk,
    /// Consecutive records of a file without chunks.
    Records,
}

/// The parts of a file.
#[derive(Debug, Default)]
pub(super) struct Layout {
    /// In the order of the file.
    pub(super) pieces: Vec<Piece>,
    /// The bodies of schema and channel records outside chunks, in the order of the file.
    pub(super) definitions: Vec<(u8, Range<usize>)>,
    /// The bodies of metadata records, in the order of the file.
    pub(super) metadata: Vec<Range<usize>>,
    /// Offset of the end of the data section; `None` for a file without its end mark.
    pub(super) data_end: Option<usize>,
    pub(super) damage: Damage,
}

impl Layout {
    /// Finds the parts of a file that begins with the magic bytes.
    pub(super) fn find(bytes: &[u8]) -> Self {
        let mut finder = Finder { layout: Self::default(), open: Open::Nothing };
        let mut at = MAGIC.len();
        while at < bytes.len() && finder.layout.data_end.is_none() {
            match sound_record_at(bytes, at) {
                Ok(record) => {
                    at = record.end();
                    finder.add(&record);
                }
                // Closed by its magic bytes although its end mark is gone.
                Err(_) if bytes.get(at..) == Some(MAGIC) => break,
                Err(why) => {
                    finder.close(false);
                    let inside = cut_chunk(bytes, at);
                    let next = inside.unwrap_or_else(|| resynchronise(bytes, at + 1));
                    let chunk = inside.is_none() && bytes.get(at) == Some(&op::CHUNK);
                    finder.layout.damage.add(at, why, Lost { bytes: next - at, chunk, messages: None });
                    at = next;
                }
            }
        }
        let finished = finder.layout.data_end.is_some();
        finder.close(finished);
        finder.layout
    }
}

/// Piece that the next record may extend.
enum Open {
    Nothing,
    Chunk { counts: Vec<(u16, u64)>, index: Range<usize> },
    Run { bytes: Range<usize>, counts: Vec<(u16, u64)> },
}

struct Finder {
    layout: Layout,
    open: Open,
}

impl Finder {
    fn add(&mut self, record: &Record<'_>) {
        let body = record.end() - record.body.len()..record.end();
        match record.opcode {
            op::CHUNK => {
                self.close(true);
                let piece =
                    Piece { kind: PieceKind::Chunk, bytes: body, counts: None, index: record.end()..record.end() };
                self.layout.pieces.push(piece);
                self.open = Open::Chunk { counts: Vec::new(), index: record.end()..record.end() };
            }
            op::MESSAGE_INDEX => {
                if let (Open::Chunk { counts, index }, Some(entry)) = (&mut self.open, MessageIndex::parse(record.body))
                {
                    index.end = record.end();
                    count(counts, entry.channel, entry.count());
                }
            }
            op::MESSAGE => {
                let Some(message) = Message::parse(record.body) else { return };
                if !matches!(self.open, Open::Run { .. }) {
                    self.close(true);
                    self.open = Open::Run { bytes: record.start..record.start, counts: Vec::new() };
                }
                self.extend_run(record, Some(message.channel));
            }
            op::SCHEMA | op::CHANNEL => {
                self.layout.definitions.push((record.opcode, body));
                self.extend_run(record, None);
            }
            op::METADATA => {
                self.close(true);
                self.layout.metadata.push(body);
            }
            op::DATA_END | op::FOOTER => {
                self.close(true);
                self.layout.data_end = Some(record.end());
            }
            _ => self.close(true),
        }
    }

    fn extend_run(&mut self, record: &Record<'_>, channel: Option<u16>) {
        if let Open::Run { bytes, counts } = &mut self.open {
            bytes.end = record.end();
            if let Some(channel) = channel {
                count(counts, channel, 1);
            }
            if bytes.len() >= RUN {
                self.close(true);
            }
        } else {
            self.close(true);
        }
    }

    /// Ends what is open. An index is believed only when something `sound` follows it: else the rest of it may be lost.
    fn close(&mut self, sound: bool) {
        match std::mem::replace(&mut self.open, Open::Nothing) {
            Open::Chunk { counts, index } if sound && !index.is_empty() => {
                if let Some(piece) = self.layout.pieces.last_mut() {
                    (piece.counts, piece.index) = (Some(counts), index);
                }
            }
            Open::Run { bytes, counts } => {
                let index = bytes.end..bytes.end;
                self.layout.pieces.push(Piece { kind: PieceKind::Records, bytes, counts: Some(counts), index });
            }
            Open::Nothing | Open::Chunk { .. } => {}
        }
    }
}

/// Adds to the count of a channel; counts are in the order of the channels.
fn count(counts: &mut Vec<(u16, u64)>, channel: u16, more: u64) {
    if more == 0 {
        return;
    }
    match counts.binary_search_by_key(&channel, |(counted_channel, _)| *counted_channel) {
        Ok(at) => counts[at].1 += more,
        Err(at) => counts.insert(at, (channel, more)),
    }
}

/// Offset of the first record in an uncompressed chunk that is longer than the file. Its records are read as if they
/// stood outside.
fn cut_chunk(bytes: &[u8], at: usize) -> Option<usize> {
    let body = bytes.get(at..)?.split_first().filter(|(opcode, _)| **opcode == op::CHUNK)?.1.get(8..)?;
    let begin = at + RECORD_HEAD + Chunk::uncompressed_records_at(body)?;
    sound_record_at(bytes, begin).is_ok().then_some(begin)
}

/// The first place from `from` on where a believable record begins; the file's end when there is none.
fn resynchronise(bytes: &[u8], from: usize) -> usize {
    let rest = bytes.get(from..).unwrap_or_default();
    rest.iter()
        .enumerate()
        .filter(|(_, opcode)| matches!(**opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK | op::DATA_END))
        .map(|(offset, _)| from + offset)
        .find(|&at| believable(bytes, at))
        .unwrap_or(bytes.len())
}

fn believable(bytes: &[u8], at: usize) -> bool {
    let Ok(record) = sound_record_at(bytes, at) else { return false };
    match record.opcode {
        // Three lengths that agree to the byte are no accident.
        op::CHUNK => Chunk::parse(record.body).is_some_and(|chunk| chunk.fills_its_record),
        op::DATA_END => {
            record_at(bytes, record.end()).is_ok_and(|next| (op::HEADER..=op::DATA_END).contains(&next.opcode))
        }
        _ => chain(bytes, record.end()),
    }
}

/// Returns true if sound records follow each other from `at` on, or reach the file's end.
fn chain(bytes: &[u8], mut at: usize) -> bool {
    for _ in 1..CHAIN {
        if at == bytes.len() {
            return true;
        }
        match sound_record_at(bytes, at) {
            Ok(record) if record.opcode == op::FOOTER => return true,
            Ok(record) if record.opcode <= op::DATA_END => at = record.end(),
            _ => return false,
        }
    }
    true
}

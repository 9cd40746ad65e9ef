//! Offsets of the records of a file, by a scan from head to head.

use std::{collections::BTreeMap, ops::Range};

use fleetfoot_data::{Cancelled, Progress};

use super::{
    entries::Entries,
    record::{CUT, Record},
};
use crate::{
    Error,
    container::{Damage, Lost, Map, Span},
};

/// Bytes after which a piece ends.
const PIECE: usize = 1 << 20;

/// Sound records in a row that make a place after damage believable.
const CHAIN: usize = 3;

/// Bytes before the text of a file's head: magic, version, length of the text.
const HEADER: usize = 12;

/// A part of a file that is read as a whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Piece {
    /// Sound records one after the other.
    pub(super) bytes: Range<usize>,
    /// Values with a time, by their topic among those found.
    pub(super) topics: BTreeMap<usize, Span>,
}

/// Result of a scan from head to head of a file.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// The text of the file's head.
    pub(super) header: String,
    /// In the order of the file.
    pub(super) pieces: Vec<Piece>,
    pub(super) entries: Entries,
    pub(super) damage: Damage,
}

/// Finds the parts of a file that begins with the magic bytes.
///
/// # Errors
/// A user who stops.
pub(super) fn scan(map: &Map, progress: &dyn Progress) -> Result<Scan, Error> {
    progress.stage("finding messages");
    let mut scan = Scan::default();
    let length = map.get(8..HEADER).and_then(|bytes| bytes.first_chunk()).map(|bytes| u32::from_le_bytes(*bytes));
    let text = length.and_then(|length| map.get(HEADER..HEADER.checked_add(usize::try_from(length).ok()?)?));
    let Some(text) = text else {
        let lost = Lost { bytes: map.len(), chunk: false, messages: None };
        scan.damage.add(0, "the file ends inside its header", lost);
        return Ok(scan);
    };
    scan.header = String::from_utf8_lossy(text).into_owned();
    let mut at = HEADER + text.len();
    let (mut late, mut latest) = (0, Latest::default());
    let mut piece = Piece { bytes: at..at, topics: BTreeMap::new() };
    while at < map.len() {
        match sound_at(map, at, &scan.entries) {
            Ok(record) => {
                at = record.end;
                scan.entries.add(&record);
                if let Some(topic) = scan.entries.topic_of(&record) {
                    latest.add(record.time);
                    match record.nanoseconds() {
                        Some(time) => {
                            let span = Span { count: 1, first: time, last: time };
                            piece.topics.entry(topic).and_modify(|known_span| known_span.join(&span)).or_insert(span);
                        }
                        None => late += 1,
                    }
                }
                piece.bytes.end = at;
                if piece.bytes.len() >= PIECE {
                    scan.close(map, &mut piece, at);
                    if progress.cancelled() {
                        return Err(Cancelled.into());
                    }
                }
            }
            Err(why) => {
                let next =
                    (at + 1..map.len()).find(|&at| believable(map, at, &scan.entries, &latest)).unwrap_or(map.len());
                let cut = map
                    .cut
                    .as_deref()
                    .unwrap_or("the file ends inside a record: it was cut, or its writer was stopped");
                let why = if why == CUT && next == map.len() { cut } else { why };
                scan.damage.add(at, why, Lost { bytes: next - at, chunk: false, messages: None });
                at = next;
                scan.close(map, &mut piece, at);
                if progress.cancelled() {
                    return Err(Cancelled.into());
                }
            }
        }
    }
    scan.close(map, &mut piece, at);
    if late > 0 {
        let lost = Lost { messages: Some(late), ..Lost::default() };
        scan.damage.add(0, &format!("{late} values with times far after the others in the file"), lost);
    }
    if let Some(cut) = map.cut.as_ref().filter(|_| scan.damage.is_empty()) {
        scan.damage.add(map.len(), cut, Lost { messages: None, ..Lost::default() });
    }
    Ok(scan)
}

impl Scan {
    /// Ends the piece under way, and begins the next at a place; one without values is none.
    fn close(&mut self, map: &Map, piece: &mut Piece, next: usize) {
        map.release(piece.bytes.clone());
        let done = std::mem::replace(piece, Piece { bytes: next..next, topics: BTreeMap::new() });
        if !done.topics.is_empty() {
            self.pieces.push(done);
        }
    }
}

fn judge<'a>(map: &'a [u8], at: usize, entries: &Entries) -> Result<Record<'a>, &'static str> {
    let record = Record::at(map, at)?;
    entries.believe(&record)?;
    Ok(record)
}

/// The record at a place, if it is sound and another one follows it. What follows the start of an entry may be of that entry.
fn sound_at<'a>(map: &'a [u8], at: usize, entries: &Entries) -> Result<Record<'a>, &'static str> {
    let record = judge(map, at, entries)?;
    match judge(map, record.end, entries) {
        Ok(_) | Err(CUT) => Ok(record),
        Err(_) if record.entry == 0 || record.end == map.len() => Ok(record),
        Err(_) => Err("a record without a valid record after it"),
    }
}

/// True if sound records follow each other from an offset on, with times near the latest ones. Many bytes look like a
/// short record by chance.
fn believable(map: &[u8], mut at: usize, entries: &Entries, latest: &Latest) -> bool {
    for _ in 0..CHAIN {
        let Ok(record) = judge(map, at, entries) else { return false };
        if record.entry != 0 && !latest.is_near(record.time) {
            return false;
        }
        at = record.end;
    }
    true
}

/// Times of the latest values, microseconds.
#[derive(Debug, Default)]
struct Latest {
    times: [u64; 3],
    count: usize,
}

impl Latest {
    fn add(&mut self, time: u64) {
        if let Some(place) = self.times.get_mut(self.count % 3) {
            *place = time;
        }
        self.count += 1;
    }

    /// True if a value of this time may come next; the median of three survives one damaged time.
    fn is_near(&self, time: u64) -> bool {
        let mut times = self.times;
        times.sort_unstable();
        let [_, median, _] = times;
        self.count < 3 || (median.saturating_sub(BACK)..median.saturating_add(AHEAD)).contains(&time)
    }
}

/// Largest distance in time of a value behind damage, before and after the latest ones, microseconds.
const BACK: u64 = 10_000_000;
const AHEAD: u64 = 3_600_000_000;

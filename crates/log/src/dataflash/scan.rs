//! Offsets of the messages of a log, and their definitions.

use std::{collections::HashMap, ops::Range};

use fleetfoot_data::{Cancelled, Progress};

use super::{
    definitions::Definitions,
    format::{Field, Form, Format, bytes_of, number_in, stamp, text_in},
    record::{CUT, Record},
};
use crate::{
    Error,
    container::{Damage, Lost, Map, Span},
};

/// Bytes after which a piece ends.
const PIECE: usize = 1 << 20;

/// Sound messages in a row that make a place after damage believable.
const CHAIN: usize = 3;

/// Topics of one log. Only a damaged field of instances gives more.
const MAX_TOPICS: usize = 4096;

/// A part of a file that is read as a whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Piece {
    /// Sound messages one after the other.
    pub(super) bytes: Range<usize>,
    /// Time of the last message before it, nanoseconds.
    pub(super) before: i64,
    /// Messages that can be read, by their topic among those found.
    pub(super) topics: Vec<(usize, Span)>,
}

/// Result of a scan from head to head of a file.
#[derive(Debug)]
pub(super) struct Scan {
    pub(super) form: Form,
    pub(super) pieces: Vec<Piece>,
    pub(super) definitions: Definitions,
    pub(super) topics: Topics,
    pub(super) damage: Damage,
    pub(super) notes: Vec<String>,
}

/// Topics in the order of their first messages.
#[derive(Debug, Default)]
pub(super) struct Topics {
    /// For each the type and the name.
    pub(super) topic_names: Vec<(u8, String)>,
    /// By type, of which few have more than one byte that tells instances apart.
    places: Vec<Places>,
}

impl Topics {
    /// The topic of a message, if it has one.
    pub(super) fn of(&self, kind: u8, format: &Format, payload: &[u8]) -> Option<usize> {
        let places = self.places.get(usize::from(kind))?;
        match key(format, payload) {
            [] => places.only,
            [instance] => *places.bytes.get(usize::from(*instance))?,
            key => places.others.get(key).copied(),
        }
    }

    /// The topic of a message, which may be its first.
    fn take(&mut self, kind: u8, format: &Format, payload: &[u8]) -> Option<usize> {
        if let Some(number_of_topic) = self.of(kind, format, payload) {
            return Some(number_of_topic);
        }
        if self.topic_names.len() >= MAX_TOPICS {
            return None;
        }
        let key = key(format, payload);
        let instance = format.instance.and_then(|field| instance(key, field)).filter(|instance| instance != "0");
        let name = instance.map_or_else(
            || format!("/{}", format.name),
            |number_of_topic| format!("/{}.{number_of_topic}", format.name),
        );
        self.places.resize_with(256, Places::default);
        let (number_of_topic, topic) = (self.places.get_mut(usize::from(kind))?, self.topic_names.len());
        match key {
            [] => number_of_topic.only = Some(topic),
            [instance] => {
                number_of_topic.bytes.resize(256, None);
                *number_of_topic.bytes.get_mut(usize::from(*instance))? = Some(topic);
            }
            key => drop(number_of_topic.others.insert(key.to_vec(), topic)),
        }
        self.topic_names.push((kind, name));
        Some(topic)
    }
}

/// The topics of a type by the bytes of the field of instances: none, one or several.
#[derive(Debug, Default)]
struct Places {
    only: Option<usize>,
    bytes: Vec<Option<usize>>,
    others: HashMap<Vec<u8>, usize>,
}

/// The bytes that tell an instance.
fn key<'a>(format: &Format, payload: &'a [u8]) -> &'a [u8] {
    format.instance.and_then(|field| bytes_of(payload, field)).unwrap_or_default()
}

/// An instance as topics name it.
fn instance(bytes: &[u8], field: Field) -> Option<String> {
    let text = match field.letter {
        b'n' | b'N' | b'Z' => text_in(bytes),
        letter => number_in(bytes, letter)?,
    };
    let text: String = text
        .chars()
        .map(|symbol| if symbol.is_ascii_alphanumeric() || "_-".contains(symbol) { symbol } else { '_' })
        .collect();
    (!text.is_empty()).then_some(text)
}

/// Finds the parts of a log.
///
/// # Errors
/// A user who stops.
pub(super) fn scan(map: &Map, form: Form, progress: &dyn Progress) -> Result<Scan, Error> {
    progress.stage("finding messages");
    let mut walk =
        Walk { map, form, definitions: Definitions::new(form), damage: Damage::default(), parts: Vec::new() };
    walk.walk(progress)?;
    let Walk { definitions, damage, parts, .. } = walk;
    let mut scan = Scan { form, pieces: Vec::new(), definitions, topics: Topics::default(), damage, notes: Vec::new() };
    scan.count(map, parts, progress)?;
    scan.notes.extend(std::mem::take(&mut scan.definitions.notes));
    Ok(scan)
}

/// The first way through a log: what is sound, and what it defines.
struct Walk<'a> {
    map: &'a Map,
    form: Form,
    definitions: Definitions,
    damage: Damage,
    parts: Vec<Range<usize>>,
}

impl<'a> Walk<'a> {
    fn walk(&mut self, progress: &dyn Progress) -> Result<(), Error> {
        let (mut at, mut start) = (0, 0);
        while at < self.map.len() {
            match self.sound_at(at) {
                Ok(record) => {
                    self.definitions.add(record.kind, &record.payload);
                    at = record.end;
                    if at - start >= PIECE {
                        self.close(start..at);
                        start = at;
                        if progress.cancelled() {
                            return Err(Cancelled.into());
                        }
                    }
                }
                Err(why) => {
                    self.close(start..at);
                    at = self.damaged(at, why);
                    start = at;
                }
            }
        }
        self.close(start..at);
        if let Some(cut) = self.map.cut.as_ref().filter(|_| self.damage.is_empty()) {
            self.damage.add(self.map.len(), cut, Lost { messages: None, ..Lost::default() });
        }
        Ok(())
    }

    fn close(&mut self, part: Range<usize>) {
        if !part.is_empty() {
            self.map.release(part.clone());
            self.parts.push(part);
        }
    }

    fn sound_at(&self, at: usize) -> Result<Record<'a>, &'static str> {
        let map: &'a [u8] = self.map;
        let record = self.form.record(map, at, &self.definitions.formats)?;
        match self.form.may_begin(map, record.end) || padding(map, record.end) {
            true => Ok(record),
            false => Err("a message without a valid message after it"),
        }
    }

    /// Passes over what cannot be read, up to the next place where messages follow each other; answers where that is.
    fn damaged(&mut self, at: usize, why: &'static str) -> usize {
        // A line has its end, whatever is in it. Pages of a chip are filled up.
        if (self.form == Form::Text && self.is_blank(at)) || padding(self.map, at) {
            return self.form.next(self.map, at).filter(|_| self.form == Form::Text).unwrap_or(self.map.len());
        }
        let mut next = self.form.next(self.map, at);
        while let Some(place) = next.filter(|&place| !self.believable(place)) {
            next = self.form.next(self.map, place);
        }
        let end = next.unwrap_or(self.map.len());
        let cut =
            self.map.cut.as_deref().unwrap_or("the file ends inside a message: it was cut, or its writer was stopped");
        let why = if why == CUT && end == self.map.len() { cut } else { why };
        self.damage.add(at, why, Lost { bytes: end - at, chunk: false, messages: None });
        end
    }

    fn is_blank(&self, at: usize) -> bool {
        let rest = self.map.get(at..).unwrap_or_default();
        rest.iter().take_while(|&&byte| byte != b'\n').all(u8::is_ascii_whitespace) && rest.contains(&b'\n')
    }

    /// True if sound messages follow each other from an offset on, or one reaches the end.
    fn believable(&self, mut at: usize) -> bool {
        if self.form == Form::Text {
            return true;
        }
        for _ in 0..CHAIN {
            let Ok(record) = self.sound_at(at) else { return false };
            at = record.end;
            if at == self.map.len() {
                return true;
            }
        }
        true
    }
}

/// True if only the padding of a page follows.
fn padding(bytes: &[u8], at: usize) -> bool {
    let rest = bytes.get(at..).unwrap_or_default();
    let fill = |value: u8| rest.iter().all(|&byte| byte == value);
    rest.len() <= PAGE && (fill(0) || fill(0xff))
}

/// Bytes of a page of the chips that logs were written to, and its head.
const PAGE: usize = 528;

impl Scan {
    /// The second way through a log: topics, counts and times.
    fn count(&mut self, map: &Map, parts: Vec<Range<usize>>, progress: &dyn Progress) -> Result<(), Error> {
        let (mut last, mut late, mut beyond) = (0_i64, 0_u64, 0_u64);
        for bytes in parts {
            let (before, mut spans) = (last, Vec::<Option<Span>>::new());
            let mut at = bytes.start;
            while at < bytes.end
                && let Ok(record) = self.form.head(map, at, &self.definitions.formats)
            {
                at = record.end;
                let Some(format) = self.definitions.formats.get(record.kind).filter(|format| format.is_topic()) else {
                    continue;
                };
                match stamp(format, &record.payload, last) {
                    Some(time) => last = time,
                    None => {
                        late += 1;
                        continue;
                    }
                }
                match self.topics.take(record.kind, format, &record.payload) {
                    Some(topic) => {
                        let span = Span { count: 1, first: last, last };
                        spans.resize(spans.len().max(topic + 1), None);
                        match spans.get_mut(topic) {
                            Some(Some(known_span)) => known_span.join(&span),
                            Some(none) => *none = Some(span),
                            None => {}
                        }
                    }
                    None => beyond += 1,
                }
            }
            map.release(bytes.clone());
            if progress.cancelled() {
                return Err(Cancelled.into());
            }
            let some = spans.into_iter().enumerate().filter_map(|(topic, span)| Some((topic, span?)));
            let topics: Vec<(usize, Span)> = some.collect();
            if !topics.is_empty() {
                self.pieces.push(Piece { bytes, before, topics });
            }
        }
        for (count, what) in
            [(late, "messages with times far after the others"), (beyond, "messages of too many instances")]
        {
            if count > 0 {
                let lost = Lost { messages: Some(count), ..Lost::default() };
                self.damage.add(0, &format!("{count} {what} in the file"), lost);
            }
        }
        Ok(())
    }
}

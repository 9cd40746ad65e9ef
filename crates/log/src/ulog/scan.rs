//! Layout of the messages in a file, from their heads.

use std::ops::Range;

use fleetfoot_data::{Cancelled, Progress};

use super::{
    about::About,
    definitions::{Definitions, Untimed},
    message::{Belief, CUT, Entry, HEADER, Message, Subscription, format},
};
use crate::{
    Error,
    container::{Damage, Lost, Map, Span},
};

/// Bytes after which a piece ends.
const PIECE: usize = 1 << 20;

/// Sound messages in a row that make a place after damage believable.
const CHAIN: usize = 3;

/// Of the flags without which a file cannot be read: data were appended, at offsets that the flags name.
const APPENDED: u8 = 1;

/// Byte of the format's version, and the latest version.
const VERSION: usize = 7;
const LATEST: u8 = 1;

/// Byte of the time at which the file begins, microseconds.
const BEGINNING: usize = 8;

/// Places that appended data may have.
const APPENDED_PLACES: usize = 3;

/// A part of a file that is read as a whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Piece {
    /// Sound messages one after the other.
    pub(super) bytes: Range<usize>,
    /// Messages that can be read, by their topic.
    pub(super) topics: Vec<(usize, Span)>,
}

/// Result of the scan over a file's message heads.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// In the order of the file.
    pub(super) pieces: Vec<Piece>,
    pub(super) definitions: Definitions,
    pub(super) about: About,
    pub(super) dropouts: Dropouts,
    pub(super) damage: Damage,
    pub(super) notes: Vec<String>,
    /// For each topic found, messages that cannot be read for its format.
    pub(super) unreadable: Vec<u64>,
}

/// Messages that the writer could not write.
#[derive(Debug, Default)]
pub(super) struct Dropouts {
    count: u64,
    /// Milliseconds, in all and at most.
    total: u64,
    longest: u16,
    /// The latest time before each, nanoseconds; rises.
    pub(super) after: Vec<i64>,
}

impl Dropouts {
    /// Adds a dropout behind data of a time.
    fn add(&mut self, payload: &[u8], last: Option<i64>) {
        let Some(&duration) = payload.first_chunk::<2>() else { return };
        let duration = u16::from_le_bytes(duration);
        self.count += 1;
        self.total += u64::from(duration);
        self.longest = self.longest.max(duration);
        if let Some(last) = last
            && self.after.last() != Some(&last)
        {
            self.after.push(last);
        }
    }

    /// Note for the user, if there were dropouts.
    pub(super) fn note(&self) -> Option<String> {
        let seconds = |milliseconds: u64| milliseconds as f64 / 1e3;
        (self.count > 0).then(|| {
            let which = if self.count == 1 { "1 dropout".to_owned() } else { format!("{} dropouts", self.count) };
            let (total, longest) = (seconds(self.total), seconds(self.longest.into()));
            format!(
                "{which} of {total} s in all, the longest of {longest} s: messages that its writer lost; taken as gaps"
            )
        })
    }
}

/// Finds the parts of a file that begins with the magic bytes.
///
/// # Errors
/// Flags that only a newer reader understands; a user who stops.
pub(super) fn scan(map: &Map, refuse: impl Fn(String) -> Error, progress: &dyn Progress) -> Result<Scan, Error> {
    let mut scanner = Scanner::new(map);
    if map.len() < HEADER {
        scanner.lose(0, "the file ends inside its header", map.len(), None);
    } else if map.get(VERSION).is_some_and(|&version| version > LATEST) {
        scanner.scan.notes.push("its version is newer than the known ones".to_owned());
    }
    progress.stage("finding messages");
    for end in scanner.sections().map_err(refuse)? {
        scanner.section(end, progress)?;
    }
    Ok(scanner.finish())
}

struct Scanner<'a> {
    map: &'a Map,
    at: usize,
    scan: Scan,
    /// The bytes of the piece under way; the topics that it has, and for each topic found its messages there.
    piece: Option<Range<usize>>,
    touched: Vec<usize>,
    spans: Vec<Option<Span>>,
    /// The latest time of data up to now; the file's beginning from its first subscription or logged text on.
    last: Option<i64>,
    /// Messages of channels that nothing defines, and with times beyond all; how many and where the first is.
    unknown: (u64, usize),
    late: (u64, usize),
    /// Messages of types that are not known.
    foreign: u64,
    /// Values whose key has no type or no name.
    nameless: u64,
}

impl<'a> Scanner<'a> {
    fn new(map: &'a Map) -> Self {
        Self {
            map,
            at: HEADER,
            scan: Scan::default(),
            piece: None,
            touched: Vec::new(),
            spans: Vec::new(),
            last: None,
            unknown: (0, 0),
            late: (0, 0),
            foreign: 0,
            nameless: 0,
        }
    }

    /// Ends of the parts of the file that were written one after the other. If data were appended, the part before may
    /// end inside a message.
    fn sections(&mut self) -> Result<Vec<usize>, String> {
        let length = self.map.len();
        let flags =
            Message::at(self.map, HEADER).ok().filter(|message| message.kind == b'B' && message.belief().is_ok());
        let Some(flags) = flags else { return Ok(vec![length]) };
        let (incompatible, offsets) =
            flags.payload.get(8..).and_then(|rest| rest.split_at_checked(8)).unwrap_or_default();
        let unknown = incompatible.iter().enumerate().find_map(|(place, &byte)| {
            let unknown = if place == 0 { byte & !APPENDED } else { byte };
            (unknown != 0).then(|| 8 * place + unknown.trailing_zeros() as usize)
        });
        if let Some(bit) = unknown {
            return Err(format!(
                "bit {bit} of its incompatible flags is set and unknown, so the file cannot be read reliably"
            ));
        }
        let mut ends = Vec::new();
        let (words, _) = offsets.as_chunks::<8>();
        let words = words.iter().take(APPENDED_PLACES).map(|word| u64::from_le_bytes(*word)).filter(|&word| word != 0);
        for offset in words.filter(|_| incompatible.first().is_some_and(|flags| flags & APPENDED != 0)) {
            let believed =
                usize::try_from(offset).ok().filter(|&end| end > *ends.last().unwrap_or(&HEADER) && end < length);
            match believed {
                Some(end) => ends.push(end),
                None => self.scan.notes.push(format!(
                    "its flags say that data were appended at byte {offset}, of {length}: this is ignored"
                )),
            }
        }
        ends.push(length);
        Ok(ends)
    }

    fn section(&mut self, end: usize, progress: &dyn Progress) -> Result<(), Error> {
        while self.at < end {
            match self.sound_at(self.at, end) {
                Ok(message) => {
                    self.at = message.end();
                    self.add(&message);
                }
                Err(why) => self.damaged(why, end),
            }
            if self.piece.is_none() && progress.cancelled() {
                return Err(Cancelled.into());
            }
        }
        self.close();
        Ok(())
    }

    /// The message at a place of a section, if it is believable.
    fn sound_at(&self, at: usize, end: usize) -> Result<Message<'a>, &'static str> {
        let (message, belief) = self.judge(at, end)?;
        let next = message.end();
        match belief {
            Belief::Open if next < end => {
                self.judge(next, end).map(|_| message).map_err(|_| "a message of no known kind")
            }
            _ => Ok(message),
        }
    }

    fn judge(&self, at: usize, end: usize) -> Result<(Message<'a>, Belief), &'static str> {
        let message = Message::at(self.map.get(..end).unwrap_or_default(), at)?;
        let belief = match (message.kind, self.scan.definitions.channel(&message)) {
            (b'D', Some((channel, data))) => match channel.time(data) {
                Err(Untimed::Length) => return Err("a message whose length does not fit its format"),
                Err(Untimed::Format) => Belief::Open,
                Ok(_) | Err(Untimed::Late) => Belief::Sound,
            },
            (b'D', None) if message.payload.len() < 2 => return Err("a message without its head"),
            (b'D', None) => Belief::Open,
            _ => message.belief()?,
        };
        Ok((message, belief))
    }

    /// Passes over what cannot be read.
    fn damaged(&mut self, why: &'static str, end: usize) {
        self.close();
        let start = self.at;
        let next = (start + 1..end).find(|&at| self.believable(at, end)).unwrap_or(end);
        let why = match (next == end && why == CUT, end == self.map.len(), &self.map.cut) {
            (true, true, Some(cut)) => cut.as_str(),
            (true, true, None) => "the file ends inside a message: it was cut, or its writer was stopped",
            (true, false, _) => "a message was cut, and data appended behind it",
            _ => why,
        };
        let why = why.to_owned();
        self.lose(start, &why, next - start, None);
        self.at = next;
    }

    /// Returns true if sound messages follow each other from a place on, or one at least reaches the end.
    fn believable(&self, mut at: usize, end: usize) -> bool {
        // Data of numbers that are subscribed for on the way are as sound as the subscription.
        let mut subscribed: Vec<usize> = Vec::new();
        for _ in 0..CHAIN {
            let Ok((message, belief)) = self.judge(at, end) else { return false };
            let is_new = || message.data().is_some_and(|(id, _)| subscribed.contains(&id));
            if belief != Belief::Sound && !is_new() {
                return false;
            }
            if let (b'A', Some(subscription)) = (message.kind, Subscription::parse(message.payload)) {
                subscribed.push(subscription.id.into());
            }
            at = message.end();
            if at == end {
                return true;
            }
        }
        true
    }

    fn lose(&mut self, at: usize, why: &str, bytes: usize, messages: Option<u64>) {
        self.scan.damage.add(at, why, Lost { bytes, chunk: false, messages });
    }

    fn add(&mut self, message: &Message<'_>) {
        let piece = self.piece.get_or_insert(message.start..message.start);
        piece.end = message.end();
        let full = piece.len() >= PIECE;
        if matches!(message.kind, b'A' | b'L' | b'C') && self.last.is_none() {
            self.last = Some(self.beginning());
        }
        match message.kind {
            b'D' | b'L' | b'C' => self.add_data(message),
            b'F' => self.add_format(message),
            b'A' => {
                if let Some(subscription) = Subscription::parse(message.payload) {
                    self.scan.definitions.subscribe(&subscription, message.start);
                }
            }
            b'I' | b'P' if Entry::parse(message.payload).is_some() => self.scan.about.add(message, self.last),
            b'M' | b'Q' if Entry::parse_flagged(message.payload).is_some() => self.scan.about.add(message, self.last),
            b'O' => self.scan.dropouts.add(message.payload, self.last),
            b'I' | b'M' | b'P' | b'Q' => self.nameless += 1,
            _ => self.foreign += u64::from(!message.is_known()),
        }
        if full {
            self.close();
        }
    }

    /// When the file begins, nanoseconds.
    fn beginning(&self) -> i64 {
        let time = self.map.get(BEGINNING..HEADER).and_then(|bytes| bytes.first_chunk::<8>());
        let time = time.and_then(|bytes| i64::try_from(u64::from_le_bytes(*bytes)).ok());
        time.and_then(|time| time.checked_mul(1000)).unwrap_or(0)
    }

    fn add_data(&mut self, message: &Message<'_>) {
        let count = |(count, first): &mut (u64, usize)| {
            if *count == 0 {
                *first = message.start;
            }
            *count += 1;
        };
        let Some((channel, data)) = self.scan.definitions.channel(message) else {
            return count(&mut self.unknown);
        };
        let topic = channel.topic;
        match channel.time(data) {
            Ok(time) => {
                if message.kind == b'D' {
                    self.last = self.last.max(Some(time));
                }
                self.spans.resize(self.spans.len().max(topic + 1), None);
                let span = Span { count: 1, first: time, last: time };
                match &mut self.spans[topic] {
                    Some(known_span) => known_span.join(&span),
                    none => {
                        *none = Some(span);
                        self.touched.push(topic);
                    }
                }
            }
            Err(Untimed::Late) => count(&mut self.late),
            Err(_) => {
                let unreadable = &mut self.scan.unreadable;
                unreadable.resize(unreadable.len().max(topic + 1), 0);
                unreadable[topic] += 1;
            }
        }
    }

    fn add_format(&mut self, message: &Message<'_>) {
        let text = format(message.payload).and_then(|(name, fields)| {
            let sound = fields.iter().all(|&byte| byte == b' ' || byte.is_ascii_graphic());
            Some((name, std::str::from_utf8(fields).ok().filter(|_| sound)?))
        });
        match text {
            Some((name, fields)) => self.scan.definitions.add_format(name, fields),
            None => self.lose(message.start, "a format that is not text", message.end() - message.start, None),
        }
    }

    /// Ends the piece under way; one without messages to read is none.
    fn close(&mut self) {
        let Some(bytes) = self.piece.take() else { return };
        // The system maps more around each head that was looked at than was asked for.
        self.map.release(bytes.clone());
        let spans = &mut self.spans;
        let topics: Vec<(usize, Span)> =
            self.touched.drain(..).filter_map(|topic| Some((topic, spans.get_mut(topic)?.take()?))).collect();
        if !topics.is_empty() {
            self.scan.pieces.push(Piece { bytes, topics });
        }
    }

    fn finish(mut self) -> Scan {
        for ((count, first), why) in
            [(self.unknown, "messages of undefined channels"), (self.late, "messages with times far after the others")]
        {
            if count > 0 {
                self.lose(first, &format!("{count} {why}, the first of them"), 0, Some(count));
            }
        }
        if self.foreign > 0 {
            self.scan.notes.push(format!("{} messages of unknown types are left out", self.foreign));
        }
        if self.nameless > 0 {
            let (one, more) = ("1 value without a type or a name is", "values without a type or a name are");
            let which = if self.nameless == 1 { one.to_owned() } else { format!("{} {more}", self.nameless) };
            self.scan.notes.push(format!("{which} left out of the file's information"));
        }
        let Scan { notes, definitions, dropouts, .. } = &mut self.scan;
        notes.extend(std::mem::take(&mut definitions.notes));
        notes.extend(dropouts.note());
        if let Some(cut) = self.map.cut.as_ref().filter(|_| self.scan.damage.is_empty()) {
            self.lose(self.map.len(), &cut.clone(), 0, None);
        }
        self.scan
    }
}

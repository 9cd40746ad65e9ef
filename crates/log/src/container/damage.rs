//! Losses in a damaged file.

use std::fmt;

/// Places that are told one by one.
const TOLD: usize = 3;

/// Parts of a file that could not be read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Damage {
    /// Bytes of the file that were skipped.
    pub(crate) bytes_lost: u64,
    /// Chunks that were skipped, as far as they were recognised.
    pub(crate) chunks_lost: u64,
    /// Messages known to be lost.
    pub(crate) messages_lost: u64,
    /// More messages may be lost than are known.
    pub(crate) more_lost: bool,
    /// The first few places, and how many there are in all.
    places: Vec<String>,
    count: u64,
}

impl Damage {
    /// Nothing is damaged.
    pub(crate) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Adds a damaged place of a file.
    pub(crate) fn add(&mut self, at: usize, why: &str, lost: Lost) {
        self.bytes_lost += lost.bytes as u64;
        self.chunks_lost += u64::from(lost.chunk);
        match lost.messages {
            Some(messages) => self.messages_lost += messages,
            None => self.more_lost = true,
        }
        self.count += 1;
        if self.places.len() < TOLD {
            self.places.push(format!("at byte {at}: {why}"));
        }
    }

    /// Another witness tells how many messages were lost up to now.
    pub(crate) fn know_messages(&mut self, messages: u64) {
        (self.messages_lost, self.more_lost) = (messages, false);
    }

    /// Adds what other parts of the recording have lost.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.bytes_lost += other.bytes_lost;
        self.chunks_lost += other.chunks_lost;
        self.messages_lost += other.messages_lost;
        self.more_lost |= other.more_lost;
        self.count += other.count;
        let room = TOLD.saturating_sub(self.places.len());
        self.places.extend(other.places.iter().take(room).cloned());
    }
}

/// Loss at one damaged place.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lost {
    pub(crate) bytes: usize,
    pub(crate) chunk: bool,
    /// `None` if the number is unknown.
    pub(crate) messages: Option<u64>,
}

impl fmt::Display for Damage {
    /// A sentence, e.g. `damaged: 2 chunks, 1,204 bytes and at least 31 messages are lost (at byte 812: ...); the rest is used`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return write!(f, "undamaged");
        }
        let some = |count: u64, what: &str| match count {
            0 => None,
            1 => Some(format!("1 {what}")),
            count => Some(format!("{count} {what}s")),
        };
        let messages = match (self.messages_lost, self.more_lost) {
            (0, true) => Some("an unknown number of messages".to_owned()),
            (count, true) => some(count, "message").map(|text| format!("at least {text}")),
            (count, false) => some(count, "message"),
        };
        let lost: Vec<String> =
            [some(self.chunks_lost, "chunk"), some(self.bytes_lost, "byte"), messages].into_iter().flatten().collect();
        let lost = if lost.is_empty() { "nothing".to_owned() } else { lost.join(", ") };
        let places = self.places.join("; ");
        let more = self.count.saturating_sub(self.places.len() as u64);
        let more = if more > 0 { format!("; and {more} more places") } else { String::new() };
        write!(f, "damaged: lost {lost} ({places}{more}); the rest is used")
    }
}

//! Messages of a ULog file, read in place without copies. Every length is checked against the available bytes.

/// Bytes of the file before its first message: magic, version, time of its beginning.
pub(super) const HEADER: usize = 16;

/// Bytes before a message's payload: its length and its type.
pub(super) const HEAD: usize = 3;

/// The payload of a message that marks a place to go on from.
const SYNC: [u8; 8] = [0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];

/// Why a message that the bytes end in is none.
pub(super) const CUT: &str = "a message is longer than the bytes that are there";

/// A name that is longer is none.
const MAX_NAME: usize = 255;

/// A message, and where it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Message<'a> {
    /// Its type, a letter.
    pub(super) kind: u8,
    /// Offset of its head.
    pub(super) start: usize,
    pub(super) payload: &'a [u8],
}

/// Plausibility of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Belief {
    /// Its parts fit each other.
    Sound,
    /// No contradiction: a sound message must follow.
    Open,
}

impl<'a> Message<'a> {
    /// The message that begins at `at`, or why there is none. `bytes` end where the part of the file does.
    pub(super) fn at(bytes: &'a [u8], at: usize) -> Result<Self, &'static str> {
        let rest = bytes.get(at..).unwrap_or_default();
        let (&[low, high, kind], rest) = rest.split_first_chunk::<HEAD>().ok_or(CUT)?;
        let payload = rest.get(..usize::from(u16::from_le_bytes([low, high])));
        match payload {
            _ if kind == 0 => Err("no message begins here"),
            Some(payload) => Ok(Self { kind, start: at, payload }),
            None => Err(CUT),
        }
    }

    /// Offset of the byte after it.
    pub(super) fn end(&self) -> usize {
        self.start + HEAD + self.payload.len()
    }

    /// The channel of a message with a time, and its bytes. Logged texts have channels of their own, beyond those of a file.
    pub(super) fn data(&self) -> Option<(usize, &'a [u8])> {
        match self.kind {
            b'D' => self.payload.split_first_chunk::<2>().map(|(id, data)| (u16::from_le_bytes(*id).into(), data)),
            b'L' => Some((LOGGED, self.payload)),
            b'C' => Some((LOGGED_TAGGED, self.payload)),
            _ => None,
        }
    }

    /// Returns true if its type is known. Unknown types, of later versions, are to be skipped.
    pub(super) fn is_known(&self) -> bool {
        b"BFIMPQARDLCSO".contains(&self.kind)
    }

    /// Checks that the parts of a message that is no data fit each other.
    pub(super) fn belief(&self) -> Result<Belief, &'static str> {
        let payload = self.payload;
        let (sound, otherwise) = match self.kind {
            b'F' => (format(payload).is_some(), "a malformed format"),
            b'A' => (Subscription::parse(payload).is_some(), "a malformed subscription"),
            // A value whose key has no type or no name says nothing, but ends where it says.
            b'I' | b'P' if Entry::parse(payload).is_none() && has_key(payload) => return Ok(Belief::Open),
            b'M' | b'Q' if Entry::parse_flagged(payload).is_none() && has_key(payload.get(1..).unwrap_or_default()) => {
                return Ok(Belief::Open);
            }
            b'I' | b'P' => (Entry::parse(payload).is_some(), "a value without a name"),
            b'M' | b'Q' => (Entry::parse_flagged(payload).is_some(), "a value without a name"),
            b'R' | b'O' => (payload.len() == 2, "a length that does not fit the message's type"),
            b'S' => (payload == SYNC, "a malformed mark"),
            b'L' | b'C' => return logged(payload, if self.kind == b'L' { 9 } else { 11 }),
            b'B' => (self.start == HEADER && payload.len() >= 40, "flags that do not stand at the beginning"),
            _ => return Ok(Belief::Open),
        };
        if sound { Ok(Belief::Sound) } else { Err(otherwise) }
    }
}

/// Returns true if a value's key is a text of the length that it states.
fn has_key(payload: &[u8]) -> bool {
    let key = payload.split_first().and_then(|(&length, rest)| rest.get(..length.into()));
    key.is_some_and(|key| key.iter().all(|&byte| byte == b' ' || byte.is_ascii_graphic()))
}

/// The channel of logged texts.
pub(super) const LOGGED: usize = 1 << 16;
/// The channel of logged texts with a tag.
pub(super) const LOGGED_TAGGED: usize = LOGGED + 1;

/// Levels are digits, as those of the Linux kernel.
fn logged(payload: &[u8], least: usize) -> Result<Belief, &'static str> {
    match payload.first() {
        _ if payload.len() < least => Err("a logged text without its head"),
        Some(b'0'..=b'7') => Ok(Belief::Sound),
        _ => Ok(Belief::Open),
    }
}

/// The name of a format and its fields. Whether the fields are text is not looked at.
pub(super) fn format(payload: &[u8]) -> Option<(&str, &[u8])> {
    let colon = payload.iter().take(MAX_NAME + 1).position(|&byte| byte == b':')?;
    let (name, fields) = payload.split_at_checked(colon)?;
    Some((name_of(name)?, fields.get(1..)?))
}

fn name_of(bytes: &[u8]) -> Option<&str> {
    let sound = !bytes.is_empty() && bytes.len() <= MAX_NAME && bytes.iter().all(u8::is_ascii_graphic);
    std::str::from_utf8(bytes).ok().filter(|_| sound)
}

/// That data of a format come under a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Subscription<'a> {
    pub(super) instance: u8,
    pub(super) id: u16,
    /// The name of the format.
    pub(super) name: &'a str,
}

impl<'a> Subscription<'a> {
    pub(super) fn parse(payload: &'a [u8]) -> Option<Self> {
        let (&[instance, low, high], name) = payload.split_first_chunk::<3>()?;
        Some(Self { instance, id: u16::from_le_bytes([low, high]), name: name_of(name)? })
    }
}

/// A value with its type and its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry<'a> {
    /// e.g. `float` or `char[12]`.
    pub(super) kind: &'a str,
    pub(super) name: &'a str,
    pub(super) value: &'a [u8],
}

impl<'a> Entry<'a> {
    pub(super) fn parse(payload: &'a [u8]) -> Option<Self> {
        let (&length, rest) = payload.split_first()?;
        let (key, value) = rest.split_at_checked(length.into())?;
        let (kind, name) = std::str::from_utf8(key).ok()?.split_once(' ')?;
        let sound = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_graphic());
        (sound(kind) && sound(name)).then_some(Self { kind, name, value })
    }

    /// As [`Entry::parse`], behind a byte of flags.
    pub(super) fn parse_flagged(payload: &'a [u8]) -> Option<(u8, Self)> {
        let (&flags, rest) = payload.split_first()?;
        Some((flags, Self::parse(rest)?))
    }
}

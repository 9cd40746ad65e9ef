//! Records of a file, read in place. Every length is checked against the bytes that are there.

/// Why a record that the bytes end in is none.
pub(super) const CUT: &str = "a record is longer than the bytes that are there";

/// A record.
#[derive(Debug, Clone, Copy)]
pub(super) struct Record<'a> {
    /// The entry that it is a value of; 0: it is about entries.
    pub(super) entry: u32,
    /// Microseconds.
    pub(super) time: u64,
    pub(super) payload: &'a [u8],
    /// Offset of its head, and of the byte after it.
    pub(super) start: usize,
    pub(super) end: usize,
}

impl<'a> Record<'a> {
    /// The record at a place, or why there is none.
    pub(super) fn at(bytes: &'a [u8], at: usize) -> Result<Self, &'static str> {
        let mut rest = bytes.get(at..).unwrap_or_default();
        let (&head, after) = rest.split_first().ok_or(CUT)?;
        if head & 0x80 != 0 {
            return Err("no record begins here");
        }
        rest = after;
        let mut number = |size: u8| {
            let (bytes, after) = rest.split_at_checked(usize::from(size) + 1)?;
            rest = after;
            Some(bytes.iter().rev().fold(0_u64, |all, &byte| all << 8 | u64::from(byte)))
        };
        let (entry, size, time) = (number(head & 3), number(head >> 2 & 3), number(head >> 4 & 7));
        let (entry, size, time) = (entry.ok_or(CUT)?, size.ok_or(CUT)?, time.ok_or(CUT)?);
        let payload = usize::try_from(size).ok().and_then(|size| rest.get(..size)).ok_or(CUT)?;
        let end = bytes.len() - rest.len() + payload.len();
        Ok(Self { entry: entry as u32, time, payload, start: at, end })
    }

    /// Nanoseconds, if they are a time.
    pub(super) fn nanoseconds(&self) -> Option<i64> {
        i64::try_from(self.time).ok()?.checked_mul(1000)
    }
}

/// Content of a record of the entry 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Control<'a> {
    Start { entry: u32, name: &'a str, kind: &'a str, metadata: &'a str },
    Finish,
    Metadata { entry: u32, metadata: &'a str },
}

impl<'a> Control<'a> {
    pub(super) fn parse(payload: &'a [u8]) -> Option<Self> {
        let (&kind, mut rest) = payload.split_first()?;
        let entry = number(&mut rest)?;
        let control = match kind {
            0 => Self::Start { entry, name: text(&mut rest)?, kind: text(&mut rest)?, metadata: text(&mut rest)? },
            1 => Self::Finish,
            2 => Self::Metadata { entry, metadata: text(&mut rest)? },
            _ => return None,
        };
        rest.is_empty().then_some(control)
    }
}

fn number(rest: &mut &[u8]) -> Option<u32> {
    let (bytes, after) = rest.split_first_chunk::<4>()?;
    *rest = after;
    Some(u32::from_le_bytes(*bytes))
}

/// A text with its length before it.
fn text<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let size = usize::try_from(number(rest)?).ok()?;
    let (bytes, after) = rest.split_at_checked(size)?;
    *rest = after;
    std::str::from_utf8(bytes).ok()
}

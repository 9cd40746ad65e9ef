//! The protobuf wire format: tags, varints, fixed numbers and lengths.
//!
//! <https://protobuf.dev/programming-guides/encoding/>

use crate::DecodeError;

/// Groups inside each other that are skipped; also the depth of messages that are read.
pub(super) const MAX_DEPTH: usize = 64;

/// Wire type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WireType {
    Varint,
    Fixed64,
    Length,
    GroupStart,
    GroupEnd,
    Fixed32,
}

/// Reads a part of a message. Offsets are those of the whole message.
#[derive(Debug, Clone)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Reads a part of the message, cut at the message's end.
    pub(super) fn new(message: &'a [u8], span: (usize, usize)) -> Self {
        let end = span.1.min(message.len());
        Self { bytes: &message[..end], at: span.0.min(end) }
    }

    /// Offset of the next byte.
    pub(super) fn offset(&self) -> usize {
        self.at
    }

    /// The bytes that are left.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.at >= self.bytes.len()
    }

    pub(super) fn error<T>(&self, problem: impl Into<String>) -> Result<T, DecodeError> {
        Err(DecodeError::new(self.at, problem))
    }

    /// The next field's number and form, or none at the end.
    pub(super) fn tag(&mut self) -> Result<Option<(u32, WireType)>, DecodeError> {
        if self.is_empty() {
            return Ok(None);
        }
        let start = self.at;
        let tag = self.varint()?;
        let wire = match tag & 7 {
            0 => WireType::Varint,
            1 => WireType::Fixed64,
            2 => WireType::Length,
            3 => WireType::GroupStart,
            4 => WireType::GroupEnd,
            5 => WireType::Fixed32,
            other => {
                return Err(DecodeError::new(
                    start,
                    format!("a field has the wire type {other}, which protobuf does not have"),
                ));
            }
        };
        match u32::try_from(tag >> 3) {
            Ok(number) if (1..1 << 29).contains(&number) => Ok(Some((number, wire))),
            _ => Err(DecodeError::new(
                start,
                format!("a field has the number {}, which protobuf does not allow", tag >> 3),
            )),
        }
    }

    pub(super) fn varint(&mut self) -> Result<u64, DecodeError> {
        let mut value = 0;
        for (place, &byte) in self.rest().iter().take(10).enumerate() {
            // Bits beyond the 64th are dropped, as by other readers.
            value |= u64::from(byte & 0x7f) << (7 * place);
            if byte < 0x80 {
                self.at += place + 1;
                return Ok(value);
            }
        }
        self.error(if self.rest().len() < 10 {
            "the message ends within a number"
        } else {
            "a number has more than 10 bytes"
        })
    }

    pub(super) fn fixed32(&mut self) -> Result<[u8; 4], DecodeError> {
        self.fixed()
    }

    pub(super) fn fixed64(&mut self) -> Result<[u8; 8], DecodeError> {
        self.fixed()
    }

    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        match self.rest().first_chunk::<N>() {
            Some(&bytes) => {
                self.at += N;
                Ok(bytes)
            }
            None => self.error(format!("a number of {N} bytes is cut off after {}", self.rest().len())),
        }
    }

    /// Start and end of a part with a length; the reader then continues behind it.
    pub(super) fn span(&mut self) -> Result<(usize, usize), DecodeError> {
        let start = self.at;
        let length = self.varint()?;
        let left = self.rest().len();
        match usize::try_from(length) {
            Ok(length) if length <= left => {
                self.at += length;
                Ok((self.at - length, self.at))
            }
            _ => {
                Err(DecodeError::new(start, format!("a field of {length} bytes is announced, but only {left} follow")))
            }
        }
    }

    /// Skips a field whose tag was read.
    pub(super) fn skip(&mut self, number: u32, wire: WireType) -> Result<(), DecodeError> {
        let mut groups = Vec::new();
        let (mut number, mut wire) = (number, wire);
        loop {
            match wire {
                WireType::Varint => drop(self.varint()?),
                WireType::Fixed64 => drop(self.fixed64()?),
                WireType::Fixed32 => drop(self.fixed32()?),
                WireType::Length => drop(self.span()?),
                WireType::GroupStart if groups.len() >= MAX_DEPTH => {
                    return self.error(format!("more than {MAX_DEPTH} groups are nested"));
                }
                WireType::GroupStart => groups.push(number),
                WireType::GroupEnd => match groups.pop() {
                    Some(open) if open == number => (),
                    _ => return self.error(format!("group {number} ends where it was not open")),
                },
            }
            if groups.is_empty() {
                return Ok(());
            }
            match self.tag()? {
                Some(next) => (number, wire) = next,
                None => return self.error(format!("group {number} is not closed")),
            }
        }
    }
}

//! Messages of a log, binary or as text. Every length is checked against the bytes that are there.

use std::borrow::Cow;

use super::format::{Form, Format, Formats, HEAD};

/// First bytes of a binary message; its type follows.
const MARK: [u8; 2] = [0xa3, 0x95];

/// Why a message that the bytes end in is none.
pub(super) const CUT: &str = "a message is longer than the bytes that are there";

/// A message.
#[derive(Debug, Clone)]
pub(super) struct Record<'a> {
    /// The number of its type.
    pub(super) kind: u8,
    /// Its fields, packed: those of a text as [`Format::letters`] say.
    pub(super) payload: Cow<'a, [u8]>,
    /// Offset of the byte after it.
    pub(super) end: usize,
}

impl Form {
    /// The message at a place with as much of its fields as its time and its topic take, of a message that was found
    /// sound: most lines need not be read further.
    pub(super) fn head<'a>(self, bytes: &'a [u8], at: usize, formats: &Formats) -> Result<Record<'a>, &'static str> {
        match self {
            Self::Binary => binary(bytes, at, formats),
            Self::Text => line(bytes, at, formats, Format::head),
        }
    }

    /// The message at a place, or why there is none.
    pub(super) fn record<'a>(self, bytes: &'a [u8], at: usize, formats: &Formats) -> Result<Record<'a>, &'static str> {
        match self {
            Self::Binary => binary(bytes, at, formats),
            Self::Text => line(bytes, at, formats, |_| usize::MAX),
        }
    }

    /// True if a message may begin at an offset, or the bytes end there.
    pub(super) fn may_begin(self, bytes: &[u8], at: usize) -> bool {
        let rest = bytes.get(at..).unwrap_or_default();
        self == Self::Text || MARK.starts_with(rest) || rest.starts_with(&MARK)
    }

    /// The next place behind `at` where a message may begin.
    pub(super) fn next(self, bytes: &[u8], at: usize) -> Option<usize> {
        let rest = bytes.get(at + 1..)?;
        match self {
            Self::Binary => memchr::memmem::find(rest, &MARK).map(|place| at + 1 + place),
            Self::Text => memchr::memchr(b'\n', bytes.get(at..)?).map(|place| at + place + 1),
        }
    }
}

fn binary<'a>(bytes: &'a [u8], at: usize, formats: &Formats) -> Result<Record<'a>, &'static str> {
    let rest = bytes.get(at..).unwrap_or_default();
    let Some((&[first, second, kind], fields)) = rest.split_first_chunk::<HEAD>() else {
        return Err(if MARK.starts_with(rest.get(..2).unwrap_or(rest)) { CUT } else { "no message begins here" });
    };
    if [first, second] != MARK {
        return Err("no message begins here");
    }
    let format = formats.get(kind).ok_or("a message of an undefined type")?;
    let payload = fields.get(..format.length).ok_or(CUT)?;
    Ok(Record { kind, payload: Cow::Borrowed(payload), end: at + HEAD + format.length })
}

/// The message of a line, with as many bytes of its fields as `wanted` says, and those of the last of them.
fn line<'a>(
    bytes: &'a [u8],
    at: usize,
    formats: &Formats,
    wanted: impl Fn(&Format) -> usize,
) -> Result<Record<'a>, &'static str> {
    let rest = bytes.get(at..).unwrap_or_default();
    // A number of the last line may be cut, and would be another one.
    let length = memchr::memchr(b'\n', rest).ok_or(CUT)?;
    let text = std::str::from_utf8(rest.get(..length).unwrap_or_default()).map_err(|_| "a line that is not text")?;
    let text = text.trim_ascii();
    let (name, values) = cut(text, memchr::memchr(b',', text.as_bytes()));
    let (kind, format) = formats.by_name(name.trim_ascii()).ok_or("a message of an undefined type")?;
    let payload =
        packed(format, values.unwrap_or(""), wanted(format)).ok_or("a line whose values do not fit its format")?;
    Ok(Record { kind, payload: Cow::Owned(payload), end: at + length + 1 })
}

/// The text before and after a byte, or all of it.
fn cut(text: &str, at: Option<usize>) -> (&str, Option<&str>) {
    match at.and_then(|at| Some((text.get(..at)?, text.get(at + 1..)?))) {
        Some((before, after)) => (before, Some(after)),
        None => (text, None),
    }
}

/// The values of a line as the fields of a message, up to so many bytes.
fn packed(format: &Format, values: &str, wanted: usize) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(format.length.min(wanted));
    let mut rest = Some(values);
    for (place, &letter) in format.letters.iter().enumerate() {
        if bytes.len() >= wanted {
            break;
        }
        let text = rest?;
        // Texts may have commas in them: the last field is all that is left. Arrays are in brackets.
        let is_last = place + 1 == format.letters.len();
        let end = match (is_last, letter) {
            (true, _) => None,
            (_, b'a') => text.find(']').and_then(|close| Some(close + text.get(close..)?.find(',')?)),
            _ => memchr::memchr(b',', text.as_bytes()),
        };
        let (value, after) = cut(text, end);
        rest = after;
        let value = value.trim_ascii();
        match letter {
            b'd' => bytes.extend_from_slice(&value.parse::<f64>().ok()?.to_le_bytes()),
            b'q' => bytes.extend_from_slice(&whole(value)?.to_le_bytes()),
            b'Q' => bytes.extend_from_slice(&value.parse::<u64>().ok()?.to_le_bytes()),
            b'n' => padded(&mut bytes, value, 4),
            b'N' => padded(&mut bytes, value, 16),
            b'Z' => padded(&mut bytes, value, 64),
            b'a' => {
                let inside = value.trim_start_matches('[').trim_end_matches(']').split(',');
                let numbers = inside.map(|number| number.trim().parse::<i16>().ok());
                let numbers: Vec<i16> = numbers.collect::<Option<_>>().filter(|list: &Vec<i16>| list.len() == 32)?;
                bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
            }
            _ => return None,
        }
    }
    Some(bytes)
}

/// A whole number, that a writer may have written with a decimal point.
fn whole(text: &str) -> Option<i64> {
    text.parse().ok().or_else(|| {
        let number: f64 = text.parse().ok()?;
        (number.fract() == 0.0 && number.abs() < 9e15).then_some(number as i64)
    })
}

/// A text in so many bytes.
fn padded(bytes: &mut Vec<u8>, text: &str, size: usize) {
    let end = bytes.len() + size;
    bytes.extend(text.bytes().take(size));
    bytes.resize(end, 0);
}

//! Rows: cells of a leaf, and the columns of their records.

use std::borrow::Cow;

use super::database::{Database, TextEncoding};

/// A value of a column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value<'a> {
    Null,
    Integer(i64),
    Real(f64),
    Text(String),
    Blob(Cow<'a, [u8]>),
}

/// A row of a table.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    database: &'a Database,
    /// The row's number, which stands for a column declared as its integer primary key.
    pub(crate) id: i64,
    /// Bytes of the record in all.
    length: usize,
    /// As many of them as stand on the leaf.
    local: &'a [u8],
    /// The page on which the others begin; 0 where there are none.
    overflow: u32,
}

/// A variable-length integer, and the bytes behind it.
pub(super) fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    // Most are one byte.
    if let [byte @ 0..0x80, rest @ ..] = bytes {
        return Some((u64::from(*byte), rest));
    }
    let mut value = 0_u64;
    for (place, &byte) in bytes.iter().take(9).enumerate() {
        if place == 8 {
            return Some((value << 8 | u64::from(byte), bytes.get(9..)?));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte < 0x80 {
            return Some((value, bytes.get(place + 1..)?));
        }
    }
    None
}

impl<'a> Row<'a> {
    /// The row whose cell stands at a place of a leaf.
    pub(super) fn at(database: &'a Database, page: &'a [u8], place: usize) -> Option<Self> {
        let usable = database.usable;
        let cell = page.get(place..usable)?;
        let (length, rest) = varint(cell)?;
        let (id, rest) = varint(rest)?;
        // More than all pages have is no length.
        let length = usize::try_from(length).ok().filter(|length| length / usable <= database.pages())?;
        let most = usable - 35;
        let (local, overflow) = if length <= most {
            (rest.get(..length)?, 0)
        } else {
            let least = (usable - 12) * 32 / 255 - 23;
            let fitting = least + (length - least) % (usable - 4);
            let (local, rest) = rest.split_at_checked(if fitting <= most { fitting } else { least })?;
            (local, u32::from_be_bytes(*rest.first_chunk::<4>()?))
        };
        Some(Self { database, id: id as i64, length, local, overflow })
    }

    /// Bytes of the record.
    pub(crate) fn length(&self) -> usize {
        self.length
    }

    /// The whole record; copied where parts of it stand on overflow pages. `None` where their chain breaks.
    fn record(&self) -> Option<Cow<'a, [u8]>> {
        if self.overflow == 0 {
            return Some(Cow::Borrowed(self.local));
        }
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(self.length).ok()?;
        bytes.extend_from_slice(self.local);
        let mut next = self.overflow;
        while bytes.len() < self.length {
            let page = self.database.page(next)?.get(..self.database.usable)?;
            let (head, content) = page.split_first_chunk::<4>()?;
            next = u32::from_be_bytes(*head);
            bytes.extend_from_slice(content.get(..content.len().min(self.length - bytes.len()))?);
        }
        Some(Cow::Owned(bytes))
    }

    /// Integers of some columns, from the bytes on the leaf alone where these have them; `None` where one is no integer.
    pub(crate) fn integers<const N: usize>(&self, columns: [usize; N]) -> Option<[i64; N]> {
        let read = |record: &[u8]| {
            let mut values = [0; N];
            for (value, &column) in values.iter_mut().zip(&columns) {
                let (kind, place) = column_of(record, column)?;
                let Value::Integer(integer) = scalar(kind, record.get(place..)?)? else { return None };
                *value = integer;
            }
            Some(values)
        };
        read(self.local).or_else(|| if self.overflow == 0 { None } else { read(&self.record()?) })
    }

    /// The value of a column; [`Value::Null`] for one that was added to the table after the row. `None` where the record is damaged.
    pub(crate) fn value(&self, column: usize) -> Option<Value<'a>> {
        let record = self.record()?;
        let Some((kind, place)) = column_of(&record, column) else { return Some(Value::Null) };
        let Some(length) = kind.checked_sub(12).map(|rest| rest / 2) else { return scalar(kind, record.get(place..)?) };
        let end = place.checked_add(usize::try_from(length).ok()?)?;
        if kind.is_multiple_of(2) {
            return match record {
                Cow::Borrowed(record) => Some(Value::Blob(Cow::Borrowed(record.get(place..end)?))),
                Cow::Owned(mut record) => {
                    record.truncate(end);
                    if record.len() < end {
                        return None;
                    }
                    record.drain(..place);
                    Some(Value::Blob(Cow::Owned(record)))
                }
            };
        }
        Some(Value::Text(text(record.get(place..end)?, self.database.encoding)))
    }
}

/// The kind of a column's value and its place in the record. `None` for a column that the record does not have.
fn column_of(record: &[u8], column: usize) -> Option<(u64, usize)> {
    let (header, rest) = varint(record)?;
    let header = usize::try_from(header).ok()?;
    let mut kinds = record.get(record.len() - rest.len()..header)?;
    let mut place = header;
    for earlier in 0.. {
        let (kind, rest) = varint(kinds)?;
        if earlier == column {
            return Some((kind, place));
        }
        kinds = rest;
        place = place.checked_add(size(kind)?)?;
    }
    None
}

/// Bytes of a value of a kind.
fn size(kind: u64) -> Option<usize> {
    match kind {
        0 | 8 | 9 => Some(0),
        1..=4 => Some(kind as usize),
        5 => Some(6),
        6 | 7 => Some(8),
        10 | 11 => None,
        kind => usize::try_from((kind - 12) / 2).ok(),
    }
}

/// A value that is neither text nor bytes.
fn scalar<'a>(kind: u64, bytes: &[u8]) -> Option<Value<'a>> {
    let bytes = bytes.get(..size(kind)?)?;
    match kind {
        0 => Some(Value::Null),
        8 | 9 => Some(Value::Integer(kind as i64 - 8)),
        1..=6 => {
            let sign = if bytes.first()? & 0x80 == 0 { 0 } else { -1 };
            Some(Value::Integer(bytes.iter().fold(sign, |value: i64, &byte| value << 8 | i64::from(byte))))
        }
        7 => Some(Value::Real(f64::from_be_bytes(*bytes.first_chunk::<8>()?))),
        _ => None,
    }
}

fn text(bytes: &[u8], encoding: TextEncoding) -> String {
    match encoding {
        TextEncoding::Utf8 => String::from_utf8_lossy(bytes).into_owned(),
        TextEncoding::Utf16 { big } => {
            let unit = |&pair: &[u8; 2]| if big { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) };
            let units: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(unit).collect();
            String::from_utf16_lossy(&units)
        }
    }
}

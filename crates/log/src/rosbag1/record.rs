//! Records of a bag: a header of named fields, and data.

use std::ops::Range;

/// Kinds of records, field `op`.
pub(super) mod op {
    pub(in super::super) const MESSAGE: u8 = 0x02;
    pub(in super::super) const BAG: u8 = 0x03;
    pub(in super::super) const INDEX: u8 = 0x04;
    pub(in super::super) const CHUNK: u8 = 0x05;
    pub(in super::super) const CHUNK_INFO: u8 = 0x06;
    pub(in super::super) const CONNECTION: u8 = 0x07;
}

/// A record within bytes that hold it whole.
#[derive(Debug, Clone)]
pub(super) struct Record<'a> {
    pub(super) op: u8,
    pub(super) header: Header<'a>,
    pub(super) data: &'a [u8],
    /// Place of the data among the bytes that the record was read from.
    pub(super) data_range: Range<usize>,
}

impl<'a> Record<'a> {
    /// The record at a place; `None` where no record can be: lengths that leave the bytes, a header that is none, no `op`.
    pub(super) fn at(bytes: &'a [u8], at: usize) -> Option<Self> {
        let (header, behind) = counted(bytes, at)?;
        let header = Header::parse(header)?;
        let &[op] = header.get("op")? else { return None };
        let (data, end) = counted(bytes, behind)?;
        Some(Self { op, header, data, data_range: end - data.len()..end })
    }

    /// Place behind the record.
    pub(super) fn end(&self) -> usize {
        self.data_range.end
    }
}

/// Bytes with their length before them, and the place behind them.
fn counted(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let length = bytes.get(at..)?.first_chunk::<4>()?;
    let start = at.checked_add(4)?;
    let end = start.checked_add(usize::try_from(u32::from_le_bytes(*length)).ok()?)?;
    Some((bytes.get(start..end)?, end))
}

/// Fields of a header: `name=value`, each with its length before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Header<'a>(&'a [u8]);

impl<'a> Header<'a> {
    /// A header whose fields fill it exactly.
    pub(super) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let mut at = 0;
        while at < bytes.len() {
            let (field, end) = counted(bytes, at)?;
            memchr::memchr(b'=', field)?;
            at = end;
        }
        Some(Self(bytes))
    }

    /// All fields in their order.
    pub(super) fn fields(self) -> impl Iterator<Item = (&'a [u8], &'a [u8])> {
        let mut at = 0;
        std::iter::from_fn(move || {
            let (field, end) = counted(self.0, at)?;
            at = end;
            let equals = memchr::memchr(b'=', field)?;
            Some((field.get(..equals)?, field.get(equals + 1..)?))
        })
    }

    /// The value of a field.
    pub(super) fn get(self, name: &str) -> Option<&'a [u8]> {
        self.fields().find(|(key, _)| *key == name.as_bytes()).map(|(_, value)| value)
    }

    /// A number of four bytes.
    pub(super) fn u32(self, name: &str) -> Option<u32> {
        Some(u32::from_le_bytes(self.get(name)?.try_into().ok()?))
    }

    /// A number of eight bytes.
    pub(super) fn u64(self, name: &str) -> Option<u64> {
        Some(u64::from_le_bytes(self.get(name)?.try_into().ok()?))
    }

    /// A time, nanoseconds.
    pub(super) fn time(self, name: &str) -> Option<i64> {
        time(self.get(name)?.try_into().ok()?)
    }

    /// Text, as far as it is UTF-8.
    pub(super) fn text(self, name: &str) -> Option<String> {
        Some(String::from_utf8_lossy(self.get(name)?).into_owned())
    }
}

/// A time of seconds and nanoseconds, in nanoseconds; `None` where the nanoseconds are more than a second.
pub(super) fn time(bytes: [u8; 8]) -> Option<i64> {
    let [a, b, c, d, e, f, g, h] = bytes;
    let (seconds, rest) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
    (rest < 1_000_000_000).then(|| i64::from(seconds) * 1_000_000_000 + i64::from(rest))
}

/// Entries of an index record: times of a connection's messages in a chunk. `None` where its head and its length disagree.
pub(super) fn index_entries<'a>(record: &Record<'a>) -> Option<(u32, &'a [[u8; 12]])> {
    let (connection, count) = (record.header.u32("conn")?, record.header.u32("count")?);
    let (entries, rest) = record.data.as_chunks::<12>();
    (record.header.u32("ver")? == 1 && rest.is_empty() && entries.len() as u64 == u64::from(count))
        .then_some((connection, entries))
}

/// The time of an index entry.
pub(super) fn entry_time(entry: &[u8; 12]) -> Option<i64> {
    time(*entry.first_chunk::<8>()?)
}

//! Records of an MCAP file, read in place.
//!
//! Format: <https://mcap.dev/spec>. Every length is checked against the bytes that are there; nothing is copied and nothing is allocated.
//! The `mcap` crate's own parser copies headers and strings, which costs more than decoding a small message.

use std::ops::RangeInclusive;

use mcap::records::op;

/// Bytes before a record's body: its opcode and its length.
pub(super) const RECORD_HEAD: usize = 9;

/// Fields of a record's body, read one after the other; `None` where the body ends too soon.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes behind their length as `u32`: a text, a map, a schema.
    pub(super) fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.u32()?).ok()?;
        self.take(length)
    }
}

/// A record, and where it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Record<'a> {
    pub(super) opcode: u8,
    /// Offset of its opcode.
    pub(super) start: usize,
    pub(super) body: &'a [u8],
}

impl Record<'_> {
    /// Offset of the byte after it.
    pub(super) fn end(&self) -> usize {
        self.start + RECORD_HEAD + self.body.len()
    }
}

/// The record that begins at `at`, or why there is none.
pub(super) fn record_at(bytes: &[u8], at: usize) -> Result<Record<'_>, &'static str> {
    let mut fields = Fields(bytes.get(at..).unwrap_or_default());
    let opcode = match fields.array::<1>() {
        Some([0]) => return Err("no record begins here"),
        Some([opcode]) => opcode,
        None => return Err("the bytes end"),
    };
    let length = fields.u64().ok_or("the bytes end inside a record's head")?;
    let body = usize::try_from(length)
        .ok()
        .and_then(|length| fields.take(length))
        .ok_or("a record is longer than the bytes that are there")?;
    Ok(Record { opcode, start: at, body })
}

/// As [`record_at`], for a record whose inner lengths fit its body as well.
///
/// A damaged opcode or length would lead a reader astray in silence otherwise.
pub(super) fn sound_record_at(bytes: &[u8], at: usize) -> Result<Record<'_>, &'static str> {
    let record = record_at(bytes, at)?;
    let mut fields = Fields(record.body);
    let fields = &mut fields;
    let (fits, otherwise) = match record.opcode {
        op::HEADER => (texts(fields, 2), "a malformed header"),
        op::FOOTER => (fields.take(20), "a malformed footer"),
        op::SCHEMA => (fields.u16().and_then(|_| texts(fields, 3)), "a schema whose lengths do not fit"),
        op::CHANNEL => (fields.u32().and_then(|_| texts(fields, 3)), "a channel whose lengths do not fit"),
        op::MESSAGE => (fields.take(22), "a message without its head"),
        op::CHUNK => (Chunk::parse(record.body).map(|chunk| chunk.data), "a chunk whose lengths do not fit"),
        op::MESSAGE_INDEX => {
            (MessageIndex::parse(record.body).map(|index| index.entries), "an index whose lengths do not fit")
        }
        op::ATTACHMENT => (attachment(fields), "an attachment whose lengths do not fit"),
        op::METADATA => (texts(fields, 2), "metadata whose lengths do not fit"),
        op::DATA_END => (fields.take(4).filter(|_| fields.0.is_empty()), "a malformed end mark"),
        op::CHUNK_INDEX..=op::SUMMARY_OFFSET => return Ok(record),
        // Records to come, or of somebody's own, are to be skipped; so would be a chunk with a damaged opcode.
        _ if Chunk::parse(record.body).is_some_and(|chunk| chunk.fills_its_record) => {
            (None, "a chunk with a damaged opcode")
        }
        _ => {
            let next = record_at(bytes, record.end());
            let last = record.end() == bytes.len();
            (
                next.is_ok_and(|next| next.opcode <= op::DATA_END)
                    .then_some(record.body)
                    .or(last.then_some(record.body)),
                "no record begins here",
            )
        }
    };
    fits.map(|_| record).ok_or(otherwise)
}

fn texts<'a>(fields: &mut Fields<'a>, count: usize) -> Option<&'a [u8]> {
    (0..count).try_fold(&[][..], |_, _| fields.bytes())
}

fn attachment<'a>(fields: &mut Fields<'a>) -> Option<&'a [u8]> {
    fields.take(16)?;
    texts(fields, 2)?;
    let length = usize::try_from(fields.u64()?).ok()?;
    fields.take(length)?;
    fields.take(4)
}

/// A chunk record.
#[derive(Debug, Clone)]
pub(super) struct Chunk<'a> {
    /// Log times of its messages, from the first to the last.
    pub(super) log_times: RangeInclusive<u64>,
    pub(super) uncompressed_size: u64,
    /// Of the uncompressed records; 0 where it was not computed.
    pub(super) crc: u32,
    pub(super) compression: &'a [u8],
    pub(super) data: &'a [u8],
    /// Nothing follows the data.
    pub(super) fills_its_record: bool,
}

impl<'a> Chunk<'a> {
    /// Longest name of a compression that is believed.
    const MAX_NAME: usize = 32;

    pub(super) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut fields = Fields(body);
        let log_times = fields.u64()?..=fields.u64()?;
        let uncompressed_size = fields.u64()?;
        let crc = fields.u32()?;
        let compression =
            fields.bytes().filter(|name| name.len() <= Self::MAX_NAME && name.iter().all(u8::is_ascii_graphic))?;
        let length = usize::try_from(fields.u64()?).ok()?;
        let data = fields.take(length)?;
        Some(Self { log_times, uncompressed_size, crc, compression, data, fills_its_record: fields.0.is_empty() })
    }
}

impl Chunk<'_> {
    /// Offset of the first record in a chunk's body, if it is not compressed. The end of the records is not checked.
    pub(super) fn uncompressed_records_at(body: &[u8]) -> Option<usize> {
        let mut fields = Fields(body);
        fields.take(8 + 8 + 8 + 4)?;
        let compression = fields.bytes()?;
        fields.u64()?;
        compression.is_empty().then(|| body.len() - fields.0.len())
    }
}

/// Index of the messages of one channel in the chunk before.
#[derive(Debug, Clone, Copy)]
pub(super) struct MessageIndex<'a> {
    pub(super) channel: u16,
    /// Pairs of log time and offset, 8 bytes each.
    entries: &'a [u8],
}

impl<'a> MessageIndex<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut fields = Fields(body);
        let channel = fields.u16()?;
        let entries = fields.bytes().filter(|entries| entries.len() % 16 == 0)?;
        Some(Self { channel, entries })
    }

    pub(super) fn count(&self) -> u64 {
        self.entries.len() as u64 / 16
    }

    /// The log times of the first and the last entry.
    pub(super) fn ends(&self) -> Option<(u64, u64)> {
        let (entries, _) = self.entries.as_chunks::<16>();
        let time = |entry: Option<&[u8; 16]>| Some(u64::from_le_bytes(*entry?.first_chunk::<8>()?));
        Some((time(entries.first())?, time(entries.last())?))
    }

    pub(super) fn log_times(&self) -> impl Iterator<Item = u64> + use<'a> {
        let (entries, _) = self.entries.as_chunks::<16>();
        entries.iter().filter_map(|entry| entry.first_chunk::<8>()).map(|time| u64::from_le_bytes(*time))
    }
}

/// A message record.
#[derive(Debug, Clone, Copy)]
pub(super) struct Message<'a> {
    pub(super) channel: u16,
    pub(super) log_time: u64,
    pub(super) publish_time: u64,
    pub(super) data: &'a [u8],
}

impl<'a> Message<'a> {
    #[inline]
    pub(super) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut fields = Fields(body);
        let channel = fields.u16()?;
        fields.take(4)?;
        Some(Self { channel, log_time: fields.u64()?, publish_time: fields.u64()?, data: fields.0 })
    }
}

/// Records that stop before their end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Torn {
    /// Offset of the first byte that cannot be read.
    pub(super) at: usize,
    pub(super) why: &'static str,
}

/// Hands over the records of a chunk, or of a run of a file without chunks, in their order. Ends early where a length lies.
pub(super) fn for_each_record<'a, E>(
    records: &'a [u8],
    mut each: impl FnMut(Record<'a>) -> Result<(), E>,
) -> Result<Option<Torn>, E> {
    let mut at = 0;
    while at < records.len() {
        match record_at(records, at) {
            Ok(record) => {
                at = record.end();
                each(record)?;
            }
            Err(why) => return Ok(Some(Torn { at, why })),
        }
    }
    Ok(None)
}

/// As [`for_each_record`], for messages.
#[inline]
pub(super) fn for_each_message<'a, E>(
    records: &'a [u8],
    mut each: impl FnMut(Message<'a>) -> Result<(), E>,
) -> Result<Option<Torn>, E> {
    let mut short = None;
    let torn = for_each_record(records, |record| {
        if record.opcode == op::MESSAGE {
            match Message::parse(record.body) {
                Some(message) => each(message)?,
                None => short = short.or(Some(Torn { at: record.start, why: "a message without its head" })),
            }
        }
        Ok(())
    })?;
    Ok(torn.or(short))
}

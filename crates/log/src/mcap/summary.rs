//! The summary section at the end of a file, used only as far as it agrees with the file.

use std::collections::BTreeMap;

use mcap::{MAGIC, records::op};

use super::{
    channels::Definitions,
    record::{Fields, RECORD_HEAD, sound_record_at},
};

/// Bytes of the footer's body.
const FOOTER: usize = 20;

/// A summary section whose lengths and checksum are sound.
#[derive(Debug, Default)]
pub(super) struct Summary {
    pub(super) definitions: Definitions,
    pub(super) statistics: Option<Statistics>,
}

/// Counts for the whole file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Statistics {
    pub(super) chunks: u64,
    /// Messages of each channel.
    pub(super) counts: BTreeMap<u16, u64>,
}

impl Statistics {
    fn parse(body: &[u8]) -> Option<Self> {
        let mut fields = Fields(body);
        // Messages in all, schemas, channels, attachments, metadata.
        fields.take(8 + 2 + 4 + 4 + 4)?;
        let chunks = u64::from(fields.u32()?);
        // First and last log time: the indexes tell these for each channel.
        fields.take(16)?;
        let mut entries = Fields(fields.bytes()?);
        let mut counts = BTreeMap::new();
        while let (Some(channel), Some(count)) = (entries.u16(), entries.u64()) {
            counts.insert(channel, count);
        }
        Some(Self { chunks, counts })
    }
}

/// Reads the summary section. `Ok(None)` when there is none, an error when there is one that cannot be believed.
///
/// `data_end` is where the data section was found to end.
pub(super) fn read(file: &[u8], data_end: Option<usize>) -> Result<Option<Summary>, &'static str> {
    let Some(footer_at) = file.len().checked_sub(MAGIC.len() + RECORD_HEAD + FOOTER).filter(|_| file.ends_with(MAGIC))
    else {
        return Ok(None);
    };
    let footer = sound_record_at(file, footer_at)
        .ok()
        .filter(|record| record.opcode == op::FOOTER && record.body.len() == FOOTER);
    let mut fields = Fields(footer.ok_or("its footer is damaged")?.body);
    let start = fields.u64().unwrap_or_default();
    fields.take(8);
    let crc = fields.u32().unwrap_or_default();
    if start == 0 {
        return Ok(None);
    }
    let start =
        usize::try_from(start).ok().filter(|&start| start <= footer_at && data_end.is_none_or(|end| end <= start));
    let start = start.ok_or("its place leaves the file")?;
    // The checksum counts everything from the summary's start to itself.
    let checked = file.get(start..footer_at + RECORD_HEAD + FOOTER - 4).ok_or("its place leaves the file")?;
    if crc != 0 && crc32fast::hash(checked) != crc {
        return Err("its checksum is wrong");
    }
    let mut summary = Summary::default();
    let mut at = start;
    while at < footer_at {
        let record = sound_record_at(file, at)?;
        if record.opcode == op::STATISTICS {
            summary.statistics = Some(Statistics::parse(record.body).ok_or("its statistics are damaged")?);
        }
        summary.definitions.add(record.opcode, record.body);
        at = record.end();
    }
    if at == footer_at { Ok(Some(summary)) } else { Err("its records do not end where the footer begins") }
}

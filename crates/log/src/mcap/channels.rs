//! Schemas and channels: the topic of a message, and the meaning of its bytes.

use std::collections::{BTreeMap, BTreeSet};

use fleetfoot_data::{Progress, parallel_map};
use mcap::records::op;

use super::{
    chunk,
    layout::{Layout, Piece},
    record::{Fields, for_each_record},
};
use crate::{Error, container::SchemaRecord};

/// Contradictions that are told of a file.
const MAX_NOTES: usize = 5;

/// A channel record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChannelRecord {
    /// 0 for a channel without a schema.
    pub(super) schema: u16,
    pub(super) topic: String,
    pub(super) encoding: String,
}

/// All that a file says about its channels.
#[derive(Debug, Clone, Default)]
pub(super) struct Definitions {
    pub(super) schemas: BTreeMap<u16, SchemaRecord>,
    pub(super) channels: BTreeMap<u16, ChannelRecord>,
    /// Contradictions, each once.
    pub(super) notes: BTreeSet<String>,
}

impl Definitions {
    /// Adds a schema or channel record; others are passed over. The first definition of an id stays.
    pub(super) fn add(&mut self, opcode: u8, body: &[u8]) {
        match opcode {
            op::SCHEMA => self.add_schema(body),
            op::CHANNEL => self.add_channel(body),
            _ => Some(()),
        };
    }

    fn add_schema(&mut self, body: &[u8]) -> Option<()> {
        let mut fields = Fields(body);
        let (id, name, encoding, data) = (fields.u16()?, fields.bytes()?, fields.bytes()?, fields.bytes()?);
        match self.schemas.get(&id) {
            // The usual case, without allocating.
            Some(known_schema)
                if known_schema.name.as_bytes() == name
                    && known_schema.encoding.as_bytes() == encoding
                    && *known_schema.data == *data => {}
            _ => self.insert_schema(id, SchemaRecord { name: text(name), encoding: text(encoding), data: data.into() }),
        }
        Some(())
    }

    fn add_channel(&mut self, body: &[u8]) -> Option<()> {
        let mut fields = Fields(body);
        let (id, schema, topic, encoding) = (fields.u16()?, fields.u16()?, fields.bytes()?, fields.bytes()?);
        match self.channels.get(&id) {
            Some(known_channel)
                if known_channel.schema == schema
                    && known_channel.topic.as_bytes() == topic
                    && known_channel.encoding.as_bytes() == encoding => {}
            _ => self.insert_channel(id, ChannelRecord { schema, topic: text(topic), encoding: text(encoding) }),
        }
        Some(())
    }

    fn insert_schema(&mut self, id: u16, schema: SchemaRecord) {
        match self.schemas.get(&id) {
            None => {
                self.schemas.insert(id, schema);
            }
            Some(known_schema) if *known_schema == schema => {}
            Some(known_schema) => {
                let note = format!(
                    "schema {id} is defined twice, as `{}` and differently as `{}`: the first is used",
                    known_schema.name, schema.name
                );
                self.note(note);
            }
        }
    }

    fn insert_channel(&mut self, id: u16, channel: ChannelRecord) {
        match self.channels.get(&id) {
            None => {
                self.channels.insert(id, channel);
            }
            Some(known_channel) if *known_channel == channel => {}
            Some(known_channel) => {
                let note = format!(
                    "channel {id} is defined twice, as {} and differently as {}: the first is used",
                    known_channel.topic, channel.topic
                );
                self.note(note);
            }
        }
    }

    fn note(&mut self, note: String) {
        if self.notes.len() < MAX_NOTES {
            self.notes.insert(note);
        }
    }

    /// Adds what a later part of the file says.
    pub(super) fn merge(&mut self, later: Self) {
        later.schemas.into_iter().for_each(|(id, schema)| self.insert_schema(id, schema));
        later.channels.into_iter().for_each(|(id, channel)| self.insert_channel(id, channel));
        later.notes.into_iter().for_each(|note| self.note(note));
    }

    /// Adds the records outside chunks.
    pub(super) fn add_top_level(&mut self, file: &[u8], layout: &Layout) {
        for (opcode, body) in &layout.definitions {
            self.add(*opcode, file.get(body.clone()).unwrap_or_default());
        }
    }

    fn has_schema_of(&self, channel: &ChannelRecord) -> bool {
        channel.schema == 0 || self.schemas.contains_key(&channel.schema)
    }

    /// Returns true if every channel that the pieces are known to use is defined, and every schema that a channel
    /// names.
    pub(super) fn explain(&self, pieces: &[Piece]) -> bool {
        let mut used = pieces.iter().filter_map(|piece| piece.counts.as_ref()).flatten();
        used.all(|(channel, _)| self.channels.contains_key(channel))
            && self.channels.values().all(|known_channel| self.has_schema_of(known_channel))
    }

    /// Looks into chunks for definitions that are nowhere else.
    ///
    /// A channel is defined before its first message. Where indexes tell in which chunk that is, only those chunks are decompressed;
    /// when that does not explain every channel, all are.
    pub(super) fn scan(&mut self, file: &[u8], pieces: &[Piece], progress: &dyn Progress) -> Result<(), Error> {
        let known = self.channels.iter().filter(|(_, known_channel)| self.has_schema_of(known_channel));
        let mut seen: BTreeSet<u16> = known.map(|(&id, _)| id).collect();
        let firsts: Option<Vec<usize>> = pieces.iter().enumerate().try_fold(Vec::new(), |mut firsts, (i, piece)| {
            let fresh = piece.counts.as_ref()?.iter().filter(|(channel, _)| seen.insert(*channel)).count();
            firsts.extend((fresh > 0).then_some(i));
            Some(firsts)
        });
        if let Some(firsts) = firsts {
            self.scan_pieces(file, pieces, &firsts, progress)?;
            if self.explain(pieces) {
                return Ok(());
            }
        }
        self.scan_pieces(file, pieces, &(0..pieces.len()).collect::<Vec<_>>(), progress)
    }

    fn scan_pieces(
        &mut self,
        file: &[u8],
        pieces: &[Piece],
        which: &[usize],
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        progress.stage("looking for channels");
        let parts = parallel_map(which.len(), progress, |i| {
            let mut part_channels = Self::default();
            if let Some(piece) = which.get(i).and_then(|&i| pieces.get(i)) {
                // A chunk that is damaged is counted when its messages are read.
                let _ = chunk::with_records(file, piece, |records| {
                    for_each_record(records, |record| {
                        part_channels.add(record.opcode, record.body);
                        Ok::<_, std::convert::Infallible>(())
                    })
                });
            }
            Ok::<_, Error>(part_channels)
        })?;
        parts.into_iter().for_each(|later| self.merge(later));
        Ok(())
    }
}

/// Names are UTF-8; what is not is shown as far as it is.
fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

//! Log times from the indexes behind chunks.

use std::{collections::BTreeMap, ops::RangeInclusive};

use mcap::records::op;

use super::{
    container::McapContainer,
    layout::PieceKind,
    record::{MessageIndex, Record, for_each_record},
};
use crate::container::Span;

/// The index of a chunk.
pub(super) struct Indexed<'a> {
    records: &'a [u8],
    topic_of: &'a BTreeMap<u16, usize>,
    /// The log times that the chunk says it has.
    span: RangeInclusive<u64>,
}

impl McapContainer {
    /// The index of a piece that has one.
    pub(super) fn indexed(&self, place: usize) -> Option<Indexed<'_>> {
        let (file, topic_of) = (&self.file, &self.topic_of);
        let piece = file.pieces.get(place)?;
        if piece.kind == PieceKind::Records || piece.counts.is_none() {
            return None;
        }
        let span = file.chunk(piece).map(|chunk| chunk.log_times).filter(|span| !span.is_empty());
        let records = file.map.get(piece.index.clone()).unwrap_or_default();
        Some(Indexed { records, topic_of, span: span.unwrap_or(0..=u64::MAX) })
    }
}

impl Indexed<'_> {
    /// All log times, by topic.
    pub(super) fn times(&self) -> BTreeMap<usize, Vec<i64>> {
        let mut times: BTreeMap<usize, Vec<i64>> = BTreeMap::new();
        self.for_each(|topic, index| {
            let times_of_topic = times.entry(topic).or_default();
            times_of_topic.reserve(usize::try_from(index.count()).unwrap_or_default());
            times_of_topic.extend(index.log_times().filter(|&time| self.sound(time)).map(|time| time as i64));
        });
        times
    }

    /// The first and the last log time of each topic. Only the ends of each index are read.
    pub(super) fn spans(&self) -> BTreeMap<usize, Span> {
        let mut spans: BTreeMap<usize, Span> = BTreeMap::new();
        self.for_each(|topic, index| {
            if let Some((a, b)) = index.ends()
                && self.sound(a)
                && self.sound(b)
            {
                let span = Span { count: index.count(), first: a.min(b) as i64, last: a.max(b) as i64 };
                spans.entry(topic).and_modify(|known_span| known_span.join(&span)).or_insert(span);
            }
        });
        spans
    }

    fn for_each(&self, mut each: impl FnMut(usize, MessageIndex<'_>)) {
        // A torn index has been told when the file was opened.
        let _ = for_each_record(self.records, |record: Record<'_>| {
            let index = MessageIndex::parse(record.body).filter(|_| record.opcode == op::MESSAGE_INDEX);
            if let Some((index, &topic)) = index.and_then(|index| Some((index, self.topic_of.get(&index.channel)?))) {
                each(topic, index);
            }
            Ok::<_, std::convert::Infallible>(())
        });
    }

    /// Times outside the chunk's span are damage of the index, and so are those that are no `i64`.
    fn sound(&self, time: u64) -> bool {
        self.span.contains(&time) && i64::try_from(time).is_ok()
    }
}

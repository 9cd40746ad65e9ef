//! Sample of each topic's messages: their fields, and whether their headers are filled in.

use std::collections::{BTreeMap, HashMap};

use fleetfoot_data::{Cancelled, Progress, parallel_map};
use fleetfoot_message::{Codec, FieldPath, FieldTree, MISSING, Row, SchemaError, codec};

use crate::{Error, container::Container};

/// Messages of a topic that are looked at in one piece of the file.
const MESSAGES: usize = 64;
/// Bytes of messages of a topic that are looked at in one piece; the first message whatever its size.
const BYTES: usize = 1 << 20;
/// Further pieces that are searched for topics that were not met where they were expected.
const SEARCH: usize = 64;

/// Decoder, fields and messages from a part of a topic.
pub(super) struct Sample {
    /// Its decoder, or why there is none.
    pub codec: Result<Box<dyn Codec>, SchemaError>,
    /// The fields that were seen.
    pub tree: FieldTree,
    /// The messages, in the order of the file.
    pub messages: Vec<Message>,
    /// The first message that could not be decoded: why.
    pub failed: Option<String>,
}

/// A message, and when it was recorded.
pub(super) struct Message {
    pub log_time: i64,
    pub data: Vec<u8>,
}

/// Looks at messages of these topics at the beginning, in the middle and at the end of the file. One sample a topic, in their order.
pub(super) fn sample(
    container: &dyn Container,
    topics: &[usize],
    progress: &dyn Progress,
) -> Result<Vec<Sample>, Error> {
    let pieces = places(container, topics);
    let mut by_place: Vec<Vec<Message>> = topics.iter().map(|_| Vec::new()).collect();
    for part in parallel_map(pieces.len(), progress, |i| look(container, pieces[i], topics))? {
        part.into_iter().for_each(|(place, part_messages)| by_place[place].extend(part_messages));
    }
    let rest = (0..container.pieces()).filter(|piece| !pieces.contains(piece)).take(SEARCH);
    for piece in rest {
        let missing: Vec<usize> = (0..topics.len()).filter(|&t| by_place[t].is_empty()).collect();
        if missing.is_empty() || missing.iter().all(|&t| container.topics()[topics[t]].count == Some(0)) {
            break;
        }
        let wanted: Vec<usize> = missing.iter().map(|&t| topics[t]).collect();
        if progress.cancelled() {
            return Err(Cancelled.into());
        }
        look(container, piece, &wanted)?
            .into_iter()
            .for_each(|(place, part_messages)| by_place[missing[place]].extend(part_messages));
    }
    Ok(topics.iter().zip(by_place).map(|(&topic, messages)| judge(container, topic, messages)).collect())
}

/// The pieces that may have messages of one of these topics.
pub(super) fn having(container: &dyn Container, topics: &[usize]) -> Vec<usize> {
    (0..container.pieces()).filter(|&piece| container.wanted_messages(piece, topics) != Some(0)).collect()
}

/// The pieces to look at: for each topic the first, the middle and the last that has it.
fn places(container: &dyn Container, topics: &[usize]) -> Vec<usize> {
    let (mut having, mut any): (HashMap<usize, Vec<usize>>, Vec<usize>) = (HashMap::new(), Vec::new());
    for piece in 0..container.pieces() {
        match container.topics_of(piece) {
            Some(topics) => topics.into_iter().for_each(|topic| having.entry(topic).or_default().push(piece)),
            // It may have any.
            None => any.push(piece),
        }
    }
    let mut places = Vec::new();
    for topic in topics {
        let mut indexed = having.remove(topic).unwrap_or_default();
        indexed.extend(&any);
        indexed.sort_unstable();
        indexed.dedup();
        if let (Some(first), Some(last)) = (indexed.first(), indexed.last()) {
            places.extend([*first, indexed[indexed.len() / 2], *last]);
        }
    }
    places.sort_unstable();
    places.dedup();
    places
}

/// The first messages of the topics in a piece, by the places of those that it has.
fn look(container: &dyn Container, piece: usize, topics: &[usize]) -> Result<Vec<(usize, Vec<Message>)>, Error> {
    let places: HashMap<usize, usize> = topics.iter().enumerate().map(|(place, &topic)| (topic, place)).collect();
    let mut read_messages: BTreeMap<usize, (usize, Vec<Message>)> = BTreeMap::new();
    container.read_piece(piece, topics, &mut |topic, log_time, _, data| {
        if let Some(&place) = places.get(&topic) {
            let (bytes, messages) = read_messages.entry(place).or_default();
            if messages.is_empty() || (messages.len() < MESSAGES && *bytes + data.len() <= BYTES) {
                *bytes += data.len();
                messages.push(Message { log_time, data: data.to_vec() });
            }
        }
        Ok(())
    })?;
    Ok(read_messages.into_iter().map(|(place, (_, messages))| (place, messages)).collect())
}

fn judge(container: &dyn Container, topic: usize, messages: Vec<Message>) -> Sample {
    let topic = &container.topics()[topic];
    let codec = codec(&topic.message_encoding, topic.schema());
    let (mut tree, mut failed) = (FieldTree::default(), None);
    if let Ok(codec) = &codec {
        for message in &messages {
            match codec.value(&message.data) {
                Ok(value) => tree.add(&value),
                Err(error) => failed = failed.or(Some(error.to_string())),
            }
        }
    }
    Sample { codec, tree, messages, failed }
}

/// Header stamps of some messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Headers {
    /// No message was decoded.
    Unknown,
    /// There is no header.
    None,
    /// All stamps are zero.
    Zero,
    /// Log stamp minus header stamp of the first and of the last message, nanoseconds.
    Filled { first: i64, last: i64 },
}

impl Sample {
    /// The header stamps around some fields.
    pub(super) fn headers(&self, fields: &[FieldPath]) -> Headers {
        let Ok(Ok(extract)) = self.codec.as_ref().map(|codec| codec.compile(fields)) else {
            return Headers::Unknown;
        };
        let mut row = Row::new(extract.as_ref());
        let mut answer = Headers::Unknown;
        for message in &self.messages {
            if extract.extract(&message.data, &mut row).is_err() {
                continue;
            }
            for (&stamp, _) in row.stamps.iter().zip(&row.present).filter(|(_, present)| **present) {
                answer = match (stamp, answer) {
                    (MISSING, _) | (_, Headers::None) => Headers::None,
                    (0, Headers::Unknown) => Headers::Zero,
                    (0, answer) => answer,
                    (stamp, Headers::Filled { first, .. }) => {
                        Headers::Filled { first, last: message.log_time.saturating_sub(stamp) }
                    }
                    (stamp, _) => {
                        let offset = message.log_time.saturating_sub(stamp);
                        Headers::Filled { first: offset, last: offset }
                    }
                };
            }
        }
        answer
    }
}

//! Description of a robot's log, for people: topics, and the fields of some or all of its messages.

use std::{collections::BTreeMap, path::Path};

use fleetfoot_data::{ColumnKind, Progress, parallel_fold};
use fleetfoot_message::{Codec, FieldInfo, FieldKind, FieldTree};

use super::{
    names,
    sample::{Headers, Sample, sample},
};
use crate::{
    ArrayInfo, ColumnInfo, ColumnStatistics, Error, Format, HeaderOffset, TopicInfo,
    container::{Container, Topic, summary},
    containers,
};

/// Description of a log.
pub(crate) struct Description {
    pub columns: Vec<ColumnInfo>,
    pub arrays: Vec<ArrayInfo>,
    pub topics: Vec<TopicInfo>,
    pub metadata: BTreeMap<String, String>,
    pub notes: Vec<String>,
}

/// Describes a log by its indexes and some of its messages.
pub(crate) fn describe(path: &Path, format: Format, progress: &dyn Progress) -> Result<Description, Error> {
    let container = containers::open(path, format, &[], progress)?;
    let container = container.as_ref();
    let (topics, samples, mut notes) = look(container, progress)?;
    let (mut columns, mut arrays) = (Vec::new(), Vec::new());
    for (topic, sample) in container.topics().iter().zip(&samples) {
        columns.extend(sample.tree.fields().iter().map(|field| column(topic, sample, field, None)));
        arrays.extend(skipped(topic, &sample.tree));
    }
    notes.extend(arrays.iter().map(ToString::to_string));
    tell_damage(container, &mut notes);
    Ok(Description { columns, arrays, topics, metadata: container.metadata(), notes })
}

/// The fields of a topic's messages, and how many could be read and how many not.
#[derive(Default)]
struct Counted {
    tree: FieldTree,
    read: u64,
    failed: u64,
}

/// As [`describe`], from all messages: the range of every field.
pub(crate) fn statistics(path: &Path, format: Format, progress: &dyn Progress) -> Result<Description, Error> {
    let container = containers::open(path, format, &[], progress)?;
    let container = container.as_ref();
    let (topics, samples, mut notes) = look(container, progress)?;
    let codecs: Vec<Option<&dyn Codec>> =
        samples.iter().map(|sample| sample.codec.as_ref().ok().map(AsRef::as_ref)).collect();
    let wanted: Vec<usize> =
        (0..codecs.len()).filter(|&t| codecs[t].is_some() && container.topics()[t].problem.is_none()).collect();
    let mut trees: Vec<Counted> = codecs.iter().map(|_| Default::default()).collect();
    progress.stage("reading messages");
    parallel_fold(
        container.pieces(),
        progress,
        |piece| {
            let mut by_topic: BTreeMap<usize, Counted> = BTreeMap::new();
            container.read_piece(piece, &wanted, &mut |topic, _, _, data| {
                let counted = by_topic.entry(topic).or_default();
                match codecs[topic].map(|codec| codec.value(data)) {
                    Some(Ok(value)) => {
                        counted.read += 1;
                        counted.tree.add(&value);
                    }
                    _ => counted.failed += 1,
                }
                Ok(())
            })?;
            Ok::<_, Error>(by_topic)
        },
        |by_topic| {
            for (topic, part) in by_topic {
                let all = &mut trees[topic];
                all.tree.merge(part.tree);
                (all.read, all.failed) = (all.read + part.read, all.failed + part.failed);
            }
            Ok(())
        },
    )?;
    let (mut columns, mut arrays) = (Vec::new(), Vec::new());
    for ((topic, sample), Counted { tree, read, failed }) in container.topics().iter().zip(&samples).zip(&trees) {
        columns.extend(tree.fields().iter().map(|field| column(topic, sample, field, Some(*read))));
        arrays.extend(skipped(topic, tree));
        if *failed > 0 {
            notes.push(format!("{}: {failed} messages cannot be decoded", topic.name));
        }
    }
    notes.extend(arrays.iter().map(ToString::to_string));
    tell_damage(container, &mut notes);
    Ok(Description { columns, arrays, topics, metadata: container.metadata(), notes })
}

fn tell_damage(container: &dyn Container, notes: &mut Vec<String>) {
    let damage = container.damage();
    if !damage.is_empty() {
        notes.push(damage.to_string());
    }
}

fn skipped(topic: &Topic, tree: &FieldTree) -> Vec<ArrayInfo> {
    let array = |(path, longest): (String, usize)| ArrayInfo { name: names::column(&topic.name, &path), longest };
    tree.skipped().into_iter().map(array).collect()
}

/// A field, and where all messages were read how many these are: those that lack it, as sequences may, miss it.
fn column(topic: &Topic, sample: &Sample, field: &FieldInfo, messages: Option<u64>) -> ColumnInfo {
    let scanned = messages.is_some();
    let kind = match field.kind {
        FieldKind::Integer => ColumnKind::Integer,
        FieldKind::Boolean => ColumnKind::Boolean,
        FieldKind::Text => ColumnKind::Category(if scanned { field.texts.clone() } else { Vec::new() }),
        _ => ColumnKind::Float,
    };
    let statistics = (scanned && field.kind != FieldKind::Text).then_some(ColumnStatistics {
        count: field.count as usize,
        missing: messages.map_or(field.missing, |all| all.saturating_sub(field.count)) as usize,
        min: field.min,
        mean: field.mean,
        max: field.max,
    });
    let codec = sample.codec.as_ref().ok();
    let unit = codec.zip(field.path.parse().ok()).and_then(|(codec, path)| codec.unit(&path));
    ColumnInfo { name: names::column(&topic.name, &field.path), unit, kind, unsupported: None, statistics }
}

/// Topics, a sample of each, and notes.
type Looked = (Vec<TopicInfo>, Vec<Sample>, Vec<String>);

fn look(container: &dyn Container, progress: &dyn Progress) -> Result<Looked, Error> {
    let info = summary(container, progress)?;
    let all: Vec<usize> = (0..container.topics().len()).collect();
    let samples = sample(container, &all, progress)?;
    let topics = container
        .topics()
        .iter()
        .zip(&info.topics)
        .zip(&samples)
        .map(|((topic, times), sample)| {
            let problem = topic.problem.clone().or_else(|| match (&sample.codec, &sample.failed) {
                (Err(problem), _) => Some(problem.to_string()),
                (_, Some(problem)) => Some(problem.clone()),
                _ => None,
            });
            let seconds = |nanoseconds: i64| nanoseconds as f64 * 1e-9;
            let header_offset = match sample.headers(&any_field(sample)) {
                Headers::Filled { first, last } => {
                    Some(HeaderOffset { first: seconds(first), last: seconds(last), zero: false })
                }
                Headers::Zero => Some(HeaderOffset { first: f64::NAN, last: f64::NAN, zero: true }),
                Headers::None | Headers::Unknown => None,
            };
            TopicInfo {
                name: topic.name.clone(),
                type_name: topic.type_name.clone(),
                message_encoding: topic.message_encoding.clone(),
                schema_encoding: topic.schema.as_ref().map(|schema| schema.encoding.clone()).unwrap_or_default(),
                messages: Some(times.count),
                start: times.first,
                end: times.last,
                rate: times.rate,
                jitter: times.jitter,
                bursts: times.bursts,
                gaps: times.gaps,
                largest_gap: times.largest_gap,
                header_offset,
                problem,
            }
        })
        .collect();
    Ok((topics, samples, info.notes))
}

/// A field whose header tells the stamp of a message.
fn any_field(sample: &Sample) -> Vec<fleetfoot_message::FieldPath> {
    sample.tree.fields().iter().find_map(|field| field.path.parse().ok()).into_iter().collect()
}

/// The topics of a log.
pub(super) fn topic_infos(container: &dyn Container, progress: &dyn Progress) -> Result<Vec<TopicInfo>, Error> {
    Ok(look(container, progress)?.0)
}

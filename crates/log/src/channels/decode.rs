//! From the messages of a log to series of numbers: piece by piece in parallel, put together in the order of the file.

use std::{path::Path, sync::Arc};

use fleetfoot_data::{Progress, parallel_fold};
use fleetfoot_message::{Row, Texts};

use super::{
    clock::stamp_of,
    plan::{Plan, TopicPlan},
    sample::having,
};
use crate::{
    Error, Stamp,
    breaks::Breaks,
    container::{Container, Damage},
    join::{self, Series, SeriesBuilder},
    store::Budget,
};

/// The series of a log, one for each group of fields, and what happened on the way.
pub(super) struct Decoded {
    pub series: Vec<Series>,
    /// For each topic in use, its fields.
    pub fields: Vec<FieldTexts>,
    pub damage: Damage,
    /// For each topic in use, messages that could not be decoded, and why the first could not.
    pub failed: Vec<(u64, String)>,
}

/// Texts of a topic's fields by their codes, and the types of their values.
#[derive(Default)]
pub(super) struct FieldTexts {
    pub texts: Texts,
    /// For each field, whether texts were met, and whether numbers.
    pub met: Vec<Met>,
}

/// Types of the values in a field.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Met {
    pub text: bool,
    pub number: bool,
}

/// Samples of a topic in one piece of the file.
struct TopicPart {
    groups: Vec<Samples>,
    texts: Texts,
    met: Vec<Met>,
    /// For each group, whether a number was met in every field.
    numbers: Vec<bool>,
    failed: (u64, String),
}

/// Samples of a group, in the order of the file; values row by row.
#[derive(Default)]
struct Samples {
    stamps: Vec<i64>,
    logs: Vec<i64>,
    values: Vec<f64>,
}

/// Decodes all wanted fields of a log. Memory holds a few pieces a thread, and what the budget allows of the series.
pub(super) fn decode(
    path: &Path,
    container: &dyn Container,
    plan: &Plan,
    window: i64,
    budget: &Arc<Budget>,
    progress: &dyn Progress,
) -> Result<Decoded, Error> {
    let wanted: Vec<usize> = plan.topics.iter().map(|topic| topic.topic).collect();
    let pieces = having(container, &wanted);
    let mut sink = Sink::new(path, plan, window, budget);
    progress.stage("decoding messages");
    parallel_fold(
        pieces.len(),
        progress,
        |i| decode_piece(container, pieces[i], plan, &wanted),
        |parts| sink.take(parts),
    )?;
    sink.finish(container)
}

fn decode_piece(
    container: &dyn Container,
    piece: usize,
    plan: &Plan,
    wanted: &[usize],
) -> Result<Vec<TopicPart>, Error> {
    let mut rows: Vec<Row> = plan.topics.iter().map(|topic| Row::new(topic.extract.as_ref())).collect();
    let mut topics: Vec<TopicPart> = plan.topics.iter().map(TopicPart::new).collect();
    container.read_piece(piece, wanted, &mut |topic, log_time, publish_time, data| {
        let Some(used) = wanted.iter().position(|&used_topic| used_topic == topic) else { return Ok(()) };
        let (used_topic, row) = (&plan.topics[used], &mut rows[used]);
        match used_topic.extract.extract(data, row) {
            Ok(()) => topics[used].add(used_topic, row, [log_time, publish_time], plan),
            Err(error) => {
                let (count, first) = &mut topics[used].failed;
                *count += 1;
                if first.is_empty() {
                    *first = error.to_string();
                }
            }
        }
        Ok(())
    })?;
    for (topic, row) in topics.iter_mut().zip(rows) {
        topic.texts = row.texts;
    }
    Ok(topics)
}

impl TopicPart {
    fn new(plan: &TopicPlan) -> Self {
        Self {
            groups: plan.extract.groups().iter().map(|_| Samples::default()).collect(),
            texts: Texts::default(),
            met: vec![Met::default(); plan.fields.len()],
            numbers: vec![false; plan.extract.groups().len()],
            failed: (0, String::new()),
        }
    }

    fn add(&mut self, plan: &TopicPlan, row: &Row, [log_time, publish_time]: [i64; 2], all: &Plan) {
        let clock = plan.clock.zip(all.clock).map(|(slot, unit)| stamp_of(row.values[slot], unit));
        for (g, group) in plan.extract.groups().iter().enumerate().filter(|(g, _)| row.present[*g]) {
            let samples = &mut self.groups[g];
            let header = clock.unwrap_or(row.stamps[g]);
            let stamp = match all.stamp {
                // Zero would count as not filled in; this is as good as the beginning of time.
                Stamp::Header if plan.latched && (header == 0 || all.clock.is_some() && clock.is_none()) => 1,
                Stamp::Header => header,
                Stamp::Log => log_time,
                Stamp::Publish => publish_time,
            };
            samples.stamps.push(plan.corrected(stamp));
            samples.logs.push(log_time);
            samples.values.extend(group.slots.iter().map(|&slot| row.values[slot]));
            // Most logs have a number in every field of every message, and from the second on there is nothing new.
            if !self.numbers[g] || row.is_text.contains(&true) {
                for &slot in &group.slots {
                    let met = &mut self.met[slot];
                    met.text |= row.is_text[slot];
                    met.number |= !row.is_text[slot] & !row.values[slot].is_nan();
                }
                self.numbers[g] = group.slots.iter().all(|&slot| self.met[slot].number);
            }
        }
    }
}

/// Puts the parts together.
struct Sink<'a> {
    plan: &'a Plan,
    builders: Vec<SeriesBuilder>,
    fields: Vec<FieldTexts>,
    failed: Vec<(u64, String)>,
}

impl<'a> Sink<'a> {
    fn new(path: &Path, plan: &'a Plan, window: i64, budget: &Arc<Budget>) -> Self {
        let mut builders = Vec::new();
        for topic in &plan.topics {
            for group in topic.extract.groups() {
                let name = match &group.key {
                    Some(key) => super::names::column(&topic.name, &key.to_string()),
                    None => topic.name.clone(),
                };
                builders.push(SeriesBuilder::new(path, &name, group.slots.len(), window, budget.clone()));
            }
        }
        let fields = plan
            .topics
            .iter()
            .map(|topic| FieldTexts { met: vec![Met::default(); topic.fields.len()], ..FieldTexts::default() })
            .collect();
        let failed = vec![(0, String::new()); plan.topics.len()];
        Self { plan, builders, fields, failed }
    }

    fn take(&mut self, parts: Vec<TopicPart>) -> Result<(), Error> {
        for (t, part) in parts.into_iter().enumerate() {
            let plan = &self.plan.topics[t];
            let fields = &mut self.fields[t];
            for (all, part_met) in fields.met.iter_mut().zip(&part.met) {
                all.text |= part_met.text;
                all.number |= part_met.number;
            }
            let codes: Vec<f64> = part.texts.names().iter().map(|name| fields.texts.code(name)).collect();
            self.failed[t].0 += part.failed.0;
            if self.failed[t].1.is_empty() {
                self.failed[t].1 = part.failed.1;
            }
            for (g, (group, mut samples)) in plan.extract.groups().iter().zip(part.groups).enumerate() {
                let width = group.slots.len();
                for (column, _) in group.slots.iter().enumerate().filter(|(_, slot)| part.met[**slot].text) {
                    for value in samples.values.iter_mut().skip(column).step_by(width) {
                        *value = codes.get(*value as usize).copied().filter(|_| *value >= 0.0).unwrap_or(f64::NAN);
                    }
                }
                let Samples { stamps, logs, values } = &samples;
                self.builders[plan.first_series + g].extend(&join::Samples {
                    stamps,
                    log_times: logs,
                    values,
                    width,
                })?;
            }
        }
        Ok(())
    }

    fn finish(self, container: &dyn Container) -> Result<Decoded, Error> {
        let finish = |builder: SeriesBuilder| {
            let series = builder.finish()?;
            let breaks = Breaks::new(container.breaks(), series.offset.unwrap_or(0));
            Ok::<_, Error>(Series { breaks, ..series })
        };
        Ok(Decoded {
            series: self.builders.into_iter().map(finish).collect::<Result<_, _>>()?,
            fields: self.fields,
            damage: container.damage(),
            failed: self.failed,
        })
    }
}

//! All messages of a topic as columns: decoded in parallel, put together in the order of the file.

use std::collections::HashMap;

use fleetfoot_data::{ColumnKind, Progress, ensure_memory, parallel_fold};
use fleetfoot_message::{Extract, FieldKind, MISSING, Row};

use super::{
    messages::Messages,
    sample::{having, sample},
};
use crate::{Error, table::MAX_CATEGORIES};

/// The messages of a topic, one row each, in the order of the file.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct MessageColumns {
    /// When they were recorded, nanoseconds.
    pub log_time: Vec<i64>,
    /// When they were published, nanoseconds.
    pub publish_time: Vec<i64>,
    /// Their headers' stamps, nanoseconds; `i64::MIN` where there is none.
    pub header_stamp: Vec<i64>,
    /// The fields.
    pub fields: Vec<MessageField>,
    /// Notes on skipped data.
    pub notes: Vec<String>,
}

/// A field of all messages of a topic.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct MessageField {
    /// Its path within the message.
    pub name: String,
    /// Type of the values. Texts are categories, in the order of their first appearance.
    pub kind: ColumnKind,
    /// One value a message: numbers as they are, codes for texts; NaN where a message has none.
    pub values: Vec<f64>,
}

/// Messages that a file claims to have, as far as that is believable: a damaged count must not take the memory.
fn believed(count: Option<u64>) -> usize {
    count.unwrap_or(0).min(1 << 24) as usize
}

impl Messages {
    /// The fields of a topic that are found in some of its messages, with their kinds.
    ///
    /// # Errors
    /// A topic that does not exist, and messages that cannot be decoded.
    pub fn fields(&self, topic: &str, progress: &dyn Progress) -> Result<Vec<(String, ColumnKind)>, Error> {
        let index = self.container.topic(topic)?;
        let mut samples = sample(self.container.as_ref(), &[index], progress)?;
        let Some(sample) = samples.pop() else { return Ok(Vec::new()) };
        let info = &self.container.topics()[index];
        let wrong = |problem: String| Error::Topic {
            path: self.path.clone(),
            topic: topic.to_owned(),
            type_name: info.type_name.clone(),
            problem,
        };
        let problem = info.problem.clone().or_else(|| sample.codec.as_ref().err().map(ToString::to_string));
        if let Some(problem) = problem {
            return Err(wrong(problem));
        }
        let fields = sample.tree.fields();
        if fields.is_empty() {
            return match sample.failed {
                Some(problem) => Err(wrong(problem)),
                None => Ok(Vec::new()),
            };
        }
        let kind = |kind| match kind {
            FieldKind::Integer => ColumnKind::Integer,
            FieldKind::Boolean => ColumnKind::Boolean,
            FieldKind::Text => ColumnKind::Category(Vec::new()),
            _ => ColumnKind::Float,
        };
        Ok(fields.into_iter().map(|field| (field.path, kind(field.kind))).collect())
    }

    /// Decodes fields of a topic, given by their paths within a message; all that [`Messages::fields`] finds when none are given. Memory holds the
    /// columns and a few pieces of the file.
    ///
    /// # Errors
    /// A topic or a field that does not exist, and a text with too many different values.
    pub fn columns(
        &self,
        topic: &str,
        fields: Option<&[String]>,
        progress: &dyn Progress,
    ) -> Result<MessageColumns, Error> {
        let of_topic = self.fields(topic, progress)?;
        let of = |name: &String| of_topic.iter().find(|(field_name, _)| field_name == name).cloned();
        let wanted: Vec<(String, ColumnKind)> = match fields {
            None => of_topic.clone(),
            Some(names) => {
                names.iter().map(|name| of(name).unwrap_or_else(|| (name.clone(), ColumnKind::Float))).collect()
            }
        };
        // Times beside the fields, and pieces of the file on their way into them.
        let count = believed(self.container.topics()[self.container.topic(topic)?].count);
        ensure_memory(
            count.saturating_mul(8 * (wanted.len() + 4)),
            &format!("a table of {count} messages and {} fields", wanted.len()),
            "name the fields that are needed",
        )?;
        let names: Vec<&str> = wanted.iter().map(|(name, _)| name.as_str()).collect();
        // Without fields there are still the messages' times.
        let (index, extract) = match names.is_empty() {
            true => (self.container.topic(topic)?, None),
            false => self.extract(topic, &names).map(|(index, extract)| (index, Some(extract)))?,
        };
        let pieces = having(self.container.as_ref(), &[index]);
        let mut sink = Sink::new(self, topic, &wanted);
        sink.reserve(self.container.topics()[index].count);
        progress.stage("decoding messages");
        parallel_fold(
            pieces.len(),
            progress,
            |i| self.piece_columns(pieces[i], index, extract.as_deref(), names.len()),
            |part| sink.take(part),
        )?;
        let damage = self.container.damage();
        Ok(sink.finish((!damage.is_empty()).then(|| damage.to_string())))
    }

    fn piece_columns(
        &self,
        piece: usize,
        topic: usize,
        extract: Option<&dyn Extract>,
        count: usize,
    ) -> Result<Part, Error> {
        let mut part = Part { values: vec![Vec::new(); count], text: vec![Vec::new(); count], ..Part::default() };
        let mut row = extract.map_or_else(Row::default, Row::new);
        self.container.read_piece(piece, &[topic], &mut |_, log_time, publish_time, data| {
            if let Some(extract) = extract
                && let Err(error) = extract.extract(data, &mut row)
            {
                part.failed += 1;
                part.why.get_or_insert_with(|| error.to_string());
                return Ok(());
            }
            part.log_time.push(log_time);
            part.publish_time.push(publish_time);
            part.header_stamp.push(row.stamps.iter().copied().find(|&stamp| stamp != MISSING).unwrap_or(MISSING));
            for (slot, values) in part.values.iter_mut().enumerate() {
                if row.is_text[slot] {
                    // The rows before the first text have none.
                    part.text[slot].resize(values.len(), false);
                    part.text[slot].push(true);
                } else if !part.text[slot].is_empty() {
                    part.text[slot].push(false);
                }
                values.push(row.values[slot]);
            }
            Ok(())
        })?;
        part.texts = row.texts.names().to_vec();
        Ok(part)
    }
}

/// Stamps and values in one piece of the file.
#[derive(Default)]
struct Part {
    log_time: Vec<i64>,
    publish_time: Vec<i64>,
    header_stamp: Vec<i64>,
    values: Vec<Vec<f64>>,
    /// For each field whether each value is the code of a text; empty where none is.
    text: Vec<Vec<bool>>,
    texts: Vec<String>,
    failed: u64,
    why: Option<String>,
}

/// Puts the parts together.
struct Sink<'a> {
    of: (&'a Messages, &'a str),
    columns: MessageColumns,
    /// For each field its texts by their codes, and how many numbers stood among them.
    codes: Vec<HashMap<String, u32>>,
    names: Vec<Vec<String>>,
    numbers: Vec<u64>,
    failed: u64,
    why: Option<String>,
}

impl<'a> Sink<'a> {
    fn new(messages: &'a Messages, topic: &'a str, wanted: &[(String, ColumnKind)]) -> Self {
        let field = |(name, kind): &(String, ColumnKind)| MessageField {
            name: name.clone(),
            kind: kind.clone(),
            values: Vec::new(),
        };
        Self {
            of: (messages, topic),
            columns: MessageColumns {
                log_time: Vec::new(),
                publish_time: Vec::new(),
                header_stamp: Vec::new(),
                fields: wanted.iter().map(field).collect(),
                notes: Vec::new(),
            },
            codes: vec![HashMap::new(); wanted.len()],
            names: vec![Vec::new(); wanted.len()],
            numbers: vec![0; wanted.len()],
            failed: 0,
            why: None,
        }
    }

    /// Room for as many messages as the file claims, as far as that is believable.
    fn reserve(&mut self, count: Option<u64>) {
        let count = believed(count);
        self.columns.log_time.reserve(count);
        self.columns.publish_time.reserve(count);
        self.columns.header_stamp.reserve(count);
        for field in &mut self.columns.fields {
            field.values.reserve(count);
        }
    }

    fn take(&mut self, part: Part) -> Result<(), Error> {
        self.failed += part.failed;
        self.why = self.why.take().or(part.why);
        for slot in 0..part.values.len() {
            if !part.text[slot].is_empty() {
                self.take_texts(slot, &part.values[slot], &part.text[slot], &part.texts)?;
                continue;
            }
            self.numbers[slot] += part.values[slot].iter().filter(|value| !value.is_nan()).count() as u64;
            let values = &mut self.columns.fields[slot].values;
            if self.names[slot].is_empty() {
                values.extend_from_slice(&part.values[slot]);
            } else {
                values.resize(values.len() + part.values[slot].len(), f64::NAN);
            }
        }
        self.columns.log_time.extend(part.log_time);
        self.columns.publish_time.extend(part.publish_time);
        self.columns.header_stamp.extend(part.header_stamp);
        Ok(())
    }

    fn take_texts(&mut self, slot: usize, values: &[f64], text: &[bool], texts: &[String]) -> Result<(), Error> {
        let (codes, names) = (&mut self.codes[slot], &mut self.names[slot]);
        let mut known: Vec<Option<u32>> = vec![None; texts.len()];
        let field = &mut self.columns.fields[slot];
        if names.is_empty() {
            // The first texts: what came before is none.
            field.values.fill(f64::NAN);
        }
        for (&value, &is_text) in values.iter().zip(text) {
            if !is_text {
                self.numbers[slot] += u64::from(!value.is_nan());
                field.values.push(f64::NAN);
                continue;
            }
            // Codes beyond the texts stand for all that were too many.
            let place = value as usize;
            let code = match known.get(place) {
                Some(Some(code)) => *code,
                Some(None) if names.len() < MAX_CATEGORIES => {
                    let next = names.len() as u32;
                    let code = *codes.entry(texts[place].clone()).or_insert(next);
                    if code == next {
                        names.push(texts[place].clone());
                    }
                    known[place] = Some(code);
                    code
                }
                Some(None) if codes.contains_key(&texts[place]) => codes[&texts[place]],
                _ => {
                    return Err(Error::TooManyCategories {
                        path: self.of.0.path.clone(),
                        column: super::names::column(self.of.1, &field.name),
                        limit: MAX_CATEGORIES,
                    });
                }
            };
            field.values.push(f64::from(code));
        }
        Ok(())
    }

    fn finish(mut self, damage: Option<String>) -> MessageColumns {
        let topic = self.of.1;
        self.columns.notes.extend(damage);
        if self.failed > 0 {
            let why = self.why.unwrap_or_default();
            self.columns
                .notes
                .push(format!("{topic}: {} messages cannot be decoded and are left out ({why})", self.failed));
        }
        for ((field, names), numbers) in self.columns.fields.iter_mut().zip(self.names).zip(self.numbers) {
            if !names.is_empty() && numbers > 0 {
                self.columns.notes.push(format!(
                    "{}: {numbers} numbers among texts are left out",
                    super::names::column(topic, &field.name)
                ));
            }
            if !names.is_empty() {
                field.kind = ColumnKind::Category(names);
            }
        }
        self.columns
    }
}

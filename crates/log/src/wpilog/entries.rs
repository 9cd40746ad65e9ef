//! Entries of a file: their names, types and schemas.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use fleetfoot_message::wpilog_uses;

use super::record::{Control, Record};
use crate::container::{SchemaRecord, Topic};

/// Bytes of schemas that all topics of a file may have together: each has a copy of those that it uses.
const MAX_SCHEMAS: usize = 4 << 20;

/// The type of the entries that describe structs, and what their names have before the struct's.
const SCHEMA: (&str, &str) = ("structschema", "/.schema/struct:");

/// A name that values come under.
#[derive(Debug)]
struct DeclaredTopic {
    name: String,
    kind: String,
    /// A type of a later entry of that name, if it is another one.
    other: Option<String>,
}

/// Meaning of an entry's number, from an offset of the file on.
#[derive(Debug, Clone, Copy)]
struct Started {
    from: usize,
    /// `None`: the schema of a struct.
    topic: Option<usize>,
}

/// All entries.
#[derive(Debug, Default)]
pub(super) struct Entries {
    topics: Vec<DeclaredTopic>,
    by_name: HashMap<String, usize>,
    /// The entries that each number has stood for, in the order of the file.
    by_id: HashMap<u32, Vec<Started>>,
    /// The struct that an entry describes.
    describes: HashMap<u32, String>,
    schemas: BTreeMap<String, String>,
    metadata: BTreeMap<String, String>,
}

/// Bytes of the values of a type, or of their elements; `None` where they have any number.
fn size(kind: &str) -> Option<(usize, bool)> {
    let (element, many) = kind.strip_suffix("[]").map_or((kind, false), |element| (element, true));
    let size = match element {
        "boolean" => 1,
        "float" => 4,
        "double" | "int64" => 8,
        _ => return None,
    };
    Some((size, many))
}

impl Entries {
    /// The name of a topic among those found.
    pub(super) fn name(&self, topic: usize) -> &str {
        self.topics.get(topic).map_or("", |topic_there| topic_there.name.as_str())
    }

    /// Number of topics, with or without values.
    pub(super) fn len(&self) -> usize {
        self.topics.len()
    }

    fn started(&self, record: &Record<'_>) -> Option<Started> {
        let all = self.by_id.get(&record.entry)?;
        let latest = all.partition_point(|start| start.from <= record.start).checked_sub(1)?;
        all.get(latest).copied()
    }

    /// The topic of a value, if its entry is one.
    pub(super) fn topic_of(&self, record: &Record<'_>) -> Option<usize> {
        self.started(record)?.topic
    }

    /// Checks that the parts of a record fit each other.
    pub(super) fn believe(&self, record: &Record<'_>) -> Result<(), &'static str> {
        if record.entry == 0 {
            return Control::parse(record.payload).map(drop).ok_or("a malformed record about entries");
        }
        let started = self.started(record).ok_or("a value of an entry that was not started")?;
        let kind = started.topic.and_then(|topic| self.topics.get(topic)).map(|topic_there| topic_there.kind.as_str());
        let fits = match kind.and_then(size) {
            Some((size, false)) => record.payload.len() == size,
            Some((size, true)) => record.payload.len().is_multiple_of(size),
            None => true,
        };
        if fits { Ok(()) } else { Err("a value whose length does not fit its type") }
    }

    /// Takes in a record that defines something.
    pub(super) fn add(&mut self, record: &Record<'_>) {
        if record.entry != 0 {
            // The first schema of a name stays.
            if let Some(name) = self.describes.get(&record.entry).filter(|name| !self.schemas.contains_key(*name)) {
                let text = String::from_utf8_lossy(record.payload).replace(['\n', '\r', '\t'], " ");
                self.schemas.insert(name.clone(), text);
            }
            return;
        }
        match Control::parse(record.payload) {
            Some(Control::Start { entry, name, kind, metadata }) => {
                let described = name.rsplit_once(SCHEMA.1).filter(|_| kind == SCHEMA.0).map(|(_, name)| name);
                let topic = match described {
                    Some(described) => {
                        self.describes.insert(entry, described.to_owned());
                        None
                    }
                    None => {
                        self.describes.remove(&entry);
                        Some(self.find(name, kind))
                    }
                };
                self.by_id.entry(entry).or_default().push(Started { from: record.start, topic });
                self.set_metadata(topic, metadata);
            }
            Some(Control::Metadata { entry, metadata }) => {
                let latest = self.by_id.get(&entry).and_then(|all| all.last()).and_then(|start| start.topic);
                self.set_metadata(latest, metadata);
            }
            Some(Control::Finish) | None => {}
        }
    }

    fn set_metadata(&mut self, topic: Option<usize>, metadata: &str) {
        if let Some(topic_there) = topic.and_then(|topic| self.topics.get(topic)).filter(|_| !metadata.is_empty()) {
            self.metadata.insert(format!("metadata {}", topic_there.name), metadata.to_owned());
        }
    }

    fn find(&mut self, name: &str, kind: &str) -> usize {
        let name = if name.starts_with('/') { name.to_owned() } else { format!("/{name}") };
        if let Some(&topic) = self.by_name.get(&name) {
            if let Some(topic_there) = self.topics.get_mut(topic).filter(|topic_there| topic_there.kind != kind) {
                topic_there.other = Some(kind.to_owned());
            }
            return topic;
        }
        self.by_name.insert(name.clone(), self.topics.len());
        self.topics.push(DeclaredTopic { name, kind: kind.to_owned(), other: None });
        self.topics.len() - 1
    }

    /// The topics at these places among those found, each with its count of values.
    pub(super) fn topics(&self, places: &[(usize, u64)]) -> Vec<Topic> {
        let mut budget = MAX_SCHEMAS;
        places
            .iter()
            .filter_map(|&(place, count)| Some(self.topic(self.topics.get(place)?, count, &mut budget)))
            .collect()
    }

    fn topic(&self, declared: &DeclaredTopic, count: u64, budget: &mut usize) -> Topic {
        let (kind, name) = (declared.kind.clone(), declared.name.clone());
        let topic = |message_encoding: &str, schema, problem| Topic {
            name: name.clone(),
            type_name: kind.clone(),
            message_encoding: message_encoding.to_owned(),
            schema,
            count: Some(count),
            problem,
        };
        if let Some(other) = &declared.other {
            let problem = format!("its values come in two types, `{kind}` and `{other}`");
            return topic("wpilog", None, Some(problem));
        }
        let described = |text: String| {
            let schema = SchemaRecord { name: kind.clone(), encoding: "wpilog".into(), data: text.into_bytes().into() };
            topic("wpilog", Some(schema), None)
        };
        if kind == "json" {
            return topic("json", None, None);
        }
        if let Some(struct_name) = kind.strip_prefix("struct:") {
            let text = self.definitions(struct_name.strip_suffix("[]").unwrap_or(struct_name), *budget);
            return match text {
                Some(text) => {
                    *budget -= text.len();
                    described(text)
                }
                None => topic("wpilog", None, Some("the schemas of its structs are too long".to_owned())),
            };
        }
        let is_read = size(&kind).is_some() || matches!(kind.as_str(), "string" | "string[]");
        if is_read {
            return described(String::new());
        }
        let problem = format!("values of the type `{kind}` are not read: only numbers, texts, structs and json are");
        topic("wpilog", None, Some(problem))
    }

    /// The schemas that a struct uses, one a line, its own first; `None` where they are longer than `budget`.
    fn definitions(&self, name: &str, budget: usize) -> Option<String> {
        let mut text = String::new();
        let (mut used, mut next) = (vec![name], 0);
        let mut seen = BTreeSet::from([name]);
        while let Some(&struct_name) = used.get(next) {
            next += 1;
            let Some(declarations) = self.schemas.get(struct_name) else { continue };
            if text.len() + struct_name.len() + declarations.len() + 2 > budget {
                return None;
            }
            text.extend([struct_name, "\t", declarations, "\n"]);
            used.extend(wpilog_uses(declarations).into_iter().filter(|name| seen.insert(name)));
        }
        Some(text)
    }

    /// The metadata of entries, by their names.
    pub(super) fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }
}

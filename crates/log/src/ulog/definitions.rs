//! Formats and subscriptions: the topic of a message, the place of its time, and the meaning of its bytes.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use fleetfoot_message::{UlogLayout, ulog_layout};

use super::message::{LOGGED, LOGGED_TAGGED, Message, Subscription};
use crate::container::{SchemaRecord, Topic};

/// Bytes of definitions that all topics of a file may have together: each has a copy of those that it uses. Files of PX4 have some hundred kilobytes.
const MAX_DEFINITIONS: usize = 4 << 20;

/// The name of message and schema encoding.
const ENCODING: &str = "ulog";

/// Logged texts, as formats: their messages are described as those of a subscription are.
const LOGGED_FORMATS: [(usize, &str, &str); 2] = [
    (LOGGED, "logged_messages", "uint8_t log_level;uint64_t timestamp;char[] message;"),
    (LOGGED_TAGGED, "logged_messages_tagged", "uint8_t log_level;uint16_t tag;uint64_t timestamp;char[] message;"),
];

/// Layout and schema of the messages of a format.
#[derive(Debug)]
struct Described {
    layout: UlogLayout,
    schema: SchemaRecord,
}

/// A format and an instance that messages were subscribed for.
#[derive(Debug)]
pub(super) struct TopicFormat {
    name: String,
    format: String,
    /// Why its messages cannot be read, if so.
    described: Result<Arc<Described>, String>,
}

impl TopicFormat {
    /// As the rest of the crate knows it, with so many messages.
    pub(super) fn topic(&self, count: u64) -> Topic {
        Topic {
            name: self.name.clone(),
            type_name: self.format.clone(),
            message_encoding: ENCODING.to_owned(),
            schema: self.described.as_ref().ok().map(|described| described.schema.clone()),
            count: Some(count),
            problem: self.described.as_ref().err().cloned(),
        }
    }

    /// Its name among columns.
    pub(super) fn name(&self) -> &str {
        &self.name
    }
}

/// A number under which messages of a topic come, from a place of the file on.
#[derive(Debug)]
pub(super) struct Channel {
    /// Its topic among those found.
    pub(super) topic: usize,
    from: usize,
    described: Option<Arc<Described>>,
}

/// Why a message has no time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Untimed {
    /// Its format cannot be read.
    Format,
    /// Its length does not fit its format.
    Length,
    /// Nanoseconds from its writer's boot are no `i64`.
    Late,
}

impl Channel {
    /// The time of a message, nanoseconds.
    #[inline]
    pub(super) fn time(&self, data: &[u8]) -> Result<i64, Untimed> {
        let Described { layout, .. } = &**self.described.as_ref().ok_or(Untimed::Format)?;
        if !layout.bytes.contains(&data.len()) {
            return Err(Untimed::Length);
        }
        let bytes = data.get(layout.timestamp..).and_then(|rest| rest.first_chunk::<8>()).ok_or(Untimed::Length)?;
        let time = i64::try_from(u64::from_le_bytes(*bytes)).ok().and_then(|time| time.checked_mul(1000));
        time.ok_or(Untimed::Late)
    }
}

/// All that a file has said about its formats and subscriptions.
#[derive(Debug)]
pub(super) struct Definitions {
    /// Fields by the name of the format. The first definition of a name stays.
    formats: BTreeMap<String, String>,
    described: BTreeMap<String, Result<Arc<Described>, String>>,
    /// Bytes of definitions that may still be copied.
    budget: usize,
    topics: Vec<TopicFormat>,
    index_by_name: BTreeMap<(String, u8), usize>,
    channels: Vec<Channel>,
    /// The channels that each number has stood for, in the order of the file.
    by_id: Vec<Vec<usize>>,
    pub(super) notes: BTreeSet<String>,
}

impl Default for Definitions {
    fn default() -> Self {
        let mut defaults = Self {
            formats: BTreeMap::new(),
            described: BTreeMap::new(),
            budget: MAX_DEFINITIONS,
            topics: Vec::new(),
            index_by_name: BTreeMap::new(),
            channels: Vec::new(),
            by_id: vec![Vec::new(); LOGGED_TAGGED + 1],
            notes: BTreeSet::new(),
        };
        for (id, name, fields) in LOGGED_FORMATS {
            let described = describe(name, format!("{name}:{fields}\n"));
            defaults.open(id, 0, (name.to_owned(), 0), || described);
        }
        defaults
    }
}

impl Definitions {
    /// The subscriptions.
    pub(super) fn topics(&self) -> &[TopicFormat] {
        &self.topics
    }

    /// The channel of a message with a time, and its bytes.
    #[inline]
    pub(super) fn channel<'a>(&self, message: &Message<'a>) -> Option<(&Channel, &'a [u8])> {
        let (id, data) = message.data()?;
        let subscription = self.by_id.get(id)?;
        // A file may say anew what a number stands for as often as it likes: halving keeps that from being slow.
        let began = |channel: &usize| self.channels.get(*channel).is_some_and(|channel| channel.from <= message.start);
        let latest = subscription.get(subscription.partition_point(began).checked_sub(1)?)?;
        Some((self.channels.get(*latest)?, data))
    }

    /// Adds a format.
    pub(super) fn add_format(&mut self, name: &str, fields: &str) {
        match self.formats.get(name) {
            None => {
                self.formats.insert(name.to_owned(), fields.to_owned());
            }
            Some(known_fields) if known_fields == fields => {}
            Some(_) => {
                self.notes.insert(format!("the format `{name}` is defined twice, and differently: the first is used"));
            }
        }
    }

    /// Adds a subscription: its number stands for it from `at` on.
    pub(super) fn subscribe(&mut self, subscription: &Subscription<'_>, at: usize) {
        let Subscription { instance, id, name } = *subscription;
        // Described beforehand, because it looks at the formats.
        let described = match self.described.get(name) {
            Some(described) => described.clone(),
            None => {
                let described = self.describe(name);
                self.described.insert(name.to_owned(), described.clone());
                described
            }
        };
        self.open(id.into(), at, (name.to_owned(), instance), || described);
    }

    fn open(
        &mut self,
        id: usize,
        from: usize,
        key: (String, u8),
        described: impl FnOnce() -> Result<Arc<Described>, String>,
    ) {
        let (format, instance) = key.clone();
        let topic = *self.index_by_name.entry(key).or_insert_with(|| {
            let name = if instance == 0 { format!("/{format}") } else { format!("/{format}.{instance}") };
            self.topics.push(TopicFormat { name, format, described: described() });
            self.topics.len() - 1
        });
        let Some(subscription) = self.by_id.get_mut(id) else { return };
        if subscription
            .last()
            .and_then(|latest| self.channels.get(*latest))
            .is_some_and(|channel| channel.topic == topic)
        {
            return;
        }
        let described = self.topics.get(topic).and_then(|declared| declared.described.as_ref().ok().cloned());
        subscription.push(self.channels.len());
        self.channels.push(Channel { topic, from, described });
    }

    fn describe(&mut self, name: &str) -> Result<Arc<Described>, String> {
        let text = self.definitions(name)?;
        self.budget = self.budget.saturating_sub(text.len());
        describe(name, text)
    }

    /// The definitions that a format uses, one a line, its own first.
    fn definitions(&self, name: &str) -> Result<String, String> {
        let mut text = String::new();
        let (mut used, mut next) = (vec![name], 0);
        let mut seen = BTreeSet::from([name]);
        while let Some(&definition) = used.get(next) {
            next += 1;
            let Some((definition, fields)) = self.formats.get_key_value(definition) else { continue };
            if text.len() + definition.len() + fields.len() > self.budget {
                return Err("the definitions of its type are too long".to_owned());
            }
            text.extend([definition.as_str(), ":", fields.as_str(), "\n"]);
            let kinds = fields.split(';').filter_map(|field| field.trim_start().split([' ', '[']).next());
            used.extend(kinds.filter(|kind| self.formats.contains_key(*kind) && seen.insert(*kind)));
        }
        Ok(text)
    }
}

fn describe(name: &str, text: String) -> Result<Arc<Described>, String> {
    let layout = ulog_layout(name, &text).map_err(|problem| problem.to_string())?;
    let schema = SchemaRecord { name: name.to_owned(), encoding: ENCODING.to_owned(), data: text.into_bytes().into() };
    Ok(Arc::new(Described { layout, schema }))
}

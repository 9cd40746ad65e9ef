//! Plan for decoding and joining a robot's log.

use std::path::Path;

use fleetfoot_data::setting::TIME_UNIT;
use fleetfoot_data::{Column, ColumnKind, Progress};
use fleetfoot_message::{Extract, FieldInfo, FieldKind, FieldPath, MISSING, SchemaError, Step};

use super::{
    clock::{self, FieldClock},
    names::{Names, inside},
    sample::{Headers, Sample, sample},
};
use crate::{
    Base, Error, JoinKind, MaxGap, Selection, Stamp, TimeSpec, TimeUnit, TopicClock,
    container::Container,
    join::{Base as JoinBase, JoinColumn},
};

/// Plan for decoding and joining.
pub(super) struct Plan {
    pub topics: Vec<TopicPlan>,
    /// The stamp; `Header` if a field of the messages is the clock.
    pub stamp: Stamp,
    /// The unit of the field that is the clock, where one is.
    pub clock: Option<TimeUnit>,
    pub columns: Vec<PlannedColumn>,
    pub base: JoinBase,
    /// Notes on assumptions.
    pub notes: Vec<String>,
}

/// A topic in use.
pub(super) struct TopicPlan {
    /// Its index in the container.
    pub topic: usize,
    /// Its name as columns call it.
    pub name: String,
    pub fields: Vec<FieldPath>,
    pub extract: Box<dyn Extract>,
    /// The field that is its clock, among its fields.
    pub clock: Option<usize>,
    /// Corrections of its stamps, one after the other, if its computer's clock is not that of the other topics.
    pub corrections: Vec<TopicClock>,
    /// The first of its groups among all series: a group of fields is a series.
    pub first_series: usize,
    /// True if all its columns hold without limit: a stamp of zero then means that they always held.
    pub latched: bool,
    /// Keys and fields that were seen, for messages.
    pub seen: Vec<FieldInfo>,
}

impl TopicPlan {
    /// A stamp by the clock of the other topics. One that says nothing (zero, one for always, or missing) goes on saying so.
    pub(super) fn corrected(&self, stamp: i64) -> i64 {
        match stamp {
            0 | 1 | MISSING => stamp,
            _ => self.corrections.iter().fold(stamp, |stamp, clock| clock.corrected(stamp)),
        }
    }
}

/// A selected column.
pub(super) struct PlannedColumn {
    pub column: Column,
    pub join: JoinColumn,
    /// The topic among [`Plan::topics`] and the field in it, where the texts are numbered.
    pub topic: usize,
    pub slot: usize,
}

/// A column while its topic is being collected.
struct ColumnPath {
    topic: usize,
    path: FieldPath,
}

/// Finds the topics and fields of the selected columns.
pub(super) fn plan(
    path: &Path,
    container: &dyn Container,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Plan, Error> {
    let names = Names::new(container.topics().iter().map(|topic| topic.name.as_str()), &selection.join.renames);
    let mut paths = Vec::new();
    for column in &selection.columns {
        paths.push(ask(path, &names, column)?);
    }
    let base = base_topic(path, &names, selection, &paths)?;
    if paths.is_empty() && base.is_none() {
        return Err(Error::NothingAsked { path: path.into() });
    }
    let mut used: Vec<usize> = paths.iter().map(|path| path.topic).chain(base.as_ref().map(|base| base.0)).collect();
    used.sort_unstable();
    used.dedup();
    for &topic in &used {
        container.topic(&container.topics()[topic].name)?;
    }
    let samples = sample(container, &used, progress)?;
    let mut builder = Builder { path, container, names, used, samples, fields: Vec::new() };
    builder.fields = builder.used.iter().map(|_| Vec::new()).collect();
    builder.plan(selection, &paths, base)
}

fn ask(path: &Path, names: &Names, column: &str) -> Result<ColumnPath, Error> {
    let Some((topic, rest)) = names.locate(column) else {
        return Err(Error::MissingTopic {
            path: path.into(),
            column: column.into(),
            nearest: names.nearest(column.split('.').next().unwrap_or(column)),
        });
    };
    match inside(rest).parse() {
        Ok(path) => Ok(ColumnPath { topic, path }),
        Err(problem) => Err(Error::BadField { path: path.into(), column: column.into(), problem: problem.to_string() }),
    }
}

/// The clocks of a log that stamp a topic.
pub(crate) fn corrections(path: &Path, topic: &str, clocks: &[TopicClock]) -> Vec<TopicClock> {
    let is_of = |clock: &&TopicClock| clock.log.as_ref().is_none_or(|log| log == path) && clock.stamps(topic);
    clocks.iter().filter(is_of).cloned().collect()
}

/// The topic and the rest of the name of the base, when the rows come from a topic.
type BaseTopic = Option<(usize, String)>;

fn base_topic(path: &Path, names: &Names, selection: &Selection, paths: &[ColumnPath]) -> Result<BaseTopic, Error> {
    match &selection.join.base {
        Some(Base::Rate(_)) => Ok(None),
        Some(Base::Channel(name)) => match names.locate(name) {
            Some((topic, rest)) => Ok(Some((topic, inside(rest).to_owned()))),
            None => Err(Error::MissingTopic { path: path.into(), column: name.clone(), nearest: names.nearest(name) }),
        },
        None => Ok(paths.first().map(|first| (first.topic, first.path.to_string()))),
    }
}

struct Builder<'a> {
    path: &'a Path,
    container: &'a dyn Container,
    names: Names,
    /// Topics in use, by their index in the container.
    used: Vec<usize>,
    samples: Vec<Sample>,
    /// Fields of each topic in use.
    fields: Vec<Vec<FieldPath>>,
}

impl Builder<'_> {
    fn plan(mut self, selection: &Selection, paths: &[ColumnPath], base: BaseTopic) -> Result<Plan, Error> {
        let seen: Vec<Vec<FieldInfo>> = self.samples.iter().map(|sample| sample.tree.fields()).collect();
        let mut slots = Vec::new();
        for (column, name) in paths.iter().zip(&selection.columns) {
            slots.push(self.place(column, name, &seen, selection));
        }
        if let Some((topic, _)) = &base {
            self.base_needs_a_field(*topic, &seen)?;
        }
        let mut notes = Vec::new();
        let base_topic = base.as_ref().map(|base| base.0);
        let latched: Vec<bool> =
            (0..self.used.len()).map(|used| Some(self.used[used]) != base_topic && is_latched(used, &slots)).collect();
        let clock = self.clock(selection, &seen, &latched, &mut notes)?;
        let (stamp, unit) = match &clock {
            Some(FieldClock { unit, .. }) => (Stamp::Header, Some(*unit)),
            None => (self.stamp(selection, &latched, &mut notes)?, None),
        };
        let (mut topics, mut series) = (Vec::new(), 0);
        for (u, seen) in seen.into_iter().enumerate() {
            let extract = self.compile(u)?;
            let first_series = series;
            series += extract.groups().len();
            topics.push(TopicPlan {
                topic: self.used[u],
                name: self.name(u),
                fields: self.fields[u].clone(),
                extract,
                first_series,
                clock: clock.as_ref().and_then(|clock| clock.slots[u]),
                corrections: corrections(self.path, &self.name(u), &selection.join.clocks),
                latched: latched[u],
                seen,
            });
        }
        let columns = slots
            .into_iter()
            .zip(&selection.columns)
            .map(|(slot, name)| slot.finish(name, &topics, selection))
            .collect();
        let base = match (&selection.join.base, base) {
            (Some(Base::Rate(hz)), _) => JoinBase::Rate(*hz),
            (_, Some((topic, rest))) => JoinBase::Series(self.base_series(topic, &rest, &topics)),
            (_, None) => JoinBase::Series(0),
        };
        if let JoinBase::Series(series) = base
            && topics.len() > 1
            && let Some(topic) = topics.iter().rev().find(|topic| topic.first_series <= series)
        {
            notes.push(format!("one row per message of {}; other channels are joined to these rows", topic.name));
        }
        Ok(Plan { topics, stamp, clock: unit, columns, base, notes })
    }

    fn name(&self, used: usize) -> String {
        let topic = self.used[used];
        self.names.of(topic).unwrap_or(&self.container.topics()[topic].name).to_owned()
    }

    /// Puts a column's field, and for a quaternion all four, among the fields of its topic.
    fn place(&mut self, column: &ColumnPath, name: &str, seen: &[Vec<FieldInfo>], selection: &Selection) -> Slot {
        let used = self.used.iter().position(|&topic| topic == column.topic).unwrap_or_default();
        let info = like(&seen[used], &column.path);
        let rule = selection.join.columns.get(name).copied().unwrap_or_default();
        let float = info.is_none_or(|info| info.kind == FieldKind::Float);
        let kind = match (info, rule.kind) {
            // Between two texts there is none, whatever is asked.
            (Some(info), _) if info.kind == FieldKind::Text => JoinKind::Hold,
            (_, Some(kind)) => kind,
            (Some(info), None) if info.quaternion => JoinKind::Slerp,
            (_, None) if float => JoinKind::Linear,
            (_, None) => JoinKind::Hold,
        };
        let slot = self.field(used, &column.path);
        let quaternion = (kind == JoinKind::Slerp).then(|| components(&column.path)).flatten();
        Slot {
            used,
            slot,
            kind: if quaternion.is_none() && kind == JoinKind::Slerp { JoinKind::Linear } else { kind },
            gap: rule.max_gap,
            quaternion: quaternion.map(|(paths, component)| (paths.map(|path| self.field(used, &path)), component)),
            field: info.map_or(FieldKind::Float, |info| info.kind),
            unit: self.samples[used].codec.as_ref().ok().and_then(|codec| codec.unit(&column.path)),
        }
    }

    fn field(&mut self, used: usize, path: &FieldPath) -> usize {
        let fields = &mut self.fields[used];
        fields.iter().position(|path_of_field| path_of_field == path).unwrap_or_else(|| {
            fields.push(path.clone());
            fields.len() - 1
        })
    }

    /// A base of which no column is selected is decoded for its stamps: any field of it will do.
    fn base_needs_a_field(&mut self, topic: usize, seen: &[Vec<FieldInfo>]) -> Result<(), Error> {
        let used = self.used.iter().position(|&used_topic| used_topic == topic).unwrap_or_default();
        if self.fields[used].is_empty() {
            let any = seen[used].iter().find_map(|info| info.path.parse::<FieldPath>().ok());
            let Some(any) = any else { return Err(self.unreadable(used)) };
            self.fields[used].push(any);
        }
        Ok(())
    }

    fn compile(&self, used: usize) -> Result<Box<dyn Extract>, Error> {
        let sample = &self.samples[used];
        let topic = &self.container.topics()[self.used[used]];
        let refuse = |problem: &SchemaError| Error::Topic {
            path: self.path.into(),
            topic: self.name(used),
            type_name: topic.schema.as_ref().map(|schema| schema.name.clone()).unwrap_or_default(),
            problem: problem.to_string(),
        };
        let codec = sample.codec.as_ref().map_err(refuse)?;
        codec.compile(&self.fields[used]).map_err(|problem| refuse(&problem))
    }

    /// A topic without a message that could be decoded.
    fn unreadable(&self, used: usize) -> Error {
        let sample = &self.samples[used];
        let problem = match (&sample.codec, &sample.failed) {
            (Err(problem), _) => problem.to_string(),
            (_, Some(problem)) => problem.clone(),
            _ => "it has no messages; choose another topic".to_owned(),
        };
        let topic = &self.container.topics()[self.used[used]];
        Error::Topic {
            path: self.path.into(),
            topic: self.name(used),
            type_name: topic.schema.as_ref().map(|schema| schema.name.clone()).unwrap_or_default(),
            problem,
        }
    }

    /// The field that is the clock, where the caller names one: its place among the fields of every topic, and its unit.
    fn clock(
        &mut self,
        selection: &Selection,
        seen: &[Vec<FieldInfo>],
        latched: &[bool],
        notes: &mut Vec<String>,
    ) -> Result<Option<FieldClock>, Error> {
        let TimeSpec::Column { name, unit } = &selection.time else { return Ok(None) };
        let field = ask(self.path, &self.names, name)?.path;
        let refuse = |plan: &Self, used: usize, problem: String| {
            let type_name = plan.container.topics()[plan.used[used]].type_name.clone();
            Error::Topic { path: plan.path.into(), topic: plan.name(used), type_name, problem }
        };
        let mut slots = Vec::new();
        for used in 0..self.used.len() {
            let has_number = like(&seen[used], &field).filter(|info| info.kind != FieldKind::Text).is_some();
            if !has_number && !latched[used] {
                let problem = format!(
                    "its messages lack the number `{field}` that is the clock: choose a field that all channels in use have, or leave this channel out"
                );
                return Err(refuse(self, used, problem));
            }
            slots.push(has_number.then(|| self.field(used, &field)));
        }
        let given_unit =
            || (0..self.used.len()).find_map(|used| clock::unit_of(slots[used].map(|_| &self.samples[used])?, &field));
        let Some(taken) = unit.or_else(given_unit) else {
            let problem = format!(
                "`{field}` does not advance like the log's clock: give its unit ({TIME_UNIT}), or another clock"
            );
            return Err(refuse(self, 0, problem));
        };
        let reason = if unit.is_some() { "" } else { ", as it advances with the log's clock" };
        notes.push(format!("stamps are the field `{field}` of every channel, in {}{reason}", taken.symbol()));
        Ok(Some(FieldClock { slots, unit: taken }))
    }

    /// The clock: the requested one, else the headers' if all messages have one, else the log's.
    ///
    /// A latched topic needs no header: it was sent once, often with a stamp of zero.
    fn stamp(&self, selection: &Selection, latched: &[bool], notes: &mut Vec<String>) -> Result<Stamp, Error> {
        let headers: Vec<Headers> =
            self.samples.iter().zip(&self.fields).map(|(sample, fields)| sample.headers(fields)).collect();
        let without = |wanted: Headers| {
            let needed = |used: &usize| headers[*used] == wanted && !(wanted == Headers::Zero && latched[*used]);
            (0..headers.len()).find(needed).map(|used| self.name(used))
        };
        match selection.join.stamp {
            Some(Stamp::Header) => match without(Headers::None) {
                Some(topic) => Err(Error::NoHeader { path: self.path.into(), topic }),
                None => Ok(Stamp::Header),
            },
            Some(stamp) => Ok(stamp),
            None => {
                let why = match (without(Headers::None), without(Headers::Zero)) {
                    (Some(topic), _) => format!("{topic} has no header"),
                    (_, Some(topic)) => format!("the headers of {topic} are not filled in"),
                    _ => return Ok(Stamp::Header),
                };
                notes.push(format!("stamps are the log's: {why}"));
                Ok(Stamp::Log)
            }
        }
    }

    /// The series of the base: the group whose key the name has, else the first of the topic.
    fn base_series(&self, topic: usize, rest: &str, topics: &[TopicPlan]) -> usize {
        let used = self.used.iter().position(|&used_topic| used_topic == topic).unwrap_or_default();
        let groups = topics[used].extract.groups();
        let keyed = groups.iter().position(|group| {
            group.key.as_ref().is_some_and(|key| {
                let key = key.to_string();
                rest.strip_prefix(&key).is_some_and(|more| more.is_empty() || more.starts_with(['.', '[']))
            })
        });
        let plain = groups.iter().position(|group| group.key.is_none());
        topics[used].first_series + keyed.or(plain).unwrap_or(0)
    }
}

/// Returns true if all columns of a topic hold without limit.
fn is_latched(used: usize, slots: &[Slot]) -> bool {
    let mut of_topic = slots.iter().filter(|slot| slot.used == used).peekable();
    of_topic.peek().is_some() && of_topic.all(|slot| slot.kind == JoinKind::Hold && slot.gap == MaxGap::Unlimited)
}

/// Source of a column's values, before topics are compiled.
struct Slot {
    used: usize,
    slot: usize,
    kind: JoinKind,
    gap: MaxGap,
    /// The fields x, y, z, w, and which of them this is.
    quaternion: Option<([usize; 4], usize)>,
    field: FieldKind,
    /// The unit that the log tells of its values.
    unit: Option<String>,
}

impl Slot {
    fn finish(self, name: &str, topics: &[TopicPlan], selection: &Selection) -> PlannedColumn {
        let topic = &topics[self.used];
        let groups = topic.extract.groups();
        let find = |slot: usize| {
            groups.iter().enumerate().find_map(|(group, members)| {
                members.slots.iter().position(|&field| field == slot).map(|column| (group, column))
            })
        };
        let (group, column) = find(self.slot).unwrap_or_default();
        let quaternion = self
            .quaternion
            .map(|(slots, component)| (slots.map(|slot| find(slot).map_or(column, |(_, column)| column)), component));
        // Between samples there are no whole numbers and no truth values.
        let held = self.kind == JoinKind::Hold
            || selection.join.columns.get(name).and_then(|rule| rule.kind).is_none() && self.field != FieldKind::Float;
        let kind = match self.field {
            FieldKind::Integer if held => ColumnKind::Integer,
            FieldKind::Boolean if held => ColumnKind::Boolean,
            FieldKind::Text => ColumnKind::Category(Vec::new()),
            _ => ColumnKind::Float,
        };
        PlannedColumn {
            column: Column { name: name.to_owned(), unit: self.unit, kind },
            join: JoinColumn {
                series: topic.first_series + group,
                column,
                kind: self.kind,
                gap: self.gap,
                quaternion: quaternion.map(|(columns, _)| columns),
                component: quaternion.map_or(0, |(_, component)| component),
            },
            topic: self.used,
            slot: self.slot,
        }
    }
}

/// The field of this path, or one that differs only in keys and places.
fn like<'a>(seen: &'a [FieldInfo], path: &FieldPath) -> Option<&'a FieldInfo> {
    let text = path.to_string();
    seen.iter().find(|info| info.path == text).or_else(|| {
        seen.iter().find(|info| {
            info.path.parse::<FieldPath>().is_ok_and(|info_path| {
                info_path.steps.len() == path.steps.len()
                    && info_path.steps.iter().zip(&path.steps).all(|(a, b)| match (a, b) {
                        (Step::Field(a), Step::Field(b)) => a == b,
                        (Step::Field(_), _) | (_, Step::Field(_)) => false,
                        _ => true,
                    })
            })
        })
    })
}

/// The four components of the quaternion that a path is one of, and which.
fn components(path: &FieldPath) -> Option<([FieldPath; 4], usize)> {
    let (last, parent) = path.steps.split_last()?;
    let letters = ["x", "y", "z", "w"];
    let component = letters.iter().position(|letter| matches!(last, Step::Field(name) if &**name == *letter))?;
    let sibling = |letter: &str| {
        let mut steps = parent.to_vec();
        steps.push(Step::Field(letter.into()));
        FieldPath { steps }
    };
    Some((letters.map(sibling), component))
}

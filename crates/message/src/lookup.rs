//! Wanted fields, looked up in a decoded message.
//!
//! This is how fields are extracted where the message's own form leaves nothing to compile (JSON) or where its parts may come in any order
//! and more than once (protobuf). It is also the plain statement of what a path means, which compiled programs are tested against.

use std::sync::Arc;

use crate::{
    FieldPath, Group, MISSING, Row, Step, Value,
    keys::{self, KEY_FIELDS, NAME_ARRAYS},
};

/// Names of the seconds in a time.
const SECONDS: [&str; 3] = ["sec", "secs", "seconds"];
/// Names of the nanoseconds in a time.
const NANOSECONDS: [&str; 4] = ["nanosec", "nsec", "nsecs", "nanos"];
/// Fields that are the stamp of the struct that they stand in, after `header.stamp`.
const STAMPS: [&str; 2] = ["stamp", "timestamp"];

/// Value of an element that is absent.
static NULL: Value = Value::Null;

/// Wanted fields of decoded messages.
#[derive(Debug)]
pub(crate) struct Lookup {
    groups: Vec<Group>,
    /// For each wanted field, the way on from its group's element.
    rests: Vec<Vec<Step>>,
}

impl Lookup {
    /// Sorts fields into groups, which come in the order of their first field.
    pub(crate) fn new(fields: &[FieldPath]) -> Self {
        let mut groups: Vec<Group> = Vec::new();
        let mut rests = Vec::with_capacity(fields.len());
        let mut places = std::collections::HashMap::new();
        for (slot, field) in fields.iter().enumerate() {
            let keyed = field.steps.iter().rposition(|step| matches!(step, Step::Key(_))).map_or(0, |last| last + 1);
            let (key, rest) = field.steps.split_at(keyed);
            let place = *places.entry(key).or_insert_with(|| {
                let key = (!key.is_empty()).then(|| FieldPath { steps: key.to_vec() });
                groups.push(Group { key, slots: Vec::new() });
                groups.len() - 1
            });
            groups[place].slots.push(slot);
            rests.push(rest.to_vec());
        }
        Self { groups, rests }
    }

    /// See [`crate::Extract::groups`].
    pub(crate) fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Fills a row, which has the size of [`Lookup::groups`], from a message.
    pub(crate) fn extract(&self, message: &Value, row: &mut Row) {
        row.values.fill(f64::NAN);
        let outer = stamp(message).unwrap_or(MISSING);
        for (place, group) in self.groups.iter().enumerate() {
            let mut time = outer;
            let element = match &group.key {
                None => Some(message),
                Some(key) => follow(message, &key.steps, |inside| time = stamp(inside).unwrap_or(time)),
            };
            row.present[place] = element.is_some();
            row.stamps[place] = if element.is_some() { time } else { MISSING };
            for &slot in &group.slots {
                let value = element.and_then(|element| follow(element, &self.rests[slot], |_| ()));
                match value {
                    Some(Value::Text(text)) => row.set_text(slot, text),
                    Some(Value::Null) | None => (),
                    Some(value) => {
                        row.values[slot] = value.number().unwrap_or(f64::NAN);
                        row.is_text[slot] = false;
                    }
                }
            }
        }
    }
}

/// Value at the end of a path, if the path exists. `visit` receives every value on the way, from the outside in.
///
/// An element that has a name in the array beside but no value of its own is [`Value::Null`].
pub(crate) fn follow<'a>(start: &'a Value, steps: &[Step], mut visit: impl FnMut(&'a Value)) -> Option<&'a Value> {
    // The struct that holds `at` as a field, and under which name: only there can an array of names stand beside it.
    let mut around: Option<(&Value, &str)> = None;
    let mut at = start;
    for step in steps {
        let next = match (step, at) {
            (Step::Field(name), _) => at.field(name)?,
            (Step::Index(index), Value::Array(elements)) => elements.get(*index)?,
            (Step::Key(key), _) => element(at, around, key)?,
            (Step::Index(_), _) => return None,
        };
        around = if let Step::Field(name) = step { Some((at, name)) } else { None };
        at = next;
        visit(at);
    }
    Some(at)
}

/// The element of an array that has a name: by the text that its elements carry, else by the array of names beside it. Of several with the
/// same name it is the last.
fn element<'a>(array: &'a Value, around: Option<(&'a Value, &str)>, key: &str) -> Option<&'a Value> {
    let elements: &[Value] = match array {
        Value::Array(elements) => elements,
        Value::Long(_) => &[],
        _ => return None,
    };
    if keys::are_keyed(elements) {
        return elements.iter().rev().find(|element| keys::key(element) == Some(key));
    }
    let (Value::Struct(fields), key_of) = around? else { return None };
    let (place, names) = keys::names(fields)?;
    if *fields[place].0 == *key_of {
        return None;
    }
    let place = names.iter().rposition(|name| matches!(name, Value::Text(text) if text == key))?;
    Some(elements.get(place).unwrap_or(&NULL))
}

/// The stamp that a struct carries, in nanoseconds: `header.stamp`, else `stamp`, else `timestamp`.
pub(crate) fn stamp(value: &Value) -> Option<i64> {
    let header = value.field("header").and_then(|header| header.field("stamp")).and_then(time);
    header.or_else(|| STAMPS.iter().find_map(|name| value.field(name).and_then(time)))
}

/// A time of whole seconds and nanoseconds, in nanoseconds, if it fits.
fn time(value: &Value) -> Option<i64> {
    let part = |names: &[&str]| match names.iter().find_map(|name| value.field(name))? {
        Value::Int(part) => Some(*part),
        Value::Uint(part) => i64::try_from(*part).ok(),
        _ => None,
    };
    part(&SECONDS)?.checked_mul(1_000_000_000)?.checked_add(part(&NANOSECONDS)?)
}

/// The parts of a message that a [`Lookup`] looks at, as a tree of field names; elements of an array share their array's node.
#[derive(Debug, Default)]
pub(crate) struct Wanted {
    /// Fields of the struct, or of each of the array's structs; none at the end of a path.
    pub(crate) fields: Vec<(Arc<str>, Wanted)>,
    /// Number of leading elements of the array to decode.
    pub(crate) elements: usize,
}

impl Wanted {
    /// Parts of a message to decode for some fields: the fields, the names that key them, and the stamps around them.
    pub(crate) fn new(fields: &[FieldPath]) -> Self {
        let mut root = Self::default();
        root.want_stamp();
        for field in fields {
            let keyed = field.steps.iter().rposition(|step| matches!(step, Step::Key(_))).map_or(0, |last| last + 1);
            let mut node = &mut root;
            for (place, step) in field.steps.iter().enumerate() {
                match step {
                    Step::Field(name) => {
                        if matches!(field.steps.get(place + 1), Some(Step::Key(_))) {
                            for names in NAME_ARRAYS {
                                node.child(names).elements = usize::MAX;
                            }
                        }
                        node = node.child(name);
                    }
                    Step::Index(index) => node.elements = node.elements.max(index.saturating_add(1)),
                    Step::Key(_) => {
                        node.elements = usize::MAX;
                        for key in KEY_FIELDS {
                            node.child(key);
                        }
                    }
                }
                // Only the message tells if this is a struct: elsewhere its wanted stamp is never met.
                if place < keyed {
                    node.want_stamp();
                }
            }
        }
        root
    }

    /// The child of a name, made when it is new.
    fn child(&mut self, name: &str) -> &mut Self {
        let place = self.fields.iter().position(|(field_name, _)| &**field_name == name).unwrap_or_else(|| {
            self.fields.push((Arc::from(name), Self::default()));
            self.fields.len() - 1
        });
        &mut self.fields[place].1
    }

    /// Wants the stamp of the struct here.
    fn want_stamp(&mut self) {
        self.child("header").child("stamp").want_time();
        for name in STAMPS {
            self.child(name).want_time();
        }
    }

    fn want_time(&mut self) {
        for part in SECONDS.iter().chain(&NANOSECONDS) {
            self.child(part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(fields: Vec<(&str, Value)>) -> Value {
        Value::Struct(fields.into_iter().map(|(name, value)| (Arc::from(name), value)).collect())
    }

    fn texts(texts: &[&str]) -> Value {
        Value::Array(texts.iter().map(|text| Value::Text((*text).to_owned())).collect())
    }

    fn floats(numbers: &[f64]) -> Value {
        Value::Array(numbers.iter().copied().map(Value::Float).collect())
    }

    fn seconds(sec: i64) -> Value {
        object(vec![("sec", Value::Int(sec)), ("nanosec", Value::Uint(5))])
    }

    fn row(message: &Value, paths: &[&str]) -> (Row, Vec<Group>) {
        let paths: Vec<FieldPath> = paths.iter().map(|path| path.parse().unwrap()).collect();
        let lookup = Lookup::new(&paths);
        let groups = lookup.groups().to_vec();
        let mut row = Row {
            values: vec![7.0; paths.len()],
            present: vec![true; groups.len()],
            stamps: vec![7; groups.len()],
            is_text: vec![false; paths.len()],
            texts: Default::default(),
        };
        lookup.extract(message, &mut row);
        (row, groups)
    }

    #[test]
    fn parallel_arrays_are_keyed_by_names() {
        let message = object(vec![
            ("header", object(vec![("stamp", seconds(3)), ("frame_id", Value::Text("base".into()))])),
            ("name", texts(&["left", "right"])),
            ("position", floats(&[1.0, 2.0])),
            ("velocity", floats(&[5.0])),
        ]);
        let paths =
            ["position[right]", "velocity[right]", "position[middle]", "header.frame_id", "position[0]", "position[9]"];
        let (row, groups) = row(&message, &paths);
        assert_eq!(groups.len(), 4);
        assert_eq!(groups[3], Group { key: None, slots: vec![3, 4, 5] });
        assert_eq!(row.present, [true, true, false, true]);
        assert_eq!(row.stamps, [3_000_000_005, 3_000_000_005, MISSING, 3_000_000_005]);
        assert_eq!((row.values[0], row.values[3], row.values[4]), (2.0, 0.0, 1.0));
        assert!(row.values[1].is_nan() && row.values[2].is_nan() && row.values[5].is_nan());
        assert_eq!(row.texts.names(), ["base"]);
        assert_eq!(row.is_text, [false, false, false, true, false, false]);
    }

    #[test]
    fn elements_have_separate_names_and_stamps() {
        let transform = |child: &str, sec, x| {
            object(vec![
                ("header", object(vec![("stamp", seconds(sec)), ("frame_id", Value::Text("odom".into()))])),
                ("child_frame_id", Value::Text(child.into())),
                ("x", Value::Float(x)),
                ("inner", object(vec![("name", texts(&["m"])), ("temp", Value::Array(vec![Value::Bool(true)]))])),
            ])
        };
        let message = object(vec![(
            "transforms",
            Value::Array(vec![transform("a", 1, 1.0), transform("b", 2, 2.0), transform("a", 3, 3.0)]),
        )]);
        let (row, groups) = row(
            &message,
            &[
                "transforms[a].x",
                "transforms[b].x",
                "transforms[1].x",
                "transforms[b].inner.temp[m]",
                "transforms[c].x",
            ],
        );
        assert_eq!(row.values[..4], [3.0, 2.0, 2.0, 1.0]);
        assert_eq!(row.stamps, [3_000_000_005, 2_000_000_005, MISSING, 2_000_000_005, MISSING]);
        assert_eq!(row.present, [true, true, true, true, false]);
        assert_eq!(groups[3].key.as_ref().unwrap().to_string(), "transforms[b].inner.temp[m]");
    }

    #[test]
    fn overflowing_time_is_no_stamp() {
        let huge = object(vec![("stamp", object(vec![("seconds", Value::Int(i64::MAX)), ("nanos", Value::Int(0))]))]);
        assert_eq!(stamp(&huge), None);
        assert_eq!(
            stamp(&object(vec![("timestamp", object(vec![("secs", Value::Uint(2)), ("nsecs", Value::Uint(1))]))])),
            Some(2_000_000_001)
        );
    }
}

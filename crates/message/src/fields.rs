//! Fields of a channel's messages, with statistics.

use std::{collections::HashMap, sync::Arc};

use crate::{
    Value, keys,
    tally::{FieldKind, Tally},
};

/// Elements of one array that are told apart by their place, and again by their name.
const MAX_ELEMENTS: usize = 256;
/// Fields of one struct; more occur only where names are made up, as in JSON objects used as dictionaries.
const MAX_FIELDS: usize = 4096;
/// Structs and arrays inside each other.
const MAX_DEPTH: usize = 64;
/// Values that are told apart in all.
const MAX_NODES: usize = 1 << 18;
/// Structs with no more fields than this are searched without an index.
const FEW_FIELDS: usize = 16;

/// One field of a channel's messages, over all messages that were seen.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FieldInfo {
    /// Its name; reads back as a [`FieldPath`](crate::FieldPath).
    pub path: String,
    /// Kind of the values. If messages differ, the widest: truth values and whole numbers become real numbers,
    /// everything else becomes text.
    pub kind: FieldKind,
    /// Values that are there.
    pub count: u64,
    /// Values that are NaN or null.
    pub missing: u64,
    /// The smallest number; NaN without numbers. Truth values count as 0 and 1.
    pub min: f64,
    /// The mean of the numbers; NaN without numbers.
    pub mean: f64,
    /// The largest number; NaN without numbers.
    pub max: f64,
    /// Its struct has exactly the fields x, y, z and w, and they are real numbers: it is one part of a rotation.
    pub quaternion: bool,
    /// The first different texts, at most 64, in the order of their appearance.
    pub texts: Vec<String>,
}

/// The fields of many messages, as a tree in the shape of the messages.
///
/// Messages are added one by one; trees of consecutive parts of a log are merged in their order, and give what one tree of the whole gives
/// (means up to rounding).
#[derive(Debug, Clone, Default)]
pub struct FieldTree {
    root: Node,
    nodes: usize,
    ignored: u64,
}

/// A place in the messages: what values were there, and what was inside.
#[derive(Debug, Clone, Default)]
struct Node {
    tally: Tally,
    /// The longest array that was only counted here.
    long: usize,
    inside: Option<Box<Inside>>,
}

/// The parts of structs and arrays.
#[derive(Debug, Clone, Default)]
struct Inside {
    fields: Vec<(Arc<str>, Node)>,
    places: HashMap<Arc<str>, usize>,
    elements: Vec<(Element, Node)>,
    indices: HashMap<usize, usize>,
    keys: HashMap<Arc<str>, usize>,
}

/// Identity of an array's element: its place or its name.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Element {
    Index(usize),
    Key(Arc<str>),
}

impl FieldTree {
    /// Adds a message.
    pub fn add(&mut self, message: &Value) {
        let Self { root, nodes, ignored } = self;
        let mut growth = Growth { nodes, ignored };
        root.add(message, None, 0, &mut growth);
    }

    /// Adds what a tree has seen of the messages that follow this tree's.
    pub fn merge(&mut self, later: Self) {
        self.ignored += later.ignored;
        let mut growth = Growth { nodes: &mut self.nodes, ignored: &mut self.ignored };
        self.root.merge(later.root, &mut growth);
    }

    /// All numbers, truth values and texts, in the order of their first appearance within their struct or array.
    pub fn fields(&self) -> Vec<FieldInfo> {
        let mut fields = Vec::new();
        self.root.collect(&mut String::new(), false, &mut fields);
        fields
    }

    /// Arrays that had more than 64 elements and were only counted: path and greatest length.
    pub fn skipped(&self) -> Vec<(String, usize)> {
        let mut skipped = Vec::new();
        self.root.walk(&mut String::new(), &mut |path, node| {
            if node.long > 0 {
                skipped.push((path.to_owned(), node.long));
            }
        });
        skipped
    }

    /// Number of values that were left out. An array may have 256 different elements, a struct 4096 different fields,
    /// and nesting 64 levels. A field whose name is empty, or has dots or brackets, is left out too: no path can name
    /// it.
    pub fn ignored(&self) -> u64 {
        self.ignored
    }
}

/// Room for growth of a tree, and its count of ignored values.
struct Growth<'a> {
    nodes: &'a mut usize,
    ignored: &'a mut u64,
}

impl Growth<'_> {
    /// Room for one more node.
    fn grow(&mut self) -> bool {
        let room = *self.nodes < MAX_NODES;
        *self.nodes += usize::from(room);
        room
    }
}

impl Node {
    /// Adds a value. `names` are those of the array beside, where there is one.
    fn add(&mut self, value: &Value, names: Option<&[Value]>, depth: usize, growth: &mut Growth<'_>) {
        match value {
            Value::Struct(_) | Value::Array(_) if depth >= MAX_DEPTH => *growth.ignored += 1,
            Value::Struct(fields) => self.inside.get_or_insert_default().add_struct(fields, depth, growth),
            Value::Array(elements) => self.inside.get_or_insert_default().add_array(elements, names, depth, growth),
            Value::Long(length) => self.long = self.long.max(*length),
            Value::Null | Value::Bool(_) | Value::Int(_) | Value::Uint(_) | Value::Float(_) | Value::Text(_) => {
                self.tally.add(value);
            }
        }
    }

    fn merge(&mut self, later: Self, growth: &mut Growth<'_>) {
        self.tally.merge(later.tally);
        self.long = self.long.max(later.long);
        let Some(inside) = later.inside else { return };
        let below = self.inside.get_or_insert_default();
        for (place, (name, node)) in inside.fields.into_iter().enumerate() {
            match below.field(place, &name, growth) {
                Some(mine) => mine.merge(node, growth),
                None => *growth.ignored += node.values(),
            }
        }
        for (element, node) in inside.elements {
            let mine = match &element {
                Element::Index(index) => below.index(*index, growth),
                Element::Key(key) => below.key(key, growth),
            };
            match mine {
                Some(mine) => mine.merge(node, growth),
                None => *growth.ignored += node.values(),
            }
        }
    }

    /// Number of values that were added to this node and below.
    fn values(&self) -> u64 {
        let mut values = 0;
        self.walk(&mut String::new(), &mut |_, node| values += node.tally.count() + node.tally.missing());
        values
    }

    /// Visits this node and all inside with their paths.
    fn walk(&self, path: &mut String, visit: &mut impl FnMut(&str, &Self)) {
        visit(path, self);
        let Some(inside) = &self.inside else { return };
        let length = path.len();
        for (name, node) in &inside.fields {
            push_field(path, name);
            node.walk(path, visit);
            path.truncate(length);
        }
        for (element, node) in &inside.elements {
            push_element(path, element);
            node.walk(path, visit);
            path.truncate(length);
        }
    }

    fn collect(&self, path: &mut String, quaternion: bool, fields: &mut Vec<FieldInfo>) {
        // A message that is one bare value has no fields to name.
        if let Some(kind) = self.tally.kind().filter(|_| !path.is_empty()) {
            fields.push(FieldInfo {
                path: path.clone(),
                kind,
                count: self.tally.count(),
                missing: self.tally.missing(),
                min: self.tally.min(),
                mean: self.tally.mean(),
                max: self.tally.max(),
                quaternion,
                texts: self.tally.texts().to_vec(),
            });
        }
        let Some(inside) = &self.inside else { return };
        let quaternion = inside.is_quaternion();
        let length = path.len();
        for (name, node) in &inside.fields {
            push_field(path, name);
            node.collect(path, quaternion, fields);
            path.truncate(length);
        }
        for (element, node) in &inside.elements {
            push_element(path, element);
            node.collect(path, false, fields);
            path.truncate(length);
        }
    }
}

impl Inside {
    fn add_struct(&mut self, fields: &[(Arc<str>, Value)], depth: usize, growth: &mut Growth<'_>) {
        let names = keys::names(fields);
        for (place, (name, value)) in fields.iter().enumerate() {
            let beside = names.filter(|(place_named, _)| *place_named != place).map(|(_, names)| names);
            match self.field(place, name, growth) {
                Some(node) => node.add(value, beside, depth + 1, growth),
                None => *growth.ignored += 1,
            }
        }
    }

    fn add_array(&mut self, elements: &[Value], names: Option<&[Value]>, depth: usize, growth: &mut Growth<'_>) {
        let names = names.filter(|names| names.len() == elements.len() && !keys::are_keyed(elements));
        for (place, element) in elements.iter().enumerate() {
            let beside = names.and_then(|names| match &names[place] {
                Value::Text(name) => Some(name.as_str()),
                _ => None,
            });
            // An array of names beside decides for the whole array, also where one of the names cannot be used.
            let key = if names.is_some() { beside } else { keys::key(element) };
            let node = match key.filter(|key| keys::usable(key)) {
                Some(key) => self.key(key, growth),
                None => self.index(place, growth),
            };
            match node {
                Some(node) => node.add(element, None, depth + 1, growth),
                None => *growth.ignored += 1,
            }
        }
    }

    /// The field of a name, which is mostly at the place where it is in the message.
    fn field(&mut self, place: usize, name: &Arc<str>, growth: &mut Growth<'_>) -> Option<&mut Node> {
        let place_of_name = match self.fields.get(place) {
            Some((field_name, _)) if field_name == name => Some(place),
            _ if self.fields.len() <= FEW_FIELDS => self.fields.iter().position(|(field_name, _)| field_name == name),
            _ => self.places.get(name).copied(),
        };
        let place = match place_of_name {
            Some(place) => place,
            None if self.fields.len() < MAX_FIELDS && keys::nameable(name) && growth.grow() => {
                self.places.insert(name.clone(), self.fields.len());
                self.fields.push((name.clone(), Node::default()));
                self.fields.len() - 1
            }
            None => return None,
        };
        self.fields.get_mut(place).map(|(_, node)| node)
    }

    fn index(&mut self, index: usize, growth: &mut Growth<'_>) -> Option<&mut Node> {
        let place = match self.elements.get(index) {
            Some((Element::Index(known_index), _)) if *known_index == index => index,
            _ => match self.indices.get(&index) {
                Some(&place) => place,
                None if index < MAX_ELEMENTS && growth.grow() => {
                    self.indices.insert(index, self.elements.len());
                    self.elements.push((Element::Index(index), Node::default()));
                    self.elements.len() - 1
                }
                None => return None,
            },
        };
        self.elements.get_mut(place).map(|(_, node)| node)
    }

    fn key(&mut self, key: &str, growth: &mut Growth<'_>) -> Option<&mut Node> {
        let place = match self.keys.get(key) {
            Some(&place) => place,
            None if self.keys.len() < MAX_ELEMENTS && growth.grow() => {
                let key: Arc<str> = Arc::from(key);
                self.keys.insert(key.clone(), self.elements.len());
                self.elements.push((Element::Key(key), Node::default()));
                self.elements.len() - 1
            }
            None => return None,
        };
        self.elements.get_mut(place).map(|(_, node)| node)
    }

    /// Exactly x, y, z and w, of real numbers. Writers of JSON leave the point out of whole numbers, so that one real number is enough.
    fn is_quaternion(&self) -> bool {
        let kinds = ["x", "y", "z", "w"].map(|wanted| {
            let field = self.fields.iter().find(|(name, _)| &**name == wanted);
            field.filter(|(_, node)| node.inside.is_none()).and_then(|(_, node)| node.tally.kind())
        });
        self.fields.len() == 4
            && kinds.iter().all(|kind| matches!(kind, Some(FieldKind::Float | FieldKind::Integer)))
            && kinds.contains(&Some(FieldKind::Float))
    }
}

fn push_field(path: &mut String, name: &str) {
    if !path.is_empty() {
        path.push('.');
    }
    path.push_str(name);
}

fn push_element(path: &mut String, element: &Element) {
    path.push('[');
    match element {
        Element::Index(index) => path.push_str(&index.to_string()),
        Element::Key(key) => path.push_str(key),
    }
    path.push(']');
}

#[cfg(test)]
#[path = "fields_tests.rs"]
mod tests;

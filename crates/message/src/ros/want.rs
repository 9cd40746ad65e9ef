//! The wanted fields as a tree over the schema, whatever the layout of the bytes.

use std::collections::{BTreeMap, HashMap};

use fleetfoot_data::nearest_one;

use crate::{
    FieldPath, Group, Length, Scalar, Schema, SchemaError, Step, StructType, Type,
    keys::{KEY_FIELDS, NAME_ARRAYS},
};

/// Wanted parts of a value.
#[derive(Debug, Default)]
pub(super) struct Want {
    /// Of a number or text: the slots that it goes to.
    pub(super) slots: Vec<usize>,
    /// Of a number: the groups whose stamp has it as its seconds.
    pub(super) seconds: Vec<usize>,
    /// Of a number: the groups whose stamp has it as its nanoseconds.
    pub(super) nanoseconds: Vec<usize>,
    /// Of a struct: wanted parts of its fields, by their places.
    pub(super) fields: BTreeMap<usize, Want>,
    /// Of a struct: wanted names in its array of names.
    pub(super) names: Option<Names>,
    /// Of an array: wanted parts of its elements.
    pub(super) picks: Vec<Pick>,
}

/// Wanted elements of the arrays that stand beside an array of names.
#[derive(Debug)]
pub(super) struct Names {
    /// The place of the array of names among the fields of the struct.
    pub(super) field: usize,
    /// Names, the registers for their places, and the groups that are present when the name is there.
    pub(super) wanted: Vec<(String, usize, Vec<usize>)>,
}

/// A wanted element of an array.
#[derive(Debug)]
pub(super) struct Pick {
    pub(super) which: Which,
    pub(super) want: Want,
    /// The group that is present when the element is there.
    pub(super) group: Option<usize>,
}

/// Selector of an array's element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Which {
    /// The one at this place.
    Index(usize),
    /// The last one that carries this name.
    Key(String),
    /// The one at the place that this register holds.
    Register(usize),
}

/// The wanted fields of a schema.
#[derive(Debug)]
pub(super) struct Wanted {
    pub(super) root: Want,
    pub(super) groups: Vec<Group>,
    pub(super) slots: usize,
    pub(super) registers: usize,
}

/// A step of a path, by the schema instead of by names.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Move {
    Field(usize),
    Index(usize),
    Key(String),
    /// A field and the element of it that the array of names beside it gives this name.
    Beside(usize, String),
}

/// A path that is known to exist.
struct Resolved {
    moves: Vec<Move>,
    /// Number of moves, and of steps, up to and including the last name; zero without a name.
    key: (usize, usize),
}

/// Finds the wanted fields in the schema.
///
/// # Errors
/// Fields that the schema does not have or that are no values.
pub(super) fn resolve(schema: &Schema, fields: &[FieldPath]) -> Result<Wanted, SchemaError> {
    let resolved: Vec<Resolved> = fields.iter().map(|field| path(schema, field)).collect::<Result<_, _>>()?;
    let mut wanted = Wanted { root: Want::default(), groups: Vec::new(), slots: fields.len(), registers: 0 };
    let mut groups: HashMap<&[Move], usize> = HashMap::new();
    for (slot, (path, field)) in resolved.iter().zip(fields).enumerate() {
        let key = path.moves.get(..path.key.0).unwrap_or_default();
        let count = wanted.groups.len();
        let group = *groups.entry(key).or_insert(count);
        if group == count {
            let steps = field.steps.get(..path.key.1).unwrap_or_default().to_vec();
            let key = (!steps.is_empty()).then_some(FieldPath { steps });
            wanted.groups.push(Group { key, slots: Vec::new() });
        }
        if let Some(group) = wanted.groups.get_mut(group) {
            group.slots.push(slot);
        }
        wanted.add(schema, path, |want| want.slots.push(slot), Some(group));
    }
    for (key, &group) in &groups {
        let Some((seconds, nanoseconds)) = stamp(schema, key) else { continue };
        wanted.add(schema, &Resolved { moves: seconds, key: (0, 0) }, |want| want.seconds.push(group), None);
        wanted.add(schema, &Resolved { moves: nanoseconds, key: (0, 0) }, |want| want.nanoseconds.push(group), None);
    }
    Ok(wanted)
}

impl Wanted {
    /// Marks what a path leads to.
    fn add(&mut self, schema: &Schema, resolved: &Resolved, mark: impl FnOnce(&mut Want), group: Option<usize>) {
        let mut at = Some(schema.root);
        let mut want = &mut self.root;
        let mut kind = None;
        for (place, step) in resolved.moves.iter().enumerate() {
            let group = group.filter(|_| place + 1 == resolved.key.0);
            match step {
                Move::Field(field) => {
                    kind = field_type(schema, at, *field);
                    want = want.fields.entry(*field).or_default();
                }
                Move::Index(index) => {
                    kind = element(kind);
                    want = want.pick(Which::Index(*index), None);
                }
                Move::Key(key) => {
                    kind = element(kind);
                    want = want.pick(Which::Key(key.clone()), group);
                }
                Move::Beside(field, key) => {
                    let names = at.and_then(|at| schema.structs.get(at)).and_then(names_field).unwrap_or(usize::MAX);
                    let register = want.register(names, key, group, &mut self.registers);
                    kind = element(field_type(schema, at, *field));
                    want = want.fields.entry(*field).or_default().pick(Which::Register(register), None);
                }
            }
            at = match kind {
                Some(Type::Struct(index)) => Some(*index),
                _ => None,
            };
        }
        mark(want);
    }
}

impl Want {
    fn pick(&mut self, which: Which, group: Option<usize>) -> &mut Want {
        let place = self.picks.iter().position(|pick| pick.which == which).unwrap_or_else(|| {
            self.picks.push(Pick { which, want: Self::default(), group: None });
            self.picks.len() - 1
        });
        let pick = &mut self.picks[place];
        pick.group = pick.group.or(group);
        &mut pick.want
    }

    fn register(&mut self, field: usize, key: &str, group: Option<usize>, registers: &mut usize) -> usize {
        let names = self.names.get_or_insert_with(|| Names { field, wanted: Vec::new() });
        if let Some((_, register, known)) = names.wanted.iter_mut().find(|(known_key, ..)| known_key == key) {
            if let Some(group) = group.filter(|group| !known.contains(group)) {
                known.push(group);
            }
            return *register;
        }
        let register = *registers;
        *registers += 1;
        names.wanted.push((key.to_owned(), register, group.into_iter().collect()));
        register
    }
}

fn element(kind: Option<&Type>) -> Option<&Type> {
    match kind {
        Some(Type::Array { element, .. }) => Some(element),
        _ => None,
    }
}

fn field_type(schema: &Schema, at: Option<usize>, field: usize) -> Option<&Type> {
    Some(&schema.structs.get(at?)?.fields.get(field)?.kind)
}

/// The array of names of a struct.
pub(super) fn names_field(struct_type: &StructType) -> Option<usize> {
    let is_names = |kind: &Type| match kind {
        Type::Array { element, length: Length::Sequence(_) } => **element == Type::Text { wide: false },
        _ => false,
    };
    let find =
        |wanted: &&str| struct_type.fields.iter().position(|field| *field.name == **wanted && is_names(&field.kind));
    NAME_ARRAYS.iter().find_map(find)
}

/// The text that names a struct as an element of an array.
pub(super) fn key_field(struct_type: &StructType) -> Option<usize> {
    let find = |wanted: &&str| {
        struct_type.fields.iter().position(|field| {
            *field.name == **wanted
                && matches!(field.kind, Type::Text { wide: false } | Type::PlainText { .. })
                && !field.optional
        })
    };
    KEY_FIELDS.iter().find_map(find)
}

/// Follows a path through the types.
fn path(schema: &Schema, path: &FieldPath) -> Result<Resolved, SchemaError> {
    let root = Type::Struct(schema.root);
    let mut kind = &root;
    let mut moves = Vec::with_capacity(path.steps.len());
    let mut key = (0, 0);
    // The struct that the last step chose a field of.
    let mut owner: Option<&StructType> = None;
    for (place, step) in path.steps.iter().enumerate() {
        let missing = |nearest| SchemaError::NoField { path: path.to_string(), nearest };
        let before = || FieldPath { steps: path.steps.get(..place).unwrap_or_default().to_vec() };
        match (step, kind) {
            (Step::Field(name), Type::Struct(index)) => {
                let struct_type = schema.structs.get(*index).ok_or_else(|| missing(None))?;
                let field_place = struct_type.fields.iter().position(|field| field.name == *name);
                let field_place = field_place.ok_or_else(|| {
                    missing(nearest_one(name, struct_type.fields.iter().map(|field| &*field.name)).map(|name| {
                        let mut near = before();
                        near.steps.push(Step::Field(name.into()));
                        near.to_string()
                    }))
                })?;
                moves.push(Move::Field(field_place));
                owner = Some(struct_type);
                kind = &struct_type.fields[field_place].kind;
                continue;
            }
            (Step::Index(index), Type::Array { length: Length::Fixed(count), .. }) if index >= count => {
                let last = count.checked_sub(1).map(|last| {
                    let mut near = before();
                    near.steps.push(Step::Index(last));
                    near.to_string()
                });
                return Err(missing(last));
            }
            (Step::Index(index), Type::Array { element, .. }) => {
                moves.push(Move::Index(*index));
                kind = element;
            }
            (Step::Key(name), Type::Array { element, length }) => {
                let is_keyed =
                    matches!(**element, Type::Struct(index) if schema.structs.get(index).and_then(key_field).is_some());
                let names = owner.and_then(names_field);
                match moves.last() {
                    _ if is_keyed => moves.push(Move::Key(name.clone())),
                    Some(&Move::Field(field))
                        if names.is_some_and(|names| names != field) && *length != Length::Fixed(0) =>
                    {
                        moves.pop();
                        moves.push(Move::Beside(field, name.clone()));
                    }
                    _ => {
                        let mut near = before();
                        near.steps.push(Step::Index(0));
                        return Err(missing(Some(near.to_string())));
                    }
                }
                key = (moves.len(), place + 1);
                kind = element;
            }
            _ => return Err(missing((place > 0).then(|| before().to_string()))),
        }
        owner = None;
    }
    let kind = match kind {
        Type::Scalar(Scalar::LongDouble) => "a number of 16 bytes, which cannot be read".to_owned(),
        Type::Scalar(_) | Type::Text { .. } | Type::PlainText { .. } => return Ok(Resolved { moves, key }),
        Type::Padding(_) => "padding".to_owned(),
        Type::Struct(index) => {
            format!("a struct `{}`", schema.structs.get(*index).map_or("", |struct_type| &struct_type.name))
        }
        Type::Array { .. } => "an array".to_owned(),
    };
    Err(SchemaError::NotAValue { path: path.to_string(), kind })
}

/// Names of the seconds in a time.
const SECONDS: [&str; 3] = ["sec", "secs", "seconds"];
/// Names of the nanoseconds in a time.
const NANOSECONDS: [&str; 4] = ["nanosec", "nsec", "nsecs", "nanos"];

/// The seconds and nanoseconds of the innermost struct on the way that carries a stamp.
fn stamp(schema: &Schema, moves: &[Move]) -> Option<(Vec<Move>, Vec<Move>)> {
    // The structs on the way, each with how many moves lead to it.
    let mut structs = vec![(0, schema.root)];
    let root = Type::Struct(schema.root);
    let mut kind = Some(&root);
    for (place, step) in moves.iter().enumerate() {
        let at = match kind {
            Some(Type::Struct(index)) => Some(*index),
            _ => None,
        };
        kind = match step {
            Move::Field(field) => field_type(schema, at, *field),
            Move::Beside(field, _) => element(field_type(schema, at, *field)),
            Move::Index(_) | Move::Key(_) => element(kind),
        };
        if let Some(Type::Struct(index)) = kind {
            structs.push((place + 1, *index));
        }
    }
    structs.iter().rev().find_map(|&(length, index)| {
        let (way, seconds, nanoseconds) = stamp_of(schema, index)?;
        let before: Vec<Move> = moves.get(..length)?.iter().cloned().chain(way.into_iter().map(Move::Field)).collect();
        let with = |last| before.iter().cloned().chain([Move::Field(last)]).collect();
        Some((with(seconds), with(nanoseconds)))
    })
}

/// The way to a struct's stamp, and in it the fields of seconds and nanoseconds.
fn stamp_of(schema: &Schema, index: usize) -> Option<(Vec<usize>, usize, usize)> {
    let field = |index: usize, name: &str| {
        let struct_type = schema.structs.get(index)?;
        let place = struct_type.fields.iter().position(|field| *field.name == *name && !field.optional)?;
        Some((place, &struct_type.fields.get(place)?.kind))
    };
    let number = |index: usize, names: &[&str]| {
        names.iter().find_map(|name| match field(index, name)? {
            (place, Type::Scalar(Scalar::I32 | Scalar::U32)) => Some(place),
            _ => None,
        })
    };
    let time = |index: usize| Some((number(index, &SECONDS)?, number(index, &NANOSECONDS)?));
    let inside = |index: usize, name: &str| match field(index, name)? {
        (place, Type::Struct(inner)) => Some((place, *inner)),
        _ => None,
    };
    if let Some((header, inner)) = inside(index, "header")
        && let Some((stamp, inner)) = inside(inner, "stamp")
        && let Some((seconds, nanoseconds)) = time(inner)
    {
        return Some((vec![header, stamp], seconds, nanoseconds));
    }
    ["stamp", "timestamp"].iter().find_map(|name| {
        let (place, inner) = inside(index, name)?;
        let (seconds, nanoseconds) = time(inner)?;
        Some((vec![place], seconds, nanoseconds))
    })
}

//! From definitions that name each other to a [`Schema`] whose types are joined by index.

use std::{
    collections::{HashMap, HashSet},
    sync::Arc,
};

use crate::{Extensibility, Field, Length, Schema, StructType, Type};

/// Structs inside structs beyond this depth are no robot's message. Every recursion over a schema relies on this bound.
pub(super) const MAX_DEPTH: usize = 32;

/// A struct as its text defines it.
#[derive(Debug, Clone, Default)]
pub(super) struct Definition {
    pub(super) name: String,
    pub(super) fields: Vec<Member>,
    pub(super) extensibility: Option<Extensibility>,
}

/// A field of a [`Definition`].
#[derive(Debug, Clone)]
pub(super) struct Member {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) optional: bool,
}

/// A type that may name a definition.
#[derive(Debug, Clone)]
pub(super) enum Kind {
    /// A type without a struct in it.
    Known(Type),
    /// A definition, by its place in the list.
    Struct(usize),
    /// A definition that the text lacks, by the name that is used for it.
    Missing(String),
    Array(Box<Kind>, Length),
}

/// Joins the definitions that `root` uses.
///
/// Fields that never have bytes (empty ROS 1 messages, arrays of length zero) are left out: so every field costs a message some bytes,
/// and what is done for a message is bounded by its length, however its schema is made.
///
/// # Errors
/// A definition that is missing, contains itself or has two fields of one name, or structs nested deeper than [`MAX_DEPTH`]; the text names
/// it.
pub(super) fn link(definitions: &[Definition], root: usize) -> Result<Schema, String> {
    let mut linker =
        Linker { definitions, done: HashMap::new(), open: Vec::new(), structs: Vec::new(), empty: Vec::new() };
    let (root, _) = linker.structure(root)?;
    Ok(Schema { structs: linker.structs, root })
}

struct Linker<'a> {
    definitions: &'a [Definition],
    /// From places among the definitions to places in `structs`, with the depth of structs below.
    done: HashMap<usize, (usize, usize)>,
    /// Definitions that are being joined, from the outside in.
    open: Vec<usize>,
    structs: Vec<StructType>,
    /// For each of `structs`: true if it never has bytes.
    empty: Vec<bool>,
}

impl Linker<'_> {
    /// The place of a struct in the schema, and how many structs are nested in it at the deepest, itself included.
    fn structure(&mut self, place: usize) -> Result<(usize, usize), String> {
        if let Some(&done) = self.done.get(&place) {
            return Ok(done);
        }
        let definition = self.definitions.get(place).ok_or("a type is not defined")?;
        if self.open.contains(&place) {
            return Err(format!("`{}` contains itself", definition.name));
        }
        if self.open.len() >= MAX_DEPTH {
            return Err(format!("`{}` lies more than {MAX_DEPTH} structs deep", definition.name));
        }
        self.open.push(place);
        let mut fields = Vec::with_capacity(definition.fields.len());
        let mut names = HashSet::with_capacity(definition.fields.len());
        let mut depth = 1;
        for member in &definition.fields {
            if !names.insert(member.name.as_str()) {
                return Err(format!("`{}` has two fields `{}`", definition.name, member.name));
            }
            let (kind, below) = self.kind(&member.kind, definition, member)?;
            depth = depth.max(below + 1);
            if !self.never_has_bytes(&kind) || member.optional {
                fields.push(Field { name: Arc::from(member.name.as_str()), kind, optional: member.optional });
            }
        }
        self.open.pop();
        if self.open.len() + depth > MAX_DEPTH {
            return Err(format!("structs in `{}` lie more than {MAX_DEPTH} deep", definition.name));
        }
        let index = self.structs.len();
        self.empty.push(fields.is_empty());
        self.structs.push(StructType {
            name: definition.name.clone(),
            fields,
            extensibility: definition.extensibility,
        });
        self.done.insert(place, (index, depth));
        Ok((index, depth))
    }

    fn kind(&mut self, kind: &Kind, of: &Definition, member: &Member) -> Result<(Type, usize), String> {
        match kind {
            Kind::Known(kind) => Ok((kind.clone(), 0)),
            Kind::Struct(place) => self.structure(*place).map(|(index, depth)| (Type::Struct(index), depth)),
            Kind::Missing(name) => Err(format!(
                "the definition of `{name}` is missing, which the field `{}` of `{}` has",
                member.name, of.name
            )),
            Kind::Array(element, length) => {
                let (element, depth) = self.kind(element, of, member)?;
                Ok((Type::Array { element: Box::new(element), length: *length }, depth))
            }
        }
    }

    fn never_has_bytes(&self, kind: &Type) -> bool {
        match kind {
            Type::Scalar(_) | Type::Text { .. } => false,
            Type::PlainText { size } => *size == Some(0),
            Type::Padding(size) => *size == 0,
            Type::Struct(index) => self.empty.get(*index).copied().unwrap_or(false),
            Type::Array { length: Length::Fixed(0), .. } => true,
            Type::Array { element, length: Length::Fixed(_) } => self.never_has_bytes(element),
            Type::Array { length: Length::Sequence(_), .. } => false,
        }
    }
}

//! The message types of a `FileDescriptorSet`, as far as one message uses them.
//!
//! Names are resolved here and not by a descriptor pool, which checks much that does not matter for reading, and trusts what it is given.

use std::{
    collections::{HashMap, VecDeque},
    sync::Arc,
};

use prost_reflect::{
    DescriptorPool,
    prost_types::{
        DescriptorProto, EnumDescriptorProto, FieldDescriptorProto, FileDescriptorSet,
        field_descriptor_proto::{Label, Type},
    },
};

use super::wire::WireType;
use crate::Value;

/// A message type.
#[derive(Debug)]
pub(super) struct MessageType {
    /// Its full name, e.g. `google.protobuf.Timestamp`.
    pub(super) name: String,
    /// Its fields as they stand in its definition, without groups, which are skipped.
    pub(super) fields: Vec<FieldType>,
}

impl MessageType {
    /// The field of a name.
    pub(super) fn field(&self, name: &str) -> Option<&FieldType> {
        self.fields.iter().find(|field| *field.name == *name)
    }
}

/// A field of a message type.
#[derive(Debug)]
pub(super) struct FieldType {
    pub(super) name: Arc<str>,
    pub(super) number: u32,
    /// Form of one value; a message is given by its place among the types.
    pub(super) form: Form,
    /// It is repeated or a map.
    pub(super) is_list: bool,
    /// Setting it clears the other members of the same number.
    pub(super) oneof: Option<usize>,
    /// Value of the field in a message without it.
    pub(super) absent: Value,
}

/// Form of one value on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Bool,
    /// 32 bits, as the low bits of a varint; also enums.
    Int32,
    Int64,
    Uint32,
    Uint64,
    Sint32,
    Sint64,
    Fixed32,
    Fixed64,
    Sfixed32,
    Sfixed64,
    Float,
    Double,
    Text,
    Bytes,
    Message(usize),
    /// An unwanted member of a oneof: it only clears the others.
    Unwanted,
}

impl Form {
    /// Wire type of a single value.
    pub(super) fn wire(self) -> WireType {
        match self {
            Self::Bool | Self::Int32 | Self::Int64 | Self::Uint32 | Self::Uint64 | Self::Sint32 | Self::Sint64 => {
                WireType::Varint
            }
            Self::Fixed32 | Self::Sfixed32 | Self::Float => WireType::Fixed32,
            Self::Fixed64 | Self::Sfixed64 | Self::Double => WireType::Fixed64,
            Self::Text | Self::Bytes | Self::Message(_) | Self::Unwanted => WireType::Length,
        }
    }

    /// Numbers of repeated fields may be packed.
    pub(super) fn is_number(self) -> bool {
        self.wire() != WireType::Length
    }

    /// Value of an absent field without presence, whose absence equals zero.
    fn zero(self) -> Value {
        match self {
            Self::Bool => Value::Bool(false),
            Self::Int32 | Self::Int64 | Self::Sint32 | Self::Sint64 | Self::Sfixed32 | Self::Sfixed64 => Value::Int(0),
            Self::Uint32 | Self::Uint64 | Self::Fixed32 | Self::Fixed64 => Value::Uint(0),
            Self::Float | Self::Double => Value::Float(0.0),
            Self::Text => Value::Text(String::new()),
            Self::Bytes => Value::Array(Vec::new()),
            Self::Message(_) | Self::Unwanted => Value::Null,
        }
    }
}

/// The types that a message uses; its own is the first.
///
/// # Errors
/// A message that names the missing or unsupported part.
pub(super) fn resolve(set: &FileDescriptorSet, root: &str) -> Result<Vec<MessageType>, String> {
    let well_known = DescriptorPool::global();
    let well_known: Vec<_> = well_known.files().filter(|file| file.name().starts_with("google/protobuf/")).collect();
    let mut definitions = Definitions::default();
    // Files of protobuf itself, such as that of `Timestamp`, may be missing from the set; where they are in it, they count.
    for file in well_known.iter().map(|file| file.file_descriptor_proto()).chain(&set.file) {
        definitions.add(file.package(), file.syntax(), &file.message_type, &file.enum_type);
    }
    if !definitions.messages.contains_key(root) {
        let mut known = set
            .file
            .iter()
            .flat_map(|file| file.message_type.iter().map(|message_type| join(file.package(), message_type.name())));
        return Err(match known.next() {
            Some(first) => format!("its FileDescriptorSet does not define it; the first type there is `{first}`"),
            None => "its FileDescriptorSet defines no messages".to_owned(),
        });
    }
    let mut resolver = Resolver {
        definitions,
        places: HashMap::from([(root.to_owned(), 0)]),
        todo: VecDeque::from([root.to_owned()]),
    };
    let mut types = Vec::new();
    while let Some(name) = resolver.todo.pop_front() {
        types.push(resolver.message(name)?);
    }
    Ok(types)
}

fn join(scope: &str, name: &str) -> String {
    if scope.is_empty() { name.to_owned() } else { format!("{scope}.{name}") }
}

/// All types of a set by their full names.
#[derive(Default)]
struct Definitions<'a> {
    /// Messages and the syntax of their files.
    messages: HashMap<String, (&'a DescriptorProto, &'a str)>,
    enums: HashMap<String, &'a EnumDescriptorProto>,
}

impl<'a> Definitions<'a> {
    fn add(
        &mut self,
        package: &str,
        syntax: &'a str,
        messages: &'a [DescriptorProto],
        enums: &'a [EnumDescriptorProto],
    ) {
        let mut todo = vec![(package.to_owned(), messages, enums)];
        while let Some((scope, messages, enums)) = todo.pop() {
            for enum_type in enums {
                self.enums.insert(join(&scope, enum_type.name()), enum_type);
            }
            for message_type in messages {
                let name = join(&scope, message_type.name());
                todo.push((name.clone(), &message_type.nested_type, &message_type.enum_type));
                self.messages.insert(name, (message_type, syntax));
            }
        }
    }

    /// The full name of a type that is used inside a message: a name with a dot before it is full, another is looked for from the inside out.
    fn find(&self, scope: &str, name: &str) -> Option<String> {
        let known = |name: &str| self.messages.contains_key(name) || self.enums.contains_key(name);
        if let Some(full) = name.strip_prefix('.') {
            return known(full).then(|| full.to_owned());
        }
        let mut scope = scope;
        loop {
            let candidate = join(scope, name);
            if known(&candidate) {
                return Some(candidate);
            }
            if scope.is_empty() {
                return None;
            }
            scope = scope.rsplit_once('.').map_or("", |(outer, _)| outer);
        }
    }
}

/// Types in the order in which they were first used.
struct Resolver<'a> {
    definitions: Definitions<'a>,
    places: HashMap<String, usize>,
    todo: VecDeque<String>,
}

impl Resolver<'_> {
    fn message(&mut self, name: String) -> Result<MessageType, String> {
        let Some(&(definition, syntax)) = self.definitions.messages.get(&name) else {
            return Err(format!("its FileDescriptorSet does not define `{name}`"));
        };
        if !matches!(syntax, "" | "proto2" | "proto3") {
            return Err(format!("`{name}` is defined in the syntax `{syntax}`; proto2 and proto3 can be read"));
        }
        let is_entry = definition.options.as_ref().is_some_and(|options| options.map_entry());
        let mut fields = Vec::with_capacity(definition.field.len());
        for field in &definition.field {
            // A number below 1 cannot occur in a message.
            let Some(number) = u32::try_from(field.number()).ok().filter(|number| *number > 0) else { continue };
            let Some((form, first)) = self.form(&name, field)? else { continue };
            let is_list = field.label() == Label::Repeated;
            // A lone member of a oneof that the compiler made tells presence, and clears nothing.
            let in_oneof = field.oneof_index.and_then(|oneof| usize::try_from(oneof).ok());
            let has_presence = !is_entry && (syntax != "proto3" || in_oneof.is_some() || field.proto3_optional());
            fields.push(FieldType {
                name: Arc::from(field.name()),
                number,
                form,
                is_list,
                oneof: in_oneof.filter(|_| !field.proto3_optional() && !is_list),
                absent: match (is_list, &field.default_value) {
                    (true, _) => Value::Array(Vec::new()),
                    (false, Some(text)) => self.default(field, form, text),
                    (false, None) if has_presence => Value::Null,
                    (false, None) => first.unwrap_or_else(|| form.zero()),
                },
            });
        }
        Ok(MessageType { name, fields })
    }

    /// Form of a field (`None` for groups); of an enum also the first value, which is its default.
    fn form(&mut self, message: &str, field: &FieldDescriptorProto) -> Result<Option<(Form, Option<Value>)>, String> {
        let kind = field.r#type.and_then(|kind| Type::try_from(kind).ok());
        let form = match kind {
            Some(Type::Group) => return Ok(None),
            Some(Type::Double) => Form::Double,
            Some(Type::Float) => Form::Float,
            Some(Type::Int32) => Form::Int32,
            Some(Type::Int64) => Form::Int64,
            Some(Type::Uint32) => Form::Uint32,
            Some(Type::Uint64) => Form::Uint64,
            Some(Type::Sint32) => Form::Sint32,
            Some(Type::Sint64) => Form::Sint64,
            Some(Type::Fixed32) => Form::Fixed32,
            Some(Type::Fixed64) => Form::Fixed64,
            Some(Type::Sfixed32) => Form::Sfixed32,
            Some(Type::Sfixed64) => Form::Sfixed64,
            Some(Type::Bool) => Form::Bool,
            Some(Type::String) => Form::Text,
            Some(Type::Bytes) => Form::Bytes,
            Some(Type::Message | Type::Enum) | None => return self.named(message, field).map(Some),
        };
        Ok(Some((form, None)))
    }

    fn named(&mut self, message: &str, field: &FieldDescriptorProto) -> Result<(Form, Option<Value>), String> {
        let wanted = field.type_name();
        let definition_name = self.definitions.find(message, wanted);
        let full = definition_name.ok_or_else(|| {
            format!("its FileDescriptorSet does not define `{wanted}`, which `{message}.{}` uses", field.name())
        })?;
        if let Some(enum_type) = self.definitions.enums.get(&full) {
            return Ok((Form::Int32, enum_type.value.first().map(|first| Value::Int(first.number().into()))));
        }
        let next = self.places.len();
        let place = *self.places.entry(full.clone()).or_insert(next);
        if place == next {
            self.todo.push_back(full);
        }
        Ok((Form::Message(place), None))
    }

    /// The default that the definition gives, which is a text whatever the type.
    fn default(&self, field: &FieldDescriptorProto, form: Form, text: &str) -> Value {
        let value = match form.zero() {
            Value::Bool(_) => text.parse().ok().map(Value::Bool),
            Value::Int(_) => {
                let named = || {
                    let full = self.definitions.find("", field.type_name())?;
                    self.definitions.enums.get(&full)?.value.iter().find(|value| value.name() == text)
                };
                text.parse().ok().or_else(|| named().map(|value| value.number().into())).map(Value::Int)
            }
            Value::Uint(_) => text.parse().ok().map(Value::Uint),
            Value::Float(_) if form == Form::Float => text.parse::<f32>().ok().map(|value| Value::Float(value.into())),
            Value::Float(_) => text.parse().ok().map(Value::Float),
            Value::Text(_) => Some(Value::Text(text.to_owned())),
            _ => None,
        };
        value.unwrap_or(Value::Null)
    }
}

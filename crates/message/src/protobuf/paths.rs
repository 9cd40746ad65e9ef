//! Check that a message type has the wanted fields.

use fleetfoot_data::nearest_one;

use super::types::{FieldType, Form, MessageType};
use crate::{
    FieldPath, SchemaError, Step,
    keys::{KEY_FIELDS, NAME_ARRAYS},
};

/// Steps of a path: as deep as messages are decoded, with an element between each two.
const MAX_STEPS: usize = 128;

/// Target of a part of a path.
#[derive(Clone, Copy)]
enum Place<'a> {
    Message(&'a MessageType),
    /// A repeated field, and the message that has it.
    List(&'a FieldType, &'a MessageType),
    Bytes,
    Value,
}

/// Checks that a path leads from a message of the first of some types to a number, truth value or text.
pub(super) fn check(types: &[MessageType], path: &FieldPath) -> Result<(), SchemaError> {
    let missing = |nearest| SchemaError::NoField { path: path.to_string(), nearest };
    let Some(root) = types.first().filter(|_| path.steps.len() <= MAX_STEPS) else { return Err(missing(None)) };
    let mut place = Place::Message(root);
    for (done, step) in path.steps.iter().enumerate() {
        let until = |last: Option<Step>| {
            let steps: Vec<Step> = path.steps.iter().take(done).cloned().chain(last).collect();
            (!steps.is_empty()).then(|| FieldPath { steps }.to_string())
        };
        place = match (place, step) {
            (Place::Message(message_type), Step::Field(name)) => match message_type.field(name) {
                Some(field) if field.is_list => Place::List(field, message_type),
                Some(field) => single(types, field),
                None => {
                    let names = message_type.fields.iter().map(|field| &*field.name);
                    return Err(missing(
                        nearest_one(name, names).and_then(|name| until(Some(Step::Field(name.into())))),
                    ));
                }
            },
            (Place::List(field, _), Step::Index(_)) => single(types, field),
            (Place::List(field, message_type), Step::Key(_)) if is_keyed(types, field, message_type) => {
                single(types, field)
            }
            (Place::List(..), Step::Key(_)) => return Err(missing(until(Some(Step::Index(0))))),
            (Place::Bytes, Step::Index(_)) => Place::Value,
            _ => return Err(missing(until(None))),
        };
    }
    let kind = match place {
        Place::Value => return Ok(()),
        Place::Message(message_type) => format!("a message `{}`", message_type.name),
        Place::List(..) => "an array".to_owned(),
        Place::Bytes => "an array of bytes".to_owned(),
    };
    Err(SchemaError::NotAValue { path: path.to_string(), kind })
}

/// Place of a field, or of one of its elements.
fn single<'a>(types: &'a [MessageType], field: &FieldType) -> Place<'a> {
    match field.form {
        Form::Message(place) => types.get(place).map_or(Place::Value, Place::Message),
        Form::Bytes => Place::Bytes,
        _ => Place::Value,
    }
}

/// Returns true if the elements of a repeated field have names: texts inside them, or an array of texts beside.
fn is_keyed(types: &[MessageType], field: &FieldType, around: &MessageType) -> bool {
    let is_key = |key: &FieldType| key.form == Form::Text && !key.is_list;
    let has_key =
        |message_type: &MessageType| KEY_FIELDS.iter().filter_map(|name| message_type.field(name)).any(is_key);
    if matches!(single(types, field), Place::Message(message_type) if has_key(message_type)) {
        return true;
    }
    let mut names = NAME_ARRAYS
        .iter()
        .filter_map(|name| around.field(name))
        .filter(|names| names.form == Form::Text && names.is_list);
    names.next().is_some_and(|names| names.name != field.name)
}

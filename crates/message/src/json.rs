//! JSON messages, with or without a JSON Schema.
//!
//! Fields are found by name in every message: a schema in JSON rarely says all, and never where a field stands. What it does say is which
//! numbers are real, which a writer that leaves out `.0` hides.

mod decode;
mod shape;

#[cfg(test)]
mod tests;

use crate::{
    Codec, DecodeError, Extract, FieldPath, Group, Row, SchemaError, Value,
    lookup::{Lookup, Wanted},
};
use shape::Shapes;
use std::sync::Arc;

/// Makes the decoder of JSON messages.
///
/// # Errors
/// A schema that is no JSON.
pub(crate) fn codec(name: &str, schema: Option<&[u8]>) -> Result<Box<dyn Codec>, SchemaError> {
    let is_blank = |text: &[u8]| text.iter().all(u8::is_ascii_whitespace);
    let shapes = match schema.filter(|text| !is_blank(text)) {
        None => Shapes::default(),
        Some(text) => Shapes::new(text).map_err(|error| SchemaError::Malformed {
            encoding: "jsonschema".to_owned(),
            name: name.to_owned(),
            problem: error.to_string(),
        })?,
    };
    Ok(Box::new(Json { shapes: Arc::new(shapes) }))
}

/// The decoder of one channel's messages.
struct Json {
    shapes: Arc<Shapes>,
}

impl Codec for Json {
    fn value(&self, message: &[u8]) -> Result<Value, DecodeError> {
        decode::decode(message, &self.shapes, None)
    }

    fn compile(&self, fields: &[FieldPath]) -> Result<Box<dyn Extract>, SchemaError> {
        Ok(Box::new(Fields { shapes: self.shapes.clone(), wanted: Wanted::new(fields), lookup: Lookup::new(fields) }))
    }
}

/// Some fields of one channel's messages. What is not wanted is read over.
struct Fields {
    shapes: Arc<Shapes>,
    wanted: Wanted,
    lookup: Lookup,
}

impl Extract for Fields {
    fn groups(&self) -> &[Group] {
        self.lookup.groups()
    }

    fn extract(&self, message: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        self.lookup.extract(&decode::decode(message, &self.shapes, Some(&self.wanted))?, row);
        Ok(())
    }
}

//! Protobuf messages with a `FileDescriptorSet` as their schema.

mod decode;
mod paths;
mod plan;
mod types;
mod wire;

#[cfg(test)]
mod tests;

use prost_reflect::{prost::Message, prost_types::FileDescriptorSet};

use crate::{
    Codec, DecodeError, Extract, FieldPath, Group, Row, SchemaError, Value,
    lookup::{Lookup, Wanted},
};
use plan::Plan;
use types::MessageType;

/// Makes the decoder of a message type from the serialised `FileDescriptorSet` that defines it.
///
/// # Errors
/// A set that cannot be decoded, is incomplete, or does not have the type.
pub(crate) fn codec(name: &str, data: &[u8]) -> Result<Box<dyn Codec>, SchemaError> {
    let malformed =
        |problem: String| SchemaError::Malformed { encoding: "protobuf".to_owned(), name: name.to_owned(), problem };
    let set = FileDescriptorSet::decode(data).map_err(|error| malformed(error.to_string()))?;
    let types = types::resolve(&set, name.strip_prefix('.').unwrap_or(name)).map_err(malformed)?;
    Ok(Box::new(Protobuf { whole: Plan::whole(&types), types }))
}

/// The decoder of one message type.
struct Protobuf {
    types: Vec<MessageType>,
    whole: Plan,
}

impl Codec for Protobuf {
    fn value(&self, message: &[u8]) -> Result<Value, DecodeError> {
        decode::decode(&self.whole, message)
    }

    fn compile(&self, fields: &[FieldPath]) -> Result<Box<dyn Extract>, SchemaError> {
        for field in fields {
            paths::check(&self.types, field)?;
        }
        let plan = Plan::wanted(&self.types, &Wanted::new(fields));
        Ok(Box::new(Fields { plan, lookup: Lookup::new(fields) }))
    }
}

/// Some fields of one message type. What is not wanted is skipped on the wire.
struct Fields {
    plan: Plan,
    lookup: Lookup,
}

impl Extract for Fields {
    fn groups(&self) -> &[Group] {
        self.lookup.groups()
    }

    fn extract(&self, message: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        self.lookup.extract(&decode::decode(&self.plan, message)?, row);
        Ok(())
    }
}

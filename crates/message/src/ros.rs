//! ROS 1 and ROS 2 messages: definitions in `.msg` and IDL, bytes in the layout of ROS 1 and in CDR. ULog's messages
//! are packed as those of ROS 1.

mod block;
mod compile;
mod idl;
mod idl_tokens;
mod link;
mod msg;
mod program;
mod reference;
mod run;
pub(crate) mod ulog;
mod want;
mod wire;

#[cfg(test)]
mod tests;

use std::sync::{Arc, OnceLock};

use self::{
    program::Program,
    want::Wanted,
    wire::{ENCAPSULATION, Sizes, Wire},
};
use crate::{Codec, DecodeError, Extract, FieldPath, Group, MISSING, Row, Schema, SchemaError, Value};

/// The decoder for a channel of ROS messages: `cdr` with `ros2msg` or `ros2idl`, `ros1` with `ros1msg`, and `ulog` with `ulog`.
///
/// # Errors
/// Other encodings, and schemas that cannot be understood or that lack a definition.
pub(crate) fn codec(
    message_encoding: &str,
    schema_name: &str,
    schema_encoding: &str,
    schema_data: &[u8],
) -> Result<Box<dyn Codec>, SchemaError> {
    let unknown =
        || SchemaError::UnknownEncoding { message: message_encoding.to_owned(), schema: schema_encoding.to_owned() };
    let text = String::from_utf8_lossy(schema_data);
    let (schema, packed) = match (message_encoding, schema_encoding) {
        ("cdr", "ros2msg") => (msg::parse(schema_name, &text, msg::Ros::Two), false),
        ("cdr", "ros2idl") => (idl::parse(schema_name, &text), false),
        ("ros1", "ros1msg") => (msg::parse(schema_name, &text, msg::Ros::One), true),
        ("ulog", "ulog") => (ulog::parse(schema_name, &text), true),
        _ => return Err(unknown()),
    };
    let schema = schema.map_err(|problem| SchemaError::Malformed {
        encoding: schema_encoding.to_owned(),
        name: schema_name.to_owned(),
        problem,
    })?;
    Ok(Box::new(RosCodec::new(schema, packed)))
}

/// Schema and sizes that all decoders of a channel share.
#[derive(Debug)]
struct Layouts {
    schema: Schema,
    /// Laid out as in ROS 1: packed, little-endian, without a header.
    packed: bool,
    /// By wire.
    sizes: [Sizes; Wire::ALL.len()],
}

impl Layouts {
    /// The layout of a message, whether it is big-endian, and the bytes before its body.
    fn of(&self, message: &[u8]) -> Result<(Wire, bool, usize), DecodeError> {
        if self.packed {
            return Ok((Wire::Ros1, false, 0));
        }
        wire::encapsulation(message).map(|(wire, big)| (wire, big, ENCAPSULATION))
    }

    fn sizes(&self, wire: Wire) -> &Sizes {
        &self.sizes[wire as usize]
    }
}

#[derive(Debug)]
struct RosCodec(Arc<Layouts>);

impl RosCodec {
    fn new(schema: Schema, packed: bool) -> Self {
        let sizes = Wire::ALL.map(|wire| Sizes::new(&schema, wire));
        Self(Arc::new(Layouts { schema, packed, sizes }))
    }
}

impl Codec for RosCodec {
    fn value(&self, message: &[u8]) -> Result<Value, DecodeError> {
        let Self(layouts) = self;
        let (wire, big, header) = layouts.of(message)?;
        let decode = if big { reference::value::<true> } else { reference::value::<false> };
        decode(&layouts.schema, layouts.sizes(wire), wire, message, header)
    }

    fn compile(&self, fields: &[FieldPath]) -> Result<Box<dyn Extract>, SchemaError> {
        let wanted = want::resolve(&self.0.schema, fields)?;
        // Fields outside of named elements are in every message.
        let present = wanted.groups.iter().map(|group| group.key.is_none()).collect();
        let extract = RosExtract { layouts: Arc::clone(&self.0), wanted, present, programs: Default::default() };
        extract.program(if self.0.packed { Wire::Ros1 } else { Wire::Xcdr1 });
        Ok(Box::new(extract))
    }
}

#[derive(Debug)]
struct RosExtract {
    layouts: Arc<Layouts>,
    wanted: Wanted,
    /// The presence that a message starts with, by group.
    present: Box<[bool]>,
    /// By wire, made when the first message of it comes.
    programs: [OnceLock<Program>; Wire::ALL.len()],
}

impl RosExtract {
    fn program(&self, wire: Wire) -> &Program {
        let Layouts { schema, .. } = &*self.layouts;
        self.programs[wire as usize]
            .get_or_init(|| compile::compile(schema, &self.wanted, wire, self.layouts.sizes(wire)))
    }
}

impl Extract for RosExtract {
    fn groups(&self) -> &[Group] {
        &self.wanted.groups
    }

    fn extract(&self, message: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        let (wire, big, header) = self.layouts.of(message)?;
        refill(&mut row.values, self.wanted.slots, f64::NAN);
        refill(&mut row.is_text, self.wanted.slots, false);
        refill(&mut row.stamps, self.present.len(), MISSING);
        refill(&mut row.present, self.present.len(), false);
        row.present.copy_from_slice(&self.present);
        let program = self.program(wire);
        let run = if big { run::run::<true> } else { run::run::<false> };
        run(program, wire, self.wanted.registers, message, header, row)?;
        for (present, stamp) in row.present.iter().zip(&mut row.stamps) {
            if !present {
                *stamp = MISSING;
            }
        }
        Ok(())
    }
}

/// Makes all of a buffer one value.
fn refill<T: Copy>(buffer: &mut Vec<T>, length: usize, value: T) {
    if buffer.len() == length {
        buffer.fill(value);
    } else {
        buffer.clear();
        buffer.resize(length, value);
    }
}

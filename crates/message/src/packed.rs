//! Messages that are packed little-endian structs: the logs of ArduPilot (DataFlash) and of WPILib.
//!
//! All parts but the last have a fixed place, so that a wanted field is an offset. The last part may be as long as the rest of the message.

mod bytes;
pub(crate) mod dataflash;
mod layout;
#[cfg(test)]
mod tests;
pub(crate) mod wpilog;

use std::sync::Arc;

use crate::{
    Codec, DecodeError, Extract, FieldPath, Group, Row, SchemaError, Step, Value, lookup::Lookup, value::LONG_ARRAY,
};
use bytes::{rest_text, text, texts};
use layout::{Layout, Leaf, Shape, Target};

/// Elements of an array of structs that a whole message is decoded with.
const MAX_ELEMENTS: usize = 4096;

/// Makes the decoder of messages of a layout.
fn codec(layout: Layout) -> Box<dyn Codec> {
    Box::new(Packed { layout: Arc::new(layout) })
}

/// The decoder of one channel's messages.
#[derive(Debug, Clone)]
struct Packed {
    layout: Arc<Layout>,
}

impl Codec for Packed {
    fn value(&self, message: &[u8]) -> Result<Value, DecodeError> {
        if message.len() < self.layout.size {
            return Err(short(message, self.layout.size));
        }
        structure(&self.layout, message, 0)
    }

    fn compile(&self, fields: &[FieldPath]) -> Result<Box<dyn Extract>, SchemaError> {
        // Elements by their names need the whole message.
        if fields.iter().any(|path| path.steps.iter().any(|step| matches!(step, Step::Key(_)))) {
            return Ok(Box::new(Named { codec: self.clone(), lookup: Lookup::new(fields) }));
        }
        let targets = fields.iter().map(|path| self.layout.resolve(path)).collect::<Result<_, _>>()?;
        let groups = vec![Group { key: None, slots: (0..fields.len()).collect() }];
        Ok(Box::new(Fields { targets, groups }))
    }

    fn unit(&self, path: &FieldPath) -> Option<String> {
        self.layout.unit(path).map(str::to_owned)
    }
}

/// Fields at their places.
struct Fields {
    targets: Vec<Target>,
    groups: Vec<Group>,
}

impl Extract for Fields {
    fn groups(&self) -> &[Group] {
        if self.targets.is_empty() { &[] } else { &self.groups }
    }

    fn extract(&self, message: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        for (slot, target) in self.targets.iter().enumerate() {
            row.values[slot] = f64::NAN;
            row.is_text[slot] = false;
            match &target.leaf {
                Leaf::Number(number) => {
                    let bytes = message.get(target.at..).filter(|rest| rest.len() >= number.size());
                    match bytes.map(|rest| number.read(rest)) {
                        Some(value) => row.values[slot] = value.number().unwrap_or(f64::NAN),
                        None if target.optional => {}
                        None => return Err(short(message, target.at.saturating_add(number.size()))),
                    }
                }
                Leaf::Text(size) => match message.get(target.at..target.at.saturating_add(*size)) {
                    Some(bytes) => row.set_text(slot, &text(bytes)),
                    None if target.optional => {}
                    None => return Err(short(message, target.at.saturating_add(*size))),
                },
                Leaf::RestText => {
                    row.set_text(slot, &rest_text(message.get(target.at..).unwrap_or_default()));
                }
                Leaf::TextAt(place) => {
                    let rest = message.get(target.at..).unwrap_or_default();
                    if let Some(text_there) = texts(rest, target.at)?.get(*place) {
                        row.set_text(slot, text_there);
                    }
                }
            }
        }
        row.present.fill(true);
        row.stamps.fill(crate::MISSING);
        Ok(())
    }
}

/// Fields of which some are elements with a name.
struct Named {
    codec: Packed,
    lookup: Lookup,
}

impl Extract for Named {
    fn groups(&self) -> &[Group] {
        self.lookup.groups()
    }

    fn extract(&self, message: &[u8], row: &mut Row) -> Result<(), DecodeError> {
        self.lookup.extract(&self.codec.value(message)?, row);
        Ok(())
    }
}

fn short(message: &[u8], needed: usize) -> DecodeError {
    DecodeError::new(message.len(), format!("it ends there, and its layout needs {needed} bytes"))
}

/// A struct at a place of a message that is long enough for it.
fn structure(layout: &Layout, message: &[u8], at: usize) -> Result<Value, DecodeError> {
    let part = |part: &layout::Part| Ok((part.name.clone(), value(&part.shape, message, at + part.at)?));
    Ok(Value::Struct(layout.parts.iter().map(part).collect::<Result<_, _>>()?))
}

fn value(shape: &Shape, message: &[u8], at: usize) -> Result<Value, DecodeError> {
    let rest = message.get(at..).unwrap_or_default();
    if rest.len() < shape.size() {
        return Err(short(message, at.saturating_add(shape.size())));
    }
    match shape {
        Shape::Number(number) => Ok(number.read(rest)),
        Shape::Text(size) => Ok(Value::Text(text(rest.get(..*size).unwrap_or_default()))),
        Shape::RestText => Ok(Value::Text(rest_text(rest))),
        Shape::Texts => Ok(Value::Array(texts(rest, at)?.into_iter().map(Value::Text).collect())),
        Shape::Struct(layout) => structure(layout, message, at),
        Shape::Array(element, count) => array(element, *count, message, at),
        Shape::Rest(element) => {
            let size = element.size().max(1);
            if rest.len() % size != 0 {
                let problem = format!("{} bytes are no whole number of elements of {size} bytes", rest.len());
                return Err(DecodeError::new(at, problem));
            }
            array(element, rest.len() / size, message, at)
        }
    }
}

fn array(element: &Shape, count: usize, message: &[u8], at: usize) -> Result<Value, DecodeError> {
    if count > LONG_ARRAY && matches!(element, Shape::Number(_)) {
        return Ok(Value::Long(count));
    }
    // Of more, a tree of fields keeps none, and few people want each.
    let elements = (0..count.min(MAX_ELEMENTS)).map(|place| value(element, message, at + place * element.size()));
    Ok(Value::Array(elements.collect::<Result<_, _>>()?))
}

//! Decoding of messages by a plan.
//!
//! Parts of a message may come in any order and more than once. Of parts with one number the last counts, and the
//! elements of arrays add up. The parts of a message inside are read as if they stood behind one another. So the places
//! of inner messages are collected first, and read when the outer message has ended.

use std::collections::HashMap;

use super::{
    plan::{FieldPlan, Keep, Plan},
    types::Form,
    wire::{MAX_DEPTH, Reader, WireType},
};
use crate::{DecodeError, Value};

/// Values that a byte may stand for. Absent fields take no bytes, so that a few bytes of empty messages could fill the memory.
const VALUES_PER_BYTE: usize = 8;
/// Values that any message may have.
const VALUES_FREE: usize = 1 << 16;

/// Part of a field that was read so far.
#[derive(Debug, Clone)]
enum Slot {
    Absent,
    One(Value),
    Many { elements: Vec<Value>, count: usize },
    Parts(Vec<(usize, usize)>),
}

struct Decoder<'a> {
    plan: &'a Plan,
    message: &'a [u8],
    /// Values that the message may still have.
    room: usize,
}

/// Decodes a message.
pub(super) fn decode(plan: &Plan, message: &[u8]) -> Result<Value, DecodeError> {
    let room = message.len().saturating_mul(VALUES_PER_BYTE).saturating_add(VALUES_FREE);
    Decoder { plan, message, room }.message(0, &[(0, message.len())], 0)
}

impl Decoder<'_> {
    /// Decodes a message that stands in some places.
    fn message(&mut self, place: usize, parts: &[(usize, usize)], depth: usize) -> Result<Value, DecodeError> {
        let plan = &self.plan.messages[place];
        let start = parts.first().map_or(0, |part| part.0);
        if depth > MAX_DEPTH {
            return Err(DecodeError::new(start, format!("more than {MAX_DEPTH} messages are nested")));
        }
        self.charge(plan.fields.len() + 1, start)?;
        let mut slots = vec![Slot::Absent; plan.fields.len()];
        let mut chosen = HashMap::new();
        for &part in parts {
            let mut reader = Reader::new(self.message, part);
            let mut next = 0;
            while let Some((number, wire)) = reader.tag()? {
                let known_place = plan.place(number, next).filter(|&place| accepts(&plan.fields[place], wire));
                let Some(place) = known_place else {
                    reader.skip(number, wire)?;
                    continue;
                };
                next = place + 1;
                if let Some(oneof) = plan.fields[place].oneof {
                    // Of the members of a oneof only the last one counts.
                    if let Some(other) = chosen.insert(oneof, place).filter(|other| *other != place) {
                        slots[other] = Slot::Absent;
                    }
                }
                if plan.fields[place].form == Form::Unwanted {
                    reader.skip(number, wire)?;
                } else {
                    self.field(&plan.fields[place], &mut slots[place], wire, &mut reader, depth)?;
                }
            }
        }
        let mut fields = Vec::with_capacity(slots.len());
        for (field, slot) in plan.fields.iter().zip(slots) {
            let value = match (slot, field.form) {
                (Slot::Absent, _) => field.absent.clone(),
                (Slot::One(value), _) => value,
                (Slot::Many { elements, count }, _) => match field.list {
                    Some(keep) if keep.or_count && count > keep.elements => Value::Long(count),
                    _ => Value::Array(elements),
                },
                (Slot::Parts(parts), Form::Message(place)) => self.message(place, &parts, depth + 1)?,
                (Slot::Parts(_), _) => Value::Null,
            };
            fields.push((field.name.clone(), value));
        }
        Ok(Value::Struct(fields))
    }

    /// Reads one occurrence of a field.
    fn field(
        &mut self,
        field: &FieldPlan,
        slot: &mut Slot,
        wire: WireType,
        reader: &mut Reader<'_>,
        depth: usize,
    ) -> Result<(), DecodeError> {
        match (field.list, field.form) {
            (None, Form::Message(_)) => {
                let part = reader.span()?;
                match slot {
                    Slot::Parts(parts) => parts.push(part),
                    _ => *slot = Slot::Parts(vec![part]),
                }
            }
            (None, _) => *slot = Slot::One(self.value(field, reader)?),
            (Some(keep), form) => {
                if !matches!(slot, Slot::Many { .. }) {
                    *slot = Slot::Many { elements: Vec::new(), count: 0 };
                }
                let Slot::Many { elements, count } = slot else { return Ok(()) };
                if form.is_number() && wire == WireType::Length {
                    let part = reader.span()?;
                    return self.packed(field, keep, part, elements, count);
                }
                let kept = *count < keep.elements;
                match form {
                    _ if !kept => reader.skip(1, wire)?,
                    Form::Message(place) => {
                        let part = reader.span()?;
                        elements.push(self.message(place, &[part], depth + 1)?);
                    }
                    _ => {
                        self.charge(1, reader.offset())?;
                        elements.push(self.value(field, reader)?);
                    }
                }
                *count = count.saturating_add(1);
            }
        }
        Ok(())
    }

    /// Reads packed numbers.
    fn packed(
        &mut self,
        field: &FieldPlan,
        keep: Keep,
        part: (usize, usize),
        elements: &mut Vec<Value>,
        count: &mut usize,
    ) -> Result<(), DecodeError> {
        let mut reader = Reader::new(self.message, part);
        while *count < keep.elements && !reader.is_empty() {
            self.charge(1, reader.offset())?;
            elements.push(self.value(field, &mut reader)?);
            *count += 1;
        }
        // The others are only counted.
        let rest = reader.rest();
        let (more, whole) = match field.form.wire() {
            WireType::Fixed32 => (rest.len() / 4, rest.len().is_multiple_of(4)),
            WireType::Fixed64 => (rest.len() / 8, rest.len().is_multiple_of(8)),
            _ => (rest.iter().filter(|byte| **byte < 0x80).count(), rest.last().is_none_or(|byte| *byte < 0x80)),
        };
        if !whole {
            return reader.error("an array of numbers ends within a number");
        }
        *count = count.saturating_add(more);
        Ok(())
    }

    /// Reads one value that is no message.
    fn value(&mut self, field: &FieldPlan, reader: &mut Reader<'_>) -> Result<Value, DecodeError> {
        Ok(match field.form {
            Form::Bool => Value::Bool(reader.varint()? != 0),
            Form::Int32 => Value::Int((reader.varint()? as i32).into()),
            Form::Int64 => Value::Int(reader.varint()? as i64),
            Form::Uint32 => Value::Uint((reader.varint()? as u32).into()),
            Form::Uint64 => Value::Uint(reader.varint()?),
            Form::Sint32 => Value::Int((unzigzag((reader.varint()? as u32).into()) as i32).into()),
            Form::Sint64 => Value::Int(unzigzag(reader.varint()?)),
            Form::Fixed32 => Value::Uint(u32::from_le_bytes(reader.fixed32()?).into()),
            Form::Fixed64 => Value::Uint(u64::from_le_bytes(reader.fixed64()?)),
            Form::Sfixed32 => Value::Int(i32::from_le_bytes(reader.fixed32()?).into()),
            Form::Sfixed64 => Value::Int(i64::from_le_bytes(reader.fixed64()?)),
            Form::Float => Value::Float(f32::from_le_bytes(reader.fixed32()?).into()),
            Form::Double => Value::Float(f64::from_le_bytes(reader.fixed64()?)),
            // One bad letter in a text must not cost the numbers beside it.
            Form::Text => Value::Text(String::from_utf8_lossy(self.bytes(reader)?).into_owned()),
            Form::Bytes => {
                let bytes = self.bytes(reader)?;
                if field.bytes.or_count && bytes.len() > field.bytes.elements {
                    return Ok(Value::Long(bytes.len()));
                }
                let kept = bytes.len().min(field.bytes.elements);
                self.charge(kept, reader.offset())?;
                Value::Array(bytes[..kept].iter().map(|&byte| Value::Uint(byte.into())).collect())
            }
            Form::Message(_) | Form::Unwanted => Value::Null,
        })
    }

    fn bytes<'b>(&self, reader: &mut Reader<'b>) -> Result<&'b [u8], DecodeError> {
        let rest = reader.clone();
        let (start, end) = reader.span()?;
        let skip = start.saturating_sub(rest.offset());
        Ok(rest.rest().get(skip..skip + (end - start)).unwrap_or_default())
    }

    /// Takes room for some values.
    fn charge(&mut self, values: usize, offset: usize) -> Result<(), DecodeError> {
        let left = self.room.checked_sub(values);
        self.room = left.ok_or_else(|| {
            let problem = format!(
                "{} bytes unpack to far more values than messages have; the message is damaged",
                self.message.len()
            );
            DecodeError::new(offset, problem)
        })?;
        Ok(())
    }
}

/// Returns true if a field of the schema may be written in this form. In another form it counts as an unknown field,
/// and is skipped.
fn accepts(field: &FieldPlan, wire: WireType) -> bool {
    let form = field.form;
    form == Form::Unwanted
        || wire == form.wire()
        || field.list.is_some() && form.is_number() && wire == WireType::Length
}

fn unzigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

//! An encoder for every wire, written for the tests from the standard alone.

use super::super::wire::Wire;
use crate::{Extensibility, Length, Scalar, Schema, Type, Value};

pub(super) fn encode(schema: &Schema, wire: Wire, big: bool, value: &Value) -> Vec<u8> {
    let mut out = Encoder { schema, wire, big, bytes: Vec::new() };
    out.value(&Type::Struct(schema.root), value, true);
    let id = match wire {
        Wire::Ros1 => return out.bytes,
        Wire::Xcdr1 => 0,
        Wire::Plain2 => 6,
        Wire::Delimited2 => 8,
    };
    let mut message = vec![0, id + u8::from(!big), 0, 0];
    message.extend(out.bytes);
    message
}

struct Encoder<'a> {
    schema: &'a Schema,
    wire: Wire,
    big: bool,
    bytes: Vec<u8>,
}

impl Encoder<'_> {
    fn align(&mut self, size: usize) {
        let most = match self.wire {
            Wire::Ros1 => 1,
            Wire::Xcdr1 => 8,
            _ => 4,
        };
        while !self.bytes.len().is_multiple_of(size.min(most)) {
            self.bytes.push(0xAA);
        }
    }

    fn put(&mut self, little: &[u8]) {
        self.align(little.len());
        let mut bytes = little.to_vec();
        if self.big {
            bytes.reverse();
        }
        self.bytes.extend(bytes);
    }

    fn count(&mut self, count: usize) {
        self.put(&(count as u32).to_le_bytes());
    }

    fn part(&mut self, has_length: bool, inside: impl FnOnce(&mut Self)) {
        if !has_length {
            return inside(self);
        }
        self.count(0);
        let start = self.bytes.len();
        inside(self);
        let size = (self.bytes.len() - start) as u32;
        self.bytes[start - 4..start].copy_from_slice(&if self.big { size.to_be_bytes() } else { size.to_le_bytes() });
    }

    fn value(&mut self, kind: &Type, value: &Value, outermost: bool) {
        let version2 = matches!(self.wire, Wire::Plain2 | Wire::Delimited2);
        match (kind, value) {
            (Type::Scalar(scalar), _) => self.scalar(*scalar, value),
            (Type::Text { wide: false }, Value::Text(text)) => {
                let nul = usize::from(self.wire != Wire::Ros1);
                self.count(text.len() + nul);
                self.bytes.extend(text.bytes().chain(std::iter::repeat_n(0, nul)));
            }
            (Type::PlainText { size }, Value::Text(text)) => {
                // Bytes behind the NUL mean nothing.
                let filling = std::iter::once(0).chain(std::iter::repeat(0xAA));
                let size = size.unwrap_or(text.len());
                self.bytes.extend(text.bytes().chain(filling).take(size));
            }
            (Type::Text { wide: true }, Value::Text(text)) => {
                let units: Vec<u16> = text.encode_utf16().collect();
                self.count(if self.wire == Wire::Xcdr1 { units.len() } else { 2 * units.len() });
                for unit in units {
                    if self.wire == Wire::Xcdr1 {
                        let unit = u32::from(unit);
                        self.bytes.extend(if self.big { unit.to_be_bytes() } else { unit.to_le_bytes() });
                        continue;
                    }
                    self.bytes.extend(if self.big { unit.to_be_bytes() } else { unit.to_le_bytes() });
                }
            }
            (Type::Struct(index), Value::Struct(fields)) => {
                let struct_type = &self.schema.structs[*index];
                let header = match self.wire {
                    Wire::Delimited2 => struct_type.extensibility != Some(Extensibility::Final),
                    Wire::Plain2 => struct_type.extensibility == Some(Extensibility::Appendable),
                    _ => false,
                };
                self.part(header, |out| {
                    for (field, (_, value)) in struct_type.fields.iter().zip(fields) {
                        if field.optional {
                            out.bytes.push(u8::from(*value != Value::Null));
                        }
                        if !field.optional || *value != Value::Null {
                            out.value(&field.kind, value, true);
                        }
                    }
                });
            }
            (Type::Array { element, length }, Value::Array(elements)) => {
                let mut innermost = &**element;
                while let Type::Array { element, length: Length::Fixed(_) } = innermost {
                    innermost = element;
                }
                let header = version2 && outermost && !matches!(innermost, Type::Scalar(_));
                self.part(header, |out| {
                    if let Length::Sequence(_) = length {
                        out.count(elements.len());
                    }
                    let of_fixed = matches!(length, Length::Fixed(_));
                    let is_fixed = matches!(**element, Type::Array { length: Length::Fixed(_), .. });
                    elements.iter().for_each(|value| out.value(element, value, !(of_fixed && is_fixed)));
                });
            }
            _ => panic!("{value:?} is no {kind:?}"),
        }
    }

    fn scalar(&mut self, scalar: Scalar, value: &Value) {
        match (scalar, value) {
            (Scalar::Bool, Value::Bool(value)) => self.put(&[u8::from(*value)]),
            (Scalar::I8, Value::Int(value)) => self.put(&(*value as i8).to_le_bytes()),
            (Scalar::I16, Value::Int(value)) => self.put(&(*value as i16).to_le_bytes()),
            (Scalar::I32, Value::Int(value)) => self.put(&(*value as i32).to_le_bytes()),
            (Scalar::I64, Value::Int(value)) => self.put(&value.to_le_bytes()),
            (Scalar::U8, Value::Uint(value)) => self.put(&(*value as u8).to_le_bytes()),
            (Scalar::U16, Value::Uint(value)) => self.put(&(*value as u16).to_le_bytes()),
            (Scalar::U32, Value::Uint(value)) => self.put(&(*value as u32).to_le_bytes()),
            (Scalar::U64, Value::Uint(value)) => self.put(&value.to_le_bytes()),
            (Scalar::F32, Value::Float(value)) => self.put(&(*value as f32).to_le_bytes()),
            (Scalar::F64, Value::Float(value)) => self.put(&value.to_le_bytes()),
            (Scalar::LongDouble, Value::Null) => {
                self.align(8);
                self.bytes.extend([7; 16]);
            }
            _ => panic!("{value:?} is no {scalar:?}"),
        }
    }
}

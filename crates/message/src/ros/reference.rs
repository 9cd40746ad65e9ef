//! Whole messages: a plain recursive decoder over the schema, the reference for the compiled programs.

use std::sync::Arc;

use super::wire::{Sizes, Wire, narrow, number, plain, wide};
use crate::{DecodeError, Length, Scalar, Schema, Type, Value, value::LONG_ARRAY};

/// Values that one message is decoded into at the most; arrays beyond are only counted. What a message takes in memory is so bounded, even
/// where its bytes are zeros that a small file was inflated to.
const MAX_VALUES: usize = 1 << 21;

/// Decodes the message whose body starts behind `header` bytes.
pub(super) fn value<const BIG: bool>(
    schema: &Schema,
    sizes: &Sizes,
    wire: Wire,
    message: &[u8],
    header: usize,
) -> Result<Value, DecodeError> {
    let mut reader = Reader::<BIG> {
        schema,
        sizes,
        wire,
        message,
        origin: header,
        place: header,
        end: message.len(),
        budget: MAX_VALUES,
    };
    reader.structure(schema.root)
}

struct Reader<'a, const BIG: bool> {
    schema: &'a Schema,
    sizes: &'a Sizes,
    wire: Wire,
    message: &'a [u8],
    /// Origin of alignment.
    origin: usize,
    place: usize,
    /// End of the message, or of the innermost part with a length.
    end: usize,
    /// Values that may still be kept.
    budget: usize,
}

impl<'a, const BIG: bool> Reader<'a, BIG> {
    fn error<T>(&self, problem: impl Into<String>) -> Result<T, DecodeError> {
        Err(DecodeError::new(self.place, problem))
    }

    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], DecodeError> {
        let stop = self.place.checked_add(count).filter(|&stop| stop <= self.end);
        match stop.and_then(|stop| self.message.get(self.place..stop).map(|bytes| (stop, bytes))) {
            Some((stop, bytes)) => {
                self.place = stop;
                Ok(bytes)
            }
            None => self
                .error(format!("{what} has {count} bytes, but only {} are left", self.end.saturating_sub(self.place))),
        }
    }

    fn align(&mut self, size: usize) {
        let alignment = self.wire.alignment(size);
        self.place += (self.place - self.origin).next_multiple_of(alignment) - (self.place - self.origin);
    }

    fn count(&mut self) -> Result<usize, DecodeError> {
        self.align(4);
        let bytes = self.take(4, "a length")?;
        let bytes = bytes.first_chunk::<4>().copied().unwrap_or_default();
        Ok(if BIG { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) } as usize)
    }

    /// Enters a part that has its length in bytes before it; answers where what is around it ends.
    fn enter(&mut self) -> Result<usize, DecodeError> {
        let size = self.count()?;
        let outer = self.end;
        let left = self.end.saturating_sub(self.place);
        if size > left {
            return self.error(format!("a part has {size} bytes, but only {left} are left"));
        }
        self.end = self.place + size;
        Ok(outer)
    }

    fn leave(&mut self, outer: usize) {
        self.place = self.end;
        self.end = outer;
    }

    fn structure(&mut self, index: usize) -> Result<Value, DecodeError> {
        let schema = self.schema;
        let Some(struct_type) = schema.structs.get(index) else { return self.error("its type is not in the schema") };
        let header = self.wire.struct_header(schema, index);
        let outer = if header { self.enter()? } else { self.end };
        let mut fields = Vec::with_capacity(struct_type.fields.len());
        for field in &struct_type.fields {
            // A writer with an older, shorter definition ends early.
            let is_cut = header && self.place == self.end;
            let value =
                if is_cut || (field.optional && !self.present()?) { Value::Null } else { self.any(&field.kind)? };
            if !matches!(field.kind, Type::Padding(_)) {
                fields.push((Arc::clone(&field.name), value));
            }
        }
        if header {
            self.leave(outer);
        }
        Ok(Value::Struct(fields))
    }

    fn present(&mut self) -> Result<bool, DecodeError> {
        if self.wire == Wire::Xcdr1 {
            return self.error("optional members in version 1 of CDR are not read; write the log with XCDR2");
        }
        Ok(self.take(1, "a flag")?.first() != Some(&0))
    }

    fn any(&mut self, kind: &Type) -> Result<Value, DecodeError> {
        match kind {
            Type::Scalar(scalar) => self.scalar(*scalar),
            Type::Text { wide } => self.text(*wide),
            Type::PlainText { size } => {
                let size = size.unwrap_or(self.end.saturating_sub(self.place));
                let bytes = plain(self.take(size, "a text")?);
                Ok(Value::Text(String::from_utf8_lossy(bytes).into_owned()))
            }
            Type::Padding(size) => self.take(*size, "padding").map(|_| Value::Null),
            Type::Struct(index) => self.structure(*index),
            Type::Array { element, length } => {
                let header = self.wire.array_header(element);
                let outer = if header { self.enter()? } else { self.end };
                let value = self.array(element, *length)?;
                if header {
                    self.leave(outer);
                }
                Ok(value)
            }
        }
    }

    fn array(&mut self, element: &Type, length: Length) -> Result<Value, DecodeError> {
        let count = match length {
            Length::Fixed(count) => count,
            Length::Sequence(_) => self.count()?,
        };
        let least = self.sizes.least(element);
        if least == 0 {
            return Ok(Value::Long(count));
        }
        let left = self.end.saturating_sub(self.place);
        if count > left / least {
            return self.error(format!(
                "an array has {count} elements of at least {least} bytes, but only {left} bytes are left"
            ));
        }
        if let Type::Scalar(scalar) = element
            && count > LONG_ARRAY
        {
            self.align(scalar.size());
            self.take(count.saturating_mul(scalar.size()), "an array")?;
            return Ok(Value::Long(count));
        }
        let cost = match element {
            Type::Struct(index) => {
                1 + self.schema.structs.get(*index).map_or(0, |struct_type| struct_type.fields.len())
            }
            _ => 1,
        };
        if let Some(budget) = self.budget.checked_sub(count.saturating_mul(cost)) {
            self.budget = budget;
            return (0..count).map(|_| self.element(element, length)).collect::<Result<_, _>>().map(Value::Array);
        }
        for _ in 0..count {
            let budget = self.budget;
            self.element(element, length)?;
            self.budget = budget;
        }
        Ok(Value::Long(count))
    }

    /// An element; the further dimensions of an array have no lengths of their own.
    fn element(&mut self, element: &Type, of: Length) -> Result<Value, DecodeError> {
        match (of, element) {
            (Length::Fixed(_), Type::Array { element, length: length @ Length::Fixed(_) }) => {
                self.array(element, *length)
            }
            _ => self.any(element),
        }
    }

    fn scalar(&mut self, scalar: Scalar) -> Result<Value, DecodeError> {
        self.align(scalar.size());
        let bytes = self.take(scalar.size(), "a number")?;
        macro_rules! read {
            ($number:ty) => {{
                let bytes = bytes.first_chunk().copied().unwrap_or_default();
                if BIG { <$number>::from_be_bytes(bytes) } else { <$number>::from_le_bytes(bytes) }
            }};
        }
        Ok(match scalar {
            Scalar::Bool => Value::Bool(bytes.first() != Some(&0)),
            Scalar::I64 => Value::Int(read!(i64)),
            Scalar::U64 => Value::Uint(read!(u64)),
            Scalar::I8 => Value::Int(read!(i8).into()),
            Scalar::I16 => Value::Int(read!(i16).into()),
            Scalar::I32 => Value::Int(read!(i32).into()),
            Scalar::U8 => Value::Uint(read!(u8).into()),
            Scalar::U16 => Value::Uint(read!(u16).into()),
            Scalar::U32 => Value::Uint(read!(u32).into()),
            Scalar::LongDouble => Value::Null,
            Scalar::F32 | Scalar::F64 => number::<BIG>(scalar, bytes).map_or(Value::Null, Value::Float),
        })
    }

    fn text(&mut self, is_wide: bool) -> Result<Value, DecodeError> {
        let unit = self.wire.text_unit(is_wide);
        let size = self.count()?.saturating_mul(unit);
        let bytes = self.take(size, "a text")?;
        Ok(Value::Text(if is_wide {
            wide::<BIG>(bytes, unit)
        } else {
            String::from_utf8_lossy(if self.wire == Wire::Ros1 { bytes } else { narrow(bytes) }).into_owned()
        }))
    }
}

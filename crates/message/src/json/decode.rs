//! Decoding of JSON: all of it, or the wanted fields.

use std::{collections::HashMap, fmt, sync::Arc};

use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::shape::Shapes;
use crate::{DecodeError, Value, lookup::Wanted, value::LONG_ARRAY};

/// Objects with no more fields than this are searched without an index.
const FEW_FIELDS: usize = 16;

/// Decodes a message; with `wanted`, only what is wanted of it, and arrays as far as they are wanted.
pub(super) fn decode(message: &[u8], shapes: &Shapes, wanted: Option<&Wanted>) -> Result<Value, DecodeError> {
    let seed = Seed { shapes, shape: shapes.root(), wanted };
    parse(message, seed).or_else(|error| {
        let patched = without_non_finite(message).and_then(|message| parse(&message, seed).ok());
        patched.ok_or_else(|| problem(message, &error))
    })
}

fn parse(message: &[u8], seed: Seed<'_>) -> Result<Value, serde_json::Error> {
    let mut json = serde_json::Deserializer::from_slice(message);
    let value = seed.deserialize(&mut json)?;
    json.end()?;
    Ok(value)
}

/// Finds the byte of an error.
fn problem(message: &[u8], error: &serde_json::Error) -> DecodeError {
    let lines = message.split(|byte| *byte == b'\n').take(error.line().saturating_sub(1));
    let before: usize = lines.map(|line| line.len() + 1).sum();
    DecodeError::new(
        (before + error.column().saturating_sub(1)).min(message.len()),
        format!("this is not JSON: {error}"),
    )
}

/// NaN and infinities are no JSON, but some writers know no better: they become null. `None` if there are none.
fn without_non_finite(message: &[u8]) -> Option<Vec<u8>> {
    const NUMBERS: [&[u8]; 3] = [b"-Infinity", b"Infinity", b"NaN"];
    let mut patched = Vec::with_capacity(message.len());
    let mut non_finite = false;
    let mut in_text = false;
    let mut rest = message;
    while let Some((&byte, after)) = rest.split_first() {
        if let Some(after) = NUMBERS.iter().filter(|_| !in_text).find_map(|number| rest.strip_prefix(*number)) {
            patched.extend(b"null");
            non_finite = true;
            rest = after;
            continue;
        }
        patched.push(byte);
        rest = after;
        match (byte, after.split_first()) {
            (b'"', _) => in_text = !in_text,
            (b'\\', Some((&escaped, after))) if in_text => {
                patched.push(escaped);
                rest = after;
            }
            _ => (),
        }
    }
    non_finite.then_some(patched)
}

/// Shape and wanted parts of a value, before it is read.
#[derive(Clone, Copy)]
struct Seed<'a> {
    shapes: &'a Shapes,
    shape: Option<usize>,
    /// `None`: all of it.
    wanted: Option<&'a Wanted>,
}

impl<'de> DeserializeSeed<'de> for Seed<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Seed<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(if self.shapes.is_real(self.shape) { Value::Float(value as f64) } else { Value::Int(value) })
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        match i64::try_from(value) {
            Ok(value) => self.visit_i64(value),
            Err(_) if self.shapes.is_real(self.shape) => Ok(Value::Float(value as f64)),
            Err(_) => Ok(Value::Uint(value)),
        }
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        Ok(Value::Float(value))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(Value::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut array: A) -> Result<Value, A::Error> {
        let seed = Self { shape: self.shapes.elements(self.shape), ..self };
        let keep = self.wanted.map_or(usize::MAX, |wanted| wanted.elements);
        let mut elements = Vec::new();
        while elements.len() < keep {
            match array.next_element_seed(seed)? {
                Some(element) => elements.push(element),
                None => break,
            }
        }
        if elements.len() >= keep {
            while array.next_element::<IgnoredAny>()?.is_some() {}
        }
        let is_plain = |value: &Value| matches!(value, Value::Null) || value.number().is_some();
        if self.wanted.is_none() && elements.len() > LONG_ARRAY && elements.iter().all(is_plain) {
            return Ok(Value::Long(elements.len()));
        }
        Ok(Value::Array(elements))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut object: A) -> Result<Value, A::Error> {
        let mut fields = Fields::default();
        while let Some(name) = object.next_key_seed(Name { wanted: self.wanted })? {
            let Some((name, wanted)) = name else {
                object.next_value::<IgnoredAny>()?;
                continue;
            };
            let shape = self.shapes.field(self.shape, &name);
            let value = object.next_value_seed(Self { shapes: self.shapes, shape, wanted })?;
            fields.set(name, value);
        }
        Ok(Value::Struct(fields.fields))
    }
}

/// The name of a field: `None` if it is not wanted.
struct Name<'a> {
    wanted: Option<&'a Wanted>,
}

impl<'de, 'a> DeserializeSeed<'de> for Name<'a> {
    type Value = Option<(Arc<str>, Option<&'a Wanted>)>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_str(self)
    }
}

impl<'de, 'a> Visitor<'de> for Name<'a> {
    type Value = Option<(Arc<str>, Option<&'a Wanted>)>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the name of a field")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        Ok(match self.wanted {
            None => Some((Arc::from(name), None)),
            Some(wanted) => {
                let field = wanted.fields.iter().find(|(field_name, _)| **field_name == *name);
                field.map(|(field_name, part)| (field_name.clone(), Some(part)))
            }
        })
    }
}

/// The fields of an object in their order. Of two with one name the last counts.
#[derive(Default)]
struct Fields {
    fields: Vec<(Arc<str>, Value)>,
    /// Places by name, once there are many.
    places: HashMap<Arc<str>, usize>,
}

impl Fields {
    fn set(&mut self, name: Arc<str>, value: Value) {
        let place_of_name = if self.fields.len() <= FEW_FIELDS {
            self.fields.iter().position(|(field_name, _)| *field_name == name)
        } else {
            if self.places.is_empty() {
                self.places = self.fields.iter().enumerate().map(|(place, (name, _))| (name.clone(), place)).collect();
            }
            self.places.get(&name).copied()
        };
        match place_of_name.and_then(|place| self.fields.get_mut(place)) {
            Some((_, slot)) => *slot = value,
            None => {
                if self.fields.len() > FEW_FIELDS {
                    self.places.insert(name.clone(), self.fields.len());
                }
                self.fields.push((name, value));
            }
        }
    }
}

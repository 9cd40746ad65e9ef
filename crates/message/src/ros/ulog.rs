//! Format definitions of ULog, and the place of the time in its messages.
//!
//! Format: <https://docs.px4.io/main/en/dev_log/ulog_file_format.html>. A message is a packed little-endian struct. A schema is a text with one
//! definition a line, `name:type field;type[4] field;...`, the message's own among them. Fields go by the names that pyulog gives them: `q[0]`,
//! `esc[2].esc_rpm`.

use std::{collections::HashMap, ops::RangeInclusive};

use super::link::{Definition, Kind, Member, link};
use crate::{Length, Scalar, Schema, SchemaError, Type};

/// The field that holds the time of a message, microseconds from the boot of its writer.
const TIMESTAMP: &str = "timestamp";

/// Fields of such names mean nothing. At a message's end a writer may leave them out.
const PADDING: &str = "_padding";

/// Layout of the messages of a ULog format in bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct UlogLayout {
    /// Offset of the time: eight bytes, microseconds.
    pub timestamp: usize,
    /// Allowed number of bytes of a message: with and without the padding at its end.
    pub bytes: RangeInclusive<usize>,
}

/// The layout of the messages of a format, from the definitions that it uses.
///
/// # Errors
/// Definitions that cannot be understood, and a format without a time.
pub fn ulog_layout(name: &str, definitions: &str) -> Result<UlogLayout, SchemaError> {
    let malformed =
        |problem: String| SchemaError::Malformed { encoding: "ulog".to_owned(), name: name.to_owned(), problem };
    let (definitions_used, padding) = definitions_of(name, definitions).map_err(malformed)?;
    let schema = link(&definitions_used, 0).map_err(malformed)?;
    let mut sizes: Vec<usize> = Vec::with_capacity(schema.structs.len());
    let mut timestamp = None;
    // A struct stands behind those that it uses, so that their sizes are known.
    for (index, struct_type) in schema.structs.iter().enumerate() {
        let mut at = 0_usize;
        for field in &struct_type.fields {
            if index == schema.root && *field.name == *TIMESTAMP {
                timestamp = Some((at, field.kind.clone()));
            }
            at = at.saturating_add(size(&field.kind, &sizes));
        }
        sizes.push(at);
    }
    let bytes = sizes.get(schema.root).copied().unwrap_or_default();
    let rest = schema.structs.get(schema.root).and_then(|root| root.fields.last()).map(|field| &field.kind);
    let most = if rest == Some(&REST) { usize::MAX } else { bytes.saturating_add(padding) };
    match timestamp {
        Some((timestamp, Type::Scalar(Scalar::U64))) => Ok(UlogLayout { timestamp, bytes: bytes..=most }),
        Some(_) => Err(malformed("its `timestamp` is not a uint64_t".to_owned())),
        None => Err(malformed("it has no `timestamp`".to_owned())),
    }
}

/// Reads the definitions in `text`, of which one is `name`'s own.
///
/// # Errors
/// A field that is none; a type that is missing or contains itself.
pub(super) fn parse(name: &str, text: &str) -> Result<Schema, String> {
    link(&definitions_of(name, text)?.0, 0)
}

/// All that is left of a message.
const REST: Type = Type::PlainText { size: None };

/// Bytes of a value. Nothing in ULog has a size of its own but the rest of a message.
fn size(kind: &Type, structs: &[usize]) -> usize {
    match kind {
        Type::Scalar(scalar) => scalar.size(),
        Type::PlainText { size } => size.unwrap_or(0),
        Type::Padding(size) => *size,
        Type::Struct(index) => structs.get(*index).copied().unwrap_or(0),
        Type::Array { element, length: Length::Fixed(count) } => size(element, structs).saturating_mul(*count),
        Type::Text { .. } | Type::Array { .. } => 0,
    }
}

/// All definitions, that of the message first, without the padding at its end; and the bytes of that padding.
fn definitions_of(name: &str, text: &str) -> Result<(Vec<Definition>, usize), String> {
    let mut lines: Vec<(&str, &str)> = text.lines().filter_map(|line| line.split_once(':')).collect();
    let place_of_name = lines.iter().position(|(other, _)| *other == name);
    let place_of_name = place_of_name.ok_or_else(|| format!("the definition of `{name}` is missing"))?;
    lines.swap(0, place_of_name);
    let places: HashMap<&str, usize> =
        lines.iter().enumerate().rev().map(|(place, (name, _))| (*name, place)).collect();
    let definition = |(name, fields): &(&str, &str)| {
        let fields = fields.split(';').map(str::trim).filter(|field| !field.is_empty());
        let fields = fields.map(|field| member(field, &places)).collect::<Result<_, _>>()?;
        Ok::<_, String>(Definition { name: (*name).to_owned(), fields, extensibility: None })
    };
    let mut definitions: Vec<Definition> = lines.iter().map(definition).collect::<Result<_, _>>()?;
    let mut padding = 0_usize;
    if let Some(first) = definitions.first_mut() {
        while let Some(Kind::Known(Type::Padding(size))) = first.fields.last().map(|field| &field.kind) {
            padding = padding.saturating_add(*size);
            first.fields.pop();
        }
    }
    let rest = |member: &Member| matches!(member.kind, Kind::Known(Type::PlainText { size: None }));
    let ends = |(place, definition): (usize, &Definition)| {
        let count = definition.fields.iter().filter(|member| rest(member)).count();
        count == 0 || (place == 0 && count == 1 && definition.fields.last().is_some_and(rest))
    };
    match definitions.iter().enumerate().all(ends) {
        true => Ok((definitions, padding)),
        false => Err("an array without a length stands before the end of a message".to_owned()),
    }
}

/// A field from `type name` or `type[count] name`.
fn member(field: &str, places: &HashMap<&str, usize>) -> Result<Member, String> {
    let none = || format!("`{field}` is not a field");
    let (kind, name) = field.split_once(' ').ok_or_else(none)?;
    let (element, count) = match kind.split_once('[') {
        Some((element, count)) => (element, Some(count.strip_suffix(']').ok_or_else(none)?)),
        None => (kind, None),
    };
    let kind = match (element, count) {
        ("char", Some("")) => Kind::Known(REST),
        (_, None) => kind_of(element, None, name, places),
        (_, Some(count)) => kind_of(element, Some(count.parse().map_err(|_| none())?), name, places),
    };
    Ok(Member { name: name.trim().to_owned(), kind, optional: false })
}

fn kind_of(element: &str, count: Option<usize>, name: &str, places: &HashMap<&str, usize>) -> Kind {
    let all = count.unwrap_or(1);
    let one = match (scalar(element), places.get(element)) {
        _ if element == "char" => return Kind::Known(Type::PlainText { size: Some(all) }),
        (Some(scalar), _) if name.starts_with(PADDING) => {
            return Kind::Known(Type::Padding(scalar.size().saturating_mul(all)));
        }
        (Some(scalar), _) => Kind::Known(Type::Scalar(scalar)),
        (None, Some(&place)) => Kind::Struct(place),
        (None, None) => Kind::Missing(element.to_owned()),
    };
    match count {
        Some(count) => Kind::Array(Box::new(one), Length::Fixed(count)),
        None => one,
    }
}

fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "int8_t" => Scalar::I8,
        "uint8_t" => Scalar::U8,
        "int16_t" => Scalar::I16,
        "uint16_t" => Scalar::U16,
        "int32_t" => Scalar::I32,
        "uint32_t" => Scalar::U32,
        "int64_t" => Scalar::I64,
        "uint64_t" => Scalar::U64,
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        "bool" => Scalar::Bool,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Codec, Row, Value, codec};

    const ESC: &str = "esc_status:uint64_t timestamp;uint8_t count;uint8_t[3] _padding0;esc_report[2] esc;char[6] name;bool on;\
                       uint8_t[5] _padding1;\nesc_report:int32_t rpm;float[1] volts;uint8_t[2] _padding0;";

    fn ulog(name: &str, text: &str) -> Box<dyn Codec> {
        codec("ulog", Some((name, "ulog", text.as_bytes()))).unwrap()
    }

    fn esc() -> Vec<u8> {
        let mut bytes = 7_u64.to_le_bytes().to_vec();
        bytes.extend([2, 9, 9, 9]);
        for (rpm, volts) in [(-5_i32, 1.5_f32), (6, 2.5)] {
            bytes.extend(rpm.to_le_bytes());
            bytes.extend(volts.to_le_bytes());
            bytes.extend([8, 8]);
        }
        bytes.extend(b"ab\0cd\0\x01");
        bytes
    }

    #[test]
    fn packed_structs_with_padding_texts_and_nested_types() {
        let layout = ulog_layout("esc_status", ESC).unwrap();
        assert_eq!(layout, UlogLayout { timestamp: 0, bytes: 39..=44 });
        let (message, codec) = (esc(), ulog("esc_status", ESC));
        assert_eq!(message.len(), 39);
        let value = codec.value(&message).unwrap();
        let Value::Struct(fields) = &value else { panic!("{value:?}") };
        let names: Vec<&str> = fields.iter().map(|(name, _)| &**name).collect();
        assert_eq!(names, ["timestamp", "count", "esc", "name", "on"], "padding is no field");
        let paths = ["on", "esc[1].volts[0]", "esc[0].rpm", "name", "timestamp", "count"];
        let extract = codec.compile(&paths.map(|path| path.parse().unwrap())).unwrap();
        let mut row = Row::new(&*extract);
        extract.extract(&message, &mut row).unwrap();
        assert_eq!(row.values, [1.0, 2.5, -5.0, 0.0, 7.0, 2.0]);
        assert_eq!((row.texts.names(), row.is_text[3]), (&["ab".to_owned()][..], true));
        assert!(codec.compile(&["_padding0".parse().unwrap()]).is_err());
        // Cut before what is wanted.
        assert!(extract.extract(&message[..38], &mut row).is_err() && codec.value(&message[..38]).is_err());
    }

    #[test]
    fn the_rest_of_a_message_is_a_text() {
        let text = "note:uint8_t level;uint64_t timestamp;char[] message;";
        assert_eq!(ulog_layout("note", text).unwrap(), UlogLayout { timestamp: 1, bytes: 9..=usize::MAX });
        let codec = ulog("note", text);
        let mut message = vec![54];
        message.extend(3_u64.to_le_bytes());
        for note in ["", "armed"] {
            let bytes = [&message[..], note.as_bytes()].concat();
            assert_eq!(codec.value(&bytes).unwrap().field("message"), Some(&Value::Text(note.to_owned())));
            let extract = codec.compile(&["message".parse().unwrap()]).unwrap();
            let mut row = Row::new(&*extract);
            extract.extract(&bytes, &mut row).unwrap();
            assert_eq!(row.texts.names(), [note]);
        }
    }

    #[test]
    fn definitions_that_cannot_be_used_say_why() {
        let problem = |text: &str| ulog_layout("a", text).unwrap_err().to_string();
        assert!(problem("b:uint64_t timestamp;").contains("definition of `a` is missing"));
        assert!(problem("a:float x;").contains("no `timestamp`"));
        assert!(problem("a:uint32_t timestamp;").contains("not a uint64_t"));
        assert!(problem("a:uint64_t timestamp;float[x] y;").contains("`float[x] y` is not a field"));
        assert!(problem("a:uint64_t timestamp;b b;").contains("definition of `b` is missing"));
        assert!(problem("a:uint64_t timestamp;a a;").contains("contains itself"));
        assert!(problem("a:char[] x;uint64_t timestamp;").contains("before the end"));
        assert!(problem("a:uint64_t timestamp;b b;\nb:char[] x;").contains("before the end"));
        // Sizes that no message has are numbers like others.
        let huge = "a:uint64_t timestamp;b[4000000000] b;\nb:double[4000000000] x;";
        assert_eq!(ulog_layout("a", huge).unwrap().bytes, usize::MAX..=usize::MAX);
        let codec = ulog("a", huge);
        assert!(codec.value(&[0; 64]).is_err());
        let extract = codec.compile(&["b[3999999999].x[3999999999]".parse().unwrap()]).unwrap();
        assert!(extract.extract(&[0; 64], &mut Row::new(&*extract)).is_err());
    }
}

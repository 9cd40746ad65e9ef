//! Schemas, field names and messages of all encodings, none of them to be trusted.
//!
//! An input is: one byte for the encodings, the lengths of the schema and of the fields (16 bits each, little-endian), the schema, the fields
//! (the name of the type, then a path a line), and the message.
//!
//! No input may cause a panic, a hang or allocation beyond measure, and the two decoders must agree: the whole message holds what the compiled
//! extractor finds, both under the names that the input asks for and under those that the fields of the message are listed by.

use fleetfoot_message::{Codec, FieldInfo, FieldKind, FieldPath, FieldTree, Row, Step, Value, codec};

/// Message encodings with the schema encodings that go with them.
const ENCODINGS: [(&str, Option<&str>); 6] = [
    ("cdr", Some("ros2msg")),
    ("cdr", Some("ros2idl")),
    ("ros1", Some("ros1msg")),
    ("protobuf", Some("protobuf")),
    ("json", None),
    ("json", Some("jsonschema")),
];
/// More wanted fields than these only cost time.
const MAX_FIELDS: usize = 64;

struct Input<'a> {
    encoding: (&'static str, Option<&'static str>),
    schema: &'a [u8],
    type_name: &'a str,
    fields: Vec<FieldPath>,
    message: &'a [u8],
}

impl<'a> Input<'a> {
    fn split(data: &'a [u8]) -> Option<Self> {
        let (&[kind, a, b, c, d], rest) = data.split_first_chunk()?;
        let (schema, rest) = rest.split_at_checked(usize::from(u16::from_le_bytes([a, b])))?;
        let (fields, message) = rest.split_at_checked(usize::from(u16::from_le_bytes([c, d])))?;
        let mut lines = std::str::from_utf8(fields).ok()?.lines();
        Some(Self {
            encoding: ENCODINGS[usize::from(kind) % ENCODINGS.len()],
            schema,
            type_name: lines.next().unwrap_or_default(),
            fields: lines.take(MAX_FIELDS).filter_map(|line| line.parse().ok()).collect(),
            message,
        })
    }

    fn codec(&self) -> Option<Box<dyn Codec>> {
        let (message, schema) = self.encoding;
        codec(message, schema.map(|schema| (self.type_name, schema, self.schema))).ok()
    }
}

/// Field that a path without names leads to: `None` for no field, or for one that is not decoded for people.
fn follow<'a>(mut value: &'a Value, path: &FieldPath) -> Option<&'a Value> {
    for step in &path.steps {
        value = match (step, value) {
            (Step::Field(name), value) => value.field(name)?,
            (Step::Index(place), Value::Array(items)) => items.get(*place)?,
            _ => return None,
        };
    }
    Some(value)
}

/// Extracts the fields one message after another, and compares them with the whole message.
fn compare(codec: &dyn Codec, fields: &[FieldPath], message: &[u8]) {
    let whole = codec.value(message);
    let Ok(extract) = codec.compile(fields) else { return };
    let mut row = Row::new(&*extract);
    assert_eq!(row.values.len(), fields.len(), "every wanted field is in exactly one group");
    // The second time the row holds the answers of the first.
    for _ in 0..2 {
        let result = extract.extract(message, &mut row);
        assert_eq!(
            (row.values.len(), row.present.len(), row.stamps.len()),
            (fields.len(), extract.groups().len(), extract.groups().len())
        );
        let Ok(whole) = &whole else { continue };
        if let Err(error) = result {
            panic!("the message as a whole is sound, but: {error}");
        }
        for (path, &extracted) in fields.iter().zip(&row.values) {
            if let Some(expected) = follow(whole, path).and_then(Value::number) {
                assert!(
                    extracted == expected || (extracted.is_nan() && expected.is_nan()),
                    "{path} is {expected}, and was extracted as {extracted}"
                );
            }
        }
    }
}

/// Lists the fields of a message, and extracts them under their names.
fn extract_listed(codec: &dyn Codec, message: &[u8]) {
    let Ok(whole) = codec.value(message) else { return };
    let mut tree = FieldTree::default();
    tree.add(&whole);
    let listed: Vec<FieldInfo> = tree.fields().into_iter().take(MAX_FIELDS).collect();
    let paths = listed.iter().map(|field| match field.path.parse() {
        Ok(path) => path,
        Err(error) => panic!("a listed field has a name that does not read back: {error}"),
    });
    let extract = match codec.compile(&paths.collect::<Vec<FieldPath>>()) {
        Ok(extract) => extract,
        Err(error) => panic!("a listed field is refused: {error}"),
    };
    let mut row = Row::new(&*extract);
    if let Err(error) = extract.extract(message, &mut row) {
        panic!("the message as a whole is sound, but: {error}");
    }
    for (slot, field) in listed.iter().enumerate() {
        // Elements of the same name are one field, of which a row has the last.
        if field.count + field.missing > 1 {
            continue;
        }
        let extracted = row.values[slot];
        if field.kind == FieldKind::Text {
            // Long texts are not listed.
            let Some(text) = field.texts.first() else { continue };
            let extracted = row.is_text[slot].then(|| &row.texts.names()[extracted as usize]);
            assert_eq!(extracted, Some(text), "{}", field.path);
        } else {
            assert!(
                extracted == field.mean || (extracted.is_nan() && field.mean.is_nan()),
                "{} is listed as {}, and was extracted as {extracted}",
                field.path,
                field.mean
            );
        }
    }
}

/// Reads one input with both decoders; panics where a promise is broken.
pub(crate) fn run(data: &[u8]) {
    let Some(input) = Input::split(data) else { return };
    let Some(codec) = input.codec() else { return };
    compare(&*codec, &input.fields, input.message);
    extract_listed(&*codec, input.message);
    // An extractor is used for many messages, also after one that was broken off.
    compare(&*codec, &input.fields, &input.message[..input.message.len() / 2]);
}

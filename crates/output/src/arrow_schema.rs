//! The Arrow schema that Parquet files carry in their key-value metadata. It has the fields' metadata, with the units,
//! and the types that Parquet lacks: a duration is a plain whole number there.
//!
//! It is a flatbuffer (`Message` and `Schema` of Arrow's columnar format, "Encapsulated message format"), in base64.
//! Only names, units and durations are read of a schema. The Arrow libraries, half of the compile time of a reader of
//! Parquet, are therefore not needed. The numbers below are the places of the fields in the format's tables.

use std::collections::BTreeMap;

use base64::{Engine, prelude::BASE64_STANDARD};
use flatbuffers::{FlatBufferBuilder, TableFinishedWIPOffset, VOffsetT, WIPOffset};

use crate::write_column::{WriteColumn, WriteKind};

/// The key of the file's metadata under which it stands.
pub const KEY: &str = "ARROW:schema";

/// Continuation marker before a message that has a length.
const CONTINUES: [u8; 4] = [255; 4];

/// The kind of a `Message`, and the version of the format that has been written since Arrow 1.0.
const IS_SCHEMA: u8 = 1;
const VERSION_5: i16 = 4;

/// Kinds of the `Type` union.
const INT: u8 = 2;
const FLOATING_POINT: u8 = 3;
const UTF8: u8 = 5;
const BOOL: u8 = 6;
const TIMESTAMP: u8 = 10;
const STRUCT: u8 = 13;
const DURATION: u8 = 18;

/// Nanoseconds in a count of a `Duration` by its unit, and the unit where none is written.
const DURATION_UNITS: [i64; 4] = [1_000_000_000, 1_000_000, 1_000, 1];
const DURATION_DEFAULT: usize = 1;

/// Structs in structs; deeper ones have no units.
const DEEPEST: usize = 64;

/// Position of field number `place` in a table's layout.
const fn slot(place: VOffsetT) -> VOffsetT {
    4 + 2 * place
}

/// The schema of columns that are to be written.
pub fn encode(columns: &[WriteColumn]) -> String {
    let mut builder = FlatBufferBuilder::new();
    let fields: Vec<_> = columns.iter().map(|column| field(&mut builder, column)).collect();
    let fields = builder.create_vector(&fields);
    let schema = table(&mut builder, |builder| builder.push_slot_always(slot(1), fields));
    let message = table(&mut builder, |builder| {
        builder.push_slot_always(slot(2), schema);
        builder.push_slot_always(slot(0), VERSION_5);
        builder.push_slot_always(slot(1), IS_SCHEMA);
    });
    builder.finish_minimal(message);
    let message = builder.finished_data();
    let length = (message.len() as u32).to_le_bytes();
    BASE64_STANDARD.encode([&CONTINUES, &length, message].concat())
}

type Finished = WIPOffset<TableFinishedWIPOffset>;

fn table<'a>(builder: &mut FlatBufferBuilder<'a>, fill: impl FnOnce(&mut FlatBufferBuilder<'a>)) -> Finished {
    let begun = builder.start_table();
    fill(builder);
    builder.end_table(begun)
}

fn field(builder: &mut FlatBufferBuilder<'_>, column: &WriteColumn) -> Finished {
    let name = builder.create_string(&column.name);
    let (kind, detail) = match column.kind {
        // A double.
        WriteKind::Float => (FLOATING_POINT, table(builder, |builder| builder.push_slot_always(slot(0), 2_i16))),
        WriteKind::Integer => {
            let signed_of_64_bits = |builder: &mut FlatBufferBuilder<'_>| {
                builder.push_slot_always(slot(0), 64_i32);
                builder.push_slot_always(slot(1), true);
            };
            (INT, table(builder, signed_of_64_bits))
        }
        // Nanoseconds.
        WriteKind::Stamp => (TIMESTAMP, table(builder, |builder| builder.push_slot_always(slot(0), 3_i16))),
        WriteKind::Boolean => (BOOL, table(builder, |_| ())),
        WriteKind::Text => (UTF8, table(builder, |_| ())),
    };
    let children = builder.create_vector::<Finished>(&[]);
    let unit = column.unit.as_ref().map(|unit| {
        let (key, value) = (builder.create_string("unit"), builder.create_string(unit));
        let pair = table(builder, |builder| {
            builder.push_slot_always(slot(0), key);
            builder.push_slot_always(slot(1), value);
        });
        builder.create_vector(&[pair])
    });
    table(builder, |builder| {
        builder.push_slot_always(slot(0), name);
        builder.push_slot_always(slot(2), kind);
        builder.push_slot_always(slot(3), detail);
        builder.push_slot_always(slot(5), children);
        if let Some(unit) = unit {
            builder.push_slot_always(slot(6), unit);
        }
    })
}

/// The parts of a schema's field that Parquet's schema lacks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ArrowField {
    /// Its `unit` (or `units`).
    pub unit: Option<String>,
    /// Of durations: nanoseconds in a count.
    pub duration: Option<i64>,
}

/// The fields of a schema that have a unit or are durations, by their paths. A damaged schema, or one of another kind,
/// has none.
pub fn fields(text: &str) -> BTreeMap<Vec<String>, ArrowField> {
    let mut by_path = BTreeMap::new();
    if let Ok(bytes) = BASE64_STANDARD.decode(text) {
        let message = bytes.strip_prefix(&CONTINUES).map_or(&*bytes, |rest| rest.get(4..).unwrap_or_default());
        if let Some(schema) = root(message).and_then(|message| message.table(2)) {
            // Every field and every pair takes some bytes of its own, unless the offsets lie.
            let mut left = message.len();
            collect(&schema.tables(1), &mut Vec::new(), &mut left, &mut by_path);
        }
    }
    by_path
}

fn collect(
    fields: &[Table<'_>],
    path: &mut Vec<String>,
    left: &mut usize,
    by_path: &mut BTreeMap<Vec<String>, ArrowField>,
) {
    for field in fields {
        let pairs = field.tables(6);
        let Some(rest) = left.checked_sub(1 + pairs.len()) else { return };
        *left = rest;
        let Some(name) = field.text(0) else { continue };
        path.push(name.to_owned());
        let find = |key| pairs.iter().find(|pair| pair.text(0) == Some(key)).and_then(|pair| pair.text(1));
        let unit = find("unit").or_else(|| find("units")).map(str::to_owned);
        let kind = field.byte(2);
        let duration = if kind == Some(DURATION) { field.table(3).and_then(|detail| detail.duration()) } else { None };
        if unit.is_some() || duration.is_some() {
            by_path.insert(path.clone(), ArrowField { unit, duration });
        }
        if kind == Some(STRUCT) && path.len() < DEEPEST {
            collect(&field.tables(5), path, left, by_path);
        }
        path.pop();
    }
}

/// A table of a flatbuffer, read with every offset checked.
#[derive(Clone, Copy)]
struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
}

fn word(bytes: &[u8], at: usize) -> Option<usize> {
    let word = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(word.try_into().ok()?) as usize)
}

fn half_word(bytes: &[u8], at: usize) -> Option<usize> {
    let word = bytes.get(at..at.checked_add(2)?)?;
    Some(usize::from(u16::from_le_bytes(word.try_into().ok()?)))
}

fn root(bytes: &[u8]) -> Option<Table<'_>> {
    Some(Table { bytes, at: word(bytes, 0)? })
}

impl<'a> Table<'a> {
    /// Position of a field's value, if the table has one.
    fn place(&self, field: VOffsetT) -> Option<usize> {
        // The layout stands at a signed distance before (or after) the table.
        let distance = word(self.bytes, self.at)? as u32 as i32;
        let layout = usize::try_from(i64::try_from(self.at).ok()? - i64::from(distance)).ok()?;
        let entry = usize::from(slot(field));
        let known = half_word(self.bytes, layout)? >= entry + 2;
        let offset = if known { half_word(self.bytes, layout.checked_add(entry)?)? } else { 0 };
        if offset == 0 { None } else { self.at.checked_add(offset) }
    }

    /// Position that the offset in a field points to.
    fn target(&self, field: VOffsetT) -> Option<usize> {
        let place = self.place(field)?;
        place.checked_add(word(self.bytes, place)?)
    }

    fn byte(&self, field: VOffsetT) -> Option<u8> {
        self.bytes.get(self.place(field)?).copied()
    }

    /// Of the details of a duration: nanoseconds in a count.
    fn duration(&self) -> Option<i64> {
        let unit = self.place(0).map_or(Some(DURATION_DEFAULT), |place| half_word(self.bytes, place));
        DURATION_UNITS.get(unit?).copied()
    }

    fn table(&self, field: VOffsetT) -> Option<Table<'a>> {
        Some(Self { at: self.target(field)?, ..*self })
    }

    fn text(&self, field: VOffsetT) -> Option<&'a str> {
        let at = self.target(field)?;
        let begin = at.checked_add(4)?;
        std::str::from_utf8(self.bytes.get(begin..begin.checked_add(word(self.bytes, at)?)?)?).ok()
    }

    /// The tables of a vector, as many as the buffer has room for.
    fn tables(&self, field: VOffsetT) -> Vec<Table<'a>> {
        let Some(at) = self.target(field) else { return Vec::new() };
        let count = word(self.bytes, at).unwrap_or(0);
        let item = |i: usize| {
            let place = at.checked_add(4)?.checked_add(i.checked_mul(4)?)?;
            Some(Self { at: place.checked_add(word(self.bytes, place)?)?, ..*self })
        };
        (0..count).map_while(item).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<WriteColumn> {
        vec![
            WriteColumn::new("x", WriteKind::Float).with_unit("m"),
            WriteColumn::new("t", WriteKind::Stamp),
            WriteColumn::new("n", WriteKind::Integer).with_unit("1/s"),
            WriteColumn::new("on", WriteKind::Boolean),
            WriteColumn::new("mode", WriteKind::Text).with_unit(""),
        ]
    }

    fn with_unit(unit: &str) -> ArrowField {
        ArrowField { unit: Some(unit.to_owned()), duration: None }
    }

    #[test]
    fn units_come_back_by_name() {
        let units = fields(&encode(&columns()));
        let expected = [("x", "m"), ("n", "1/s"), ("mode", "")];
        assert_eq!(units, expected.into_iter().map(|(name, unit)| (vec![name.to_owned()], with_unit(unit))).collect());
        assert!(fields(&encode(&[])).is_empty());
    }

    /// `{a: struct<v: double {units: m/s}>, l: list<v: double {unit: no}>}`, as pyarrow 26 writes it.
    #[test]
    fn fields_of_structs_have_units() {
        let text = include_str!("arrow_schema_nested.txt").trim();
        let expected = BTreeMap::from([(vec!["a".to_owned(), "v".to_owned()], with_unit("m/s"))]);
        assert_eq!(fields(text), expected);
    }

    /// `{s: duration[s], ms: duration[ms], a: struct<us: duration[us] {unit: us}>, ns: dictionary<duration[ns]>, i: int64}`, as pyarrow 26 writes it.
    #[test]
    fn durations_have_the_nanoseconds_of_a_count() {
        let units = fields(include_str!("arrow_schema_durations.txt").trim());
        let durations: Vec<_> = units.iter().map(|(path, field)| (path.join("."), field.duration.unwrap())).collect();
        let expected = [("a.us", 1_000), ("ms", 1_000_000), ("ns", 1), ("s", 1_000_000_000)];
        assert_eq!(durations, expected.map(|(path, count)| (path.to_owned(), count)));
        assert_eq!(units[&["a".to_owned(), "us".to_owned()][..]].unit.as_deref(), Some("us"));
    }

    #[test]
    fn changed_bytes_do_no_harm() {
        let durations = include_str!("arrow_schema_durations.txt").trim().to_owned();
        for text in [encode(&columns()), durations] {
            let bytes = BASE64_STANDARD.decode(text).unwrap();
            for at in 0..bytes.len() {
                for value in [0, 1, 4, 127, 128, 255, bytes[at] ^ 1] {
                    let mut damaged = bytes.clone();
                    damaged[at] = value;
                    assert!(fields(&BASE64_STANDARD.encode(&damaged)).len() <= 6);
                }
                fields(&BASE64_STANDARD.encode(&bytes[..at]));
            }
        }
        assert!(fields("no base64").is_empty());
    }
}

//! Leaf columns of a Parquet schema: conversion of their values to numbers, stamps or texts.

use std::collections::BTreeMap;

use fleetfoot_data::ColumnKind;
use fleetfoot_output::arrow_schema::ArrowField;
use parquet::{
    basic::{ConvertedType, LogicalType, TimeUnit as ParquetTimeUnit, Type as Physical},
    data_type::Int96,
    file::metadata::ParquetMetaData,
    schema::types::{ColumnDescriptor, SchemaDescriptor},
};

use crate::{TimeUnit, dates, stamp, table::MISSING};

/// Type of a leaf's values.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Meaning {
    /// Truth values.
    Boolean,
    /// Signed or unsigned whole numbers.
    Integer { unsigned: bool },
    /// Floats of 16, 32 or 64 bits.
    Float,
    /// Whole numbers over a power of ten.
    Decimal { scale: i32 },
    /// Time since 1970, of the day, or between two moments: so many nanoseconds a count. `of_day`: of the day.
    Time { nanoseconds: i64, of_day: bool },
    /// UTF-8.
    Text,
    /// Something that is no number; its type for the message.
    Unsupported(String),
}

/// A leaf of the schema.
#[derive(Debug, Clone)]
pub(super) struct Leaf {
    /// Its index among the leaves.
    pub index: usize,
    /// Its path, joined by dots.
    pub name: String,
    pub unit: Option<String>,
    pub meaning: Meaning,
    /// Of a column of lists: the element that this is, and elements of a row.
    pub element: Option<Element>,
}

/// An element of lists that all have as many.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Element {
    pub at: usize,
    pub width: usize,
}

/// Elements of lists that become columns at most.
const MAX_ELEMENTS: usize = 256;

/// Ends of the paths of lists, as writers name the groups in them.
const LIST_ENDS: [&str; 5] = [".list.element", ".list.item", ".array", ".bag.array_element", ".list.array"];

impl Leaf {
    /// The kind of column it becomes; categories still without names.
    pub(super) fn kind(&self) -> ColumnKind {
        match self.meaning {
            Meaning::Boolean => ColumnKind::Boolean,
            Meaning::Integer { .. } => ColumnKind::Integer,
            Meaning::Text => ColumnKind::Category(Vec::new()),
            _ => ColumnKind::Float,
        }
    }
}

/// All leaves, with what the Arrow schema tells of them by their paths.
pub(super) fn leaves(schema: &SchemaDescriptor, fields: &BTreeMap<Vec<String>, ArrowField>) -> Vec<Leaf> {
    (0..schema.num_columns())
        .map(|index| {
            let descriptor = schema.column(index);
            let field = fields.get(descriptor.path().parts()).cloned().unwrap_or_default();
            let (meaning, unit) = match (meaning(&descriptor), field.duration) {
                // Durations become seconds, whatever unit the file names for their counts.
                (Meaning::Integer { unsigned: false }, Some(nanoseconds)) => (
                    Meaning::Time { nanoseconds, of_day: false },
                    field.unit.map(|_| TimeUnit::Seconds.symbol().to_owned()),
                ),
                (meaning, _) => (meaning, field.unit),
            };
            Leaf { index, name: descriptor.path().string(), unit, meaning, element: None }
        })
        .collect()
}

/// The leaf of a list as a column for each element, where all row groups have a whole number of them for each row:
/// `position[0]`, `position[1]`.
pub(super) fn elements(leaf: Leaf, metadata: &ParquetMetaData) -> Vec<Leaf> {
    let descriptor = metadata.file_metadata().schema_descr().column(leaf.index);
    let inner = inner_meaning(&descriptor);
    let is_number =
        matches!(inner, Meaning::Boolean | Meaning::Integer { .. } | Meaning::Float | Meaning::Decimal { .. });
    let counts = || {
        let groups = metadata.row_groups().iter().filter(|group| group.num_rows() > 0);
        groups.map(|group| (group.columns().get(leaf.index).map_or(0, |chunk| chunk.num_values()), group.num_rows()))
    };
    let width = counts().next().map_or(0, |(values, rows)| usize::try_from(values / rows).unwrap_or(0));
    let is_even = || {
        counts()
            .all(|(values, rows)| i64::try_from(width).ok().and_then(|width| rows.checked_mul(width)) == Some(values))
    };
    if descriptor.max_rep_level() != 1 || !is_number || !(1..=MAX_ELEMENTS).contains(&width) || !is_even() {
        return vec![leaf];
    }
    let name = LIST_ENDS.iter().find_map(|end| leaf.name.strip_suffix(end)).unwrap_or(&leaf.name);
    let element = |at: usize| Leaf {
        name: format!("{name}[{at}]"),
        meaning: inner.clone(),
        element: Some(Element { at, width }),
        ..leaf.clone()
    };
    (0..width).map(element).collect()
}

fn meaning(descriptor: &ColumnDescriptor) -> Meaning {
    if descriptor.max_rep_level() > 0 { Meaning::Unsupported("list".into()) } else { inner_meaning(descriptor) }
}

fn inner_meaning(descriptor: &ColumnDescriptor) -> Meaning {
    let logical = descriptor.logical_type_ref();
    let converted = descriptor.converted_type();
    let decimal = || Meaning::Decimal { scale: descriptor.type_scale().max(0) };
    let is_decimal = matches!(logical, Some(LogicalType::Decimal(_))) || converted == ConvertedType::DECIMAL;
    match descriptor.physical_type() {
        Physical::BOOLEAN => Meaning::Boolean,
        Physical::FLOAT | Physical::DOUBLE => Meaning::Float,
        Physical::INT96 => Meaning::Time { nanoseconds: 1, of_day: false },
        Physical::INT32 | Physical::INT64 if is_decimal => decimal(),
        Physical::INT32 | Physical::INT64 => whole(logical, converted),
        Physical::BYTE_ARRAY | Physical::FIXED_LEN_BYTE_ARRAY if is_decimal => decimal(),
        Physical::BYTE_ARRAY => match (logical, converted) {
            (Some(LogicalType::String | LogicalType::Enum), _) | (None, ConvertedType::UTF8 | ConvertedType::ENUM) => {
                Meaning::Text
            }
            (Some(other), _) => Meaning::Unsupported(format!("{other:?}")),
            _ => Meaning::Unsupported("binary".into()),
        },
        Physical::FIXED_LEN_BYTE_ARRAY => match logical {
            Some(LogicalType::Float16) => Meaning::Float,
            _ => Meaning::Unsupported(format!("binary of {} bytes", descriptor.type_length())),
        },
    }
}

fn whole(logical: Option<&LogicalType>, converted: ConvertedType) -> Meaning {
    match logical {
        Some(LogicalType::Date) => Meaning::Time { nanoseconds: 86_400_000_000_000, of_day: false },
        Some(LogicalType::Timestamp(kind)) => Meaning::Time { nanoseconds: nanoseconds(&kind.unit), of_day: false },
        Some(LogicalType::Time(kind)) => Meaning::Time { nanoseconds: nanoseconds(&kind.unit), of_day: true },
        Some(LogicalType::Integer(kind)) => Meaning::Integer { unsigned: !kind.is_signed },
        _ => match converted {
            ConvertedType::DATE => Meaning::Time { nanoseconds: 86_400_000_000_000, of_day: false },
            ConvertedType::TIMESTAMP_MILLIS => Meaning::Time { nanoseconds: 1_000_000, of_day: false },
            ConvertedType::TIMESTAMP_MICROS => Meaning::Time { nanoseconds: 1_000, of_day: false },
            ConvertedType::TIME_MILLIS => Meaning::Time { nanoseconds: 1_000_000, of_day: true },
            ConvertedType::TIME_MICROS => Meaning::Time { nanoseconds: 1_000, of_day: true },
            ConvertedType::UINT_8 | ConvertedType::UINT_16 | ConvertedType::UINT_32 | ConvertedType::UINT_64 => {
                Meaning::Integer { unsigned: true }
            }
            _ => Meaning::Integer { unsigned: false },
        },
    }
}

fn nanoseconds(unit: &ParquetTimeUnit) -> i64 {
    match unit {
        ParquetTimeUnit::MILLIS => 1_000_000,
        ParquetTimeUnit::MICROS => 1_000,
        ParquetTimeUnit::NANOS => 1,
    }
}

/// A value that a column is decoded into: `f64` for data, `i64` nanoseconds for stamps.
pub(super) trait Word: Copy + Send + 'static {
    /// Value that encodes null.
    const NONE: Self;
    fn to_bits(self) -> u64;
    fn from_bits(bits: u64) -> Self;
    /// The vector itself when this word is `f64`, so that doubles are decoded without another copy.
    fn as_doubles(out: &mut Vec<Self>) -> Option<&mut Vec<f64>>;
    fn from_int(value: i64, rule: &Rule) -> Self;
    fn from_float(value: f64, rule: &Rule) -> Self;
    fn from_text(text: &[u8], rule: &Rule) -> Self;
}

/// Conversion of the values of one leaf.
#[derive(Debug, Clone)]
pub(super) struct Rule {
    pub meaning: Meaning,
    /// The unit of numeric stamps.
    pub unit: TimeUnit,
    /// The sorted texts of a category.
    pub names: Vec<String>,
    /// The element of lists.
    pub element: Option<usize>,
}

impl Rule {
    /// The conversion of a leaf, with the unit of its numbers if they are stamps.
    pub(super) fn new(leaf: &Leaf, unit: TimeUnit) -> Self {
        let element = leaf.element.map(|element| element.at);
        Self { meaning: leaf.meaning.clone(), unit, names: Vec::new(), element }
    }
}

impl Word for f64 {
    const NONE: Self = f64::NAN;

    fn to_bits(self) -> u64 {
        self.to_bits()
    }

    fn from_bits(bits: u64) -> Self {
        f64::from_bits(bits)
    }

    fn as_doubles(out: &mut Vec<Self>) -> Option<&mut Vec<f64>> {
        Some(out)
    }

    fn from_int(value: i64, rule: &Rule) -> Self {
        match rule.meaning {
            Meaning::Integer { unsigned: true } => value as u64 as f64,
            Meaning::Decimal { scale } => value as f64 / 10f64.powi(scale),
            // Seconds, split so that the fraction keeps its digits as far as f64 goes.
            Meaning::Time { nanoseconds, .. } => {
                let per_second = (1_000_000_000 / nanoseconds).max(1);
                let seconds = if nanoseconds > 1_000_000_000 { nanoseconds / 1_000_000_000 } else { 1 };
                (value / per_second) as f64 * seconds as f64 + (value % per_second) as f64 / per_second as f64
            }
            _ => value as f64,
        }
    }

    fn from_float(value: f64, _rule: &Rule) -> Self {
        value
    }

    fn from_text(text: &[u8], rule: &Rule) -> Self {
        rule.names.binary_search_by(|name| name.as_bytes().cmp(text)).map_or(f64::NAN, |code| code as f64)
    }
}

impl Word for i64 {
    const NONE: Self = MISSING;

    fn to_bits(self) -> u64 {
        self as u64
    }

    fn from_bits(bits: u64) -> Self {
        bits as i64
    }

    fn as_doubles(_out: &mut Vec<Self>) -> Option<&mut Vec<f64>> {
        None
    }

    fn from_int(value: i64, rule: &Rule) -> Self {
        match rule.meaning {
            Meaning::Time { nanoseconds, .. } => value.checked_mul(nanoseconds).unwrap_or(MISSING),
            Meaning::Integer { unsigned: true } if value < 0 => MISSING,
            Meaning::Decimal { scale } => {
                stamp::parse_decimal(format!("{value}e-{scale}").as_bytes(), rule.unit).unwrap_or(MISSING)
            }
            _ => stamp::from_i64(value, rule.unit),
        }
    }

    fn from_float(value: f64, rule: &Rule) -> Self {
        stamp::from_f64(value, rule.unit)
    }

    fn from_text(text: &[u8], rule: &Rule) -> Self {
        let text = text.trim_ascii();
        dates::parse_certain(text).or_else(|| stamp::parse_decimal(text, rule.unit)).unwrap_or(MISSING)
    }
}

/// Nanoseconds since 1970 of the legacy 96-bit time: nanoseconds of the day, and a Julian day.
pub(super) fn int96_nanoseconds(value: &Int96) -> i64 {
    let [low, high, day] = value.data() else {
        return MISSING;
    };
    let of_day = i128::from(u64::from(*high) << 32 | u64::from(*low));
    let total = (i128::from(*day) - 2_440_588) * 86_400_000_000_000 + of_day;
    i64::try_from(total).unwrap_or(MISSING)
}

/// A big-endian two's complement decimal of up to 16 bytes (256-bit ones keep their leading digits as `f64`).
pub(super) fn decimal_bytes(bytes: &[u8], scale: i32) -> f64 {
    let negative = bytes.first().is_some_and(|&first| first & 0x80 != 0);
    let mut value = if negative { -1.0f64 } else { 0.0 };
    if bytes.len() <= 16 {
        let exact = bytes.iter().fold(if negative { -1i128 } else { 0 }, |value, &byte| value << 8 | i128::from(byte));
        return exact as f64 / 10f64.powi(scale);
    }
    for &byte in bytes {
        value = value * 256.0 + f64::from(byte);
    }
    value / 10f64.powi(scale)
}

/// IEEE 754 half precision, little-endian.
pub(super) fn half(bytes: &[u8]) -> f64 {
    let &[low, high] = bytes else { return f64::NAN };
    let bits = u16::from_le_bytes([low, high]);
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 0x3ff));
    let magnitude = match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use parquet::schema::parser::parse_message_type;

    use super::*;

    #[test]
    fn halves() {
        for (bits, value) in [
            (0x3c00u16, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333251953125),
            (0x0001, 5.960464477539063e-8),
            (0x7bff, 65504.0),
            (0x7c00, f64::INFINITY),
        ] {
            assert_eq!(half(&bits.to_le_bytes()), value);
        }
        assert!(half(&0x7e00u16.to_le_bytes()).is_nan());
    }

    #[test]
    fn durations_are_converted_to_seconds() {
        let schema = parse_message_type("message schema { optional int64 d; optional int64 n; }").unwrap();
        let field = |duration| ArrowField { unit: Some("us".into()), duration };
        let fields = BTreeMap::from([(vec!["d".into()], field(Some(1_000))), (vec!["n".into()], field(None))]);
        let leaves = leaves(&SchemaDescriptor::new(schema.into()), &fields);
        assert_eq!(leaves[0].meaning, Meaning::Time { nanoseconds: 1_000, of_day: false });
        let units: Vec<_> = leaves.iter().map(|leaf| leaf.unit.as_deref()).collect();
        assert_eq!(units, [Some("s"), Some("us")]);
    }

    #[test]
    fn decimals_of_any_width() {
        assert_eq!(decimal_bytes(&[0x04, 0xd2], 2), 12.34);
        assert_eq!(decimal_bytes(&[0xfb, 0x2e], 2), -12.34);
        let mut wide = [0u8; 20];
        wide[18..].copy_from_slice(&[0x04, 0xd2]);
        assert_eq!(decimal_bytes(&wide, 2), 12.34);
        let wide_negative: Vec<u8> = std::iter::repeat_n(0xff, 18).chain([0xfb, 0x2e]).collect();
        assert_eq!(decimal_bytes(&wide_negative, 2), -12.34);
    }

    #[test]
    fn times_as_seconds_and_as_stamps() {
        let rule = |nanoseconds| Rule {
            meaning: Meaning::Time { nanoseconds, of_day: false },
            unit: TimeUnit::Seconds,
            names: Vec::new(),
            element: None,
        };
        assert_eq!(f64::from_int(1_500, &rule(1_000_000)), 1.5);
        assert_eq!(f64::from_int(2, &rule(86_400_000_000_000)), 172_800.0);
        assert_eq!(i64::from_int(1_500, &rule(1_000_000)), 1_500_000_000);
        assert_eq!(i64::from_int(i64::MAX, &rule(1_000)), MISSING);
        let mut epoch = Int96::new();
        epoch.set_data(5, 0, 2_440_589);
        assert_eq!(int96_nanoseconds(&epoch), 86_400_000_000_005);
    }
}

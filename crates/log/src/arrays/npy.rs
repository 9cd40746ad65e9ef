//! NumPy's `.npy`: a head with type, order and dimensions, and the elements.

use std::{path::Path, sync::Arc};

use super::{
    columns::{Array, Element, Field, strides},
    literal::Literal,
    number::{Kind, Number},
    table::ArrayTable,
};
use crate::{Error, TimeUnit, container::Map};

/// First bytes of a file; the version follows.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// Structs inside each other.
const MAX_DEPTH: usize = 32;

/// The table of a file.
///
/// # Errors
/// A head that cannot be understood, an array without rows.
pub(super) fn table(path: &Path, map: Arc<Map>) -> Result<ArrayTable, Error> {
    let wrong = |problem: String, mend| Error::WrongFormat { path: path.into(), problem, mend };
    let length = map.len();
    let array = array(String::new(), map, 0..length)
        .map_err(|problem| wrong(problem, "save it again with numpy.save, as an array of numbers"))?;
    if array.shape.is_empty() {
        return Err(wrong("it holds one value, not rows".into(), "save an array whose first dimension is the rows"));
    }
    let mut notes = Vec::new();
    let rows = array.shape[0];
    let size = array.element.size();
    let have = if array.strides.first().copied().unwrap_or(0) >= size && is_c(&array) {
        rows_there(&array)
    } else if needed(&array).is_some_and(|needed| array.at.saturating_add(needed) <= array.bytes.len()) {
        rows
    } else {
        return Err(wrong("it ends before its array does, which lies column by column".into(), "copy it again"));
    };
    if have < rows {
        notes.push(format!("damaged: {have} of {rows} rows are there, the file is cut; the rest is used"));
    }
    ArrayTable::new(path, have.min(rows), &[(array, 0)], notes)
}

fn is_c(array: &Array) -> bool {
    strides(&array.shape, array.element.size(), false).as_ref() == Some(&array.strides)
}

/// Rows that are there of an array in the order of C.
fn rows_there(array: &Array) -> usize {
    let left = array.bytes.len().saturating_sub(array.at);
    let stride = array.strides.first().copied().unwrap_or(0);
    left.checked_div(stride).unwrap_or(0)
}

/// Bytes of all elements.
pub(super) fn needed(array: &Array) -> Option<usize> {
    array.shape.iter().try_fold(array.element.size(), |all, length| all.checked_mul(*length))
}

/// The array in some bytes, or why there is none. Whether its elements are there is not looked at.
pub(super) fn array(name: String, map: Arc<Map>, place: std::ops::Range<usize>) -> Result<Array, String> {
    let bytes = map.get(place.clone()).unwrap_or_default();
    let short = || "it ends inside its head".to_owned();
    let &[major, _] = bytes
        .strip_prefix(MAGIC)
        .ok_or_else(|| "it does not begin as an array of NumPy".to_owned())?
        .first_chunk::<2>()
        .ok_or_else(short)?;
    let (length, begin) = match major {
        1 => (
            bytes
                .get(8..10)
                .map(|bytes_there| bytes_there.iter().rev().fold(0, |all, &byte| all << 8 | usize::from(byte))),
            10,
        ),
        2 | 3 => (
            bytes
                .get(8..12)
                .map(|bytes_there| bytes_there.iter().rev().fold(0, |all, &byte| all << 8 | usize::from(byte))),
            12,
        ),
        _ => return Err(format!("the version {major} of its head is unknown")),
    };
    let head = length.and_then(|length: usize| bytes.get(begin..begin + length)).ok_or_else(short)?;
    let text: String = match std::str::from_utf8(head) {
        Ok(text) => text.to_owned(),
        Err(_) => head.iter().map(|&byte| char::from(byte)).collect(),
    };
    let strange = || "its head cannot be understood".to_owned();
    let head_of = Literal::parse(&text).ok_or_else(strange)?;
    let element = element(head_of.get("descr").ok_or_else(strange)?, 0).ok_or_else(strange)?;
    if let Element::Other { kind, .. } = &element
        && kind.contains('O')
    {
        return Err("it holds objects of Python, not numbers".to_owned());
    }
    let shape = head_of.get("shape").and_then(Literal::shape).ok_or_else(strange)?;
    let fortran = head_of.get("fortran_order") == Some(&Literal::Bool(true));
    let strides = strides(&shape, element.size(), fortran).ok_or_else(strange)?;
    Ok(Array { name, at: place.start + begin + head.len(), bytes: map, shape, strides, element })
}

/// The type of elements, from a text such as `<f8` or a list of fields.
fn element(of: &Literal, depth: usize) -> Option<Element> {
    match of {
        Literal::Text(text) => plain(text),
        Literal::Many(all) if depth < MAX_DEPTH => {
            let (mut fields, mut at) = (Vec::new(), 0_usize);
            for field in all {
                let parts = field.many()?;
                // A field may have a title before its name.
                let name = match parts.first()? {
                    Literal::Many(both) => both.last()?.text()?,
                    other => other.text()?,
                };
                let element = element(parts.get(1)?, depth + 1)?;
                let shape = match parts.get(2) {
                    Some(shape) => shape.shape()?,
                    None => Vec::new(),
                };
                let size = shape.iter().try_fold(element.size(), |all, length| all.checked_mul(*length))?;
                // Without a name it fills up the bytes between two others.
                if !name.is_empty() {
                    fields.push(Field { name: name.to_owned(), at, element, shape });
                }
                at = at.checked_add(size)?;
            }
            Some(Element::Struct { fields, size: at })
        }
        _ => None,
    }
}

fn plain(text: &str) -> Option<Element> {
    let (order, rest) = match text.chars().next()? {
        order @ ('<' | '>' | '|' | '=') => (order, text.get(1..)?),
        _ => ('<', text),
    };
    let big = order == '>';
    let (letter, digits) = rest.split_at_checked(1)?;
    let (digits, unit) = digits.split_once('[').map_or((digits, None), |(digits, unit)| (digits, Some(unit)));
    let size: usize = if digits.is_empty() && letter == "O" { 8 } else { digits.parse().ok()? };
    let number = |kind| Some(Element::Number(Number { kind, big, real: false }));
    match (letter, size) {
        ("b", 1) => number(Kind::Bool),
        ("i", 1) => number(Kind::I8),
        ("u", 1) => number(Kind::U8),
        ("i", 2) => number(Kind::I16),
        ("u", 2) => number(Kind::U16),
        ("i", 4) => number(Kind::I32),
        ("u", 4) => number(Kind::U32),
        ("i", 8) => number(Kind::I64),
        ("u", 8) => number(Kind::U64),
        ("f", 2) => number(Kind::F16),
        ("f", 4) => number(Kind::F32),
        ("f", 8) => number(Kind::F64),
        ("S" | "a", _) => Some(Element::Text { size, wide: false, big }),
        ("U", _) => Some(Element::Text { size: size.checked_mul(4)?, wide: true, big }),
        ("M" | "m", 8) => {
            let (unit, factor) = time_unit(unit?.strip_suffix(']')?)?;
            Some(Element::Time { number: Number { kind: Kind::I64, big, real: false }, factor, unit })
        }
        _ => Some(Element::Other { kind: text.to_owned(), size }),
    }
}

/// A unit of times, such as `ns`, `10ms` or `D`.
fn time_unit(text: &str) -> Option<(TimeUnit, i64)> {
    let end = text.find(|sign: char| !sign.is_ascii_digit())?;
    let (count, unit) = text.split_at_checked(end)?;
    let count: i64 = if count.is_empty() { 1 } else { count.parse().ok()? };
    let (unit, factor) = match unit {
        "ns" => (TimeUnit::Nanoseconds, 1),
        "us" => (TimeUnit::Microseconds, 1),
        "ms" => (TimeUnit::Milliseconds, 1),
        "s" => (TimeUnit::Seconds, 1),
        "m" => (TimeUnit::Seconds, 60),
        "h" => (TimeUnit::Seconds, 3600),
        "D" => (TimeUnit::Seconds, 86_400),
        "W" => (TimeUnit::Seconds, 7 * 86_400),
        _ => return None,
    };
    Some((unit, count.checked_mul(factor)?))
}

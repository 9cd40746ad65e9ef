//! MATLAB's `.mat` of version 5 (`save -v6` and `-v7`): variables as tagged elements, packed by zlib or not.

use std::{path::Path, sync::Arc};

use super::{
    columns::{Array, Element, strides},
    npz::inflated,
    number::{Kind, Number},
    table::{ArrayTable, common, left_out},
};
use crate::{Error, container::Map};

/// First bytes of a file.
pub(super) const MAGIC: &[u8] = b"MATLAB 5.0";

/// First bytes of files of `save -v7.3`, with and without MATLAB's head.
pub(super) const HDF5: (&[u8], &[u8]) = (b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n");

/// Bytes of a file's head.
const HEADER: usize = 128;

/// Structs inside each other.
const MAX_DEPTH: usize = 32;

/// Bytes that a file may unpack to, whatever its size; beyond, how many times its size.
const FREE_GROWTH: u64 = 1 << 30;
const MAX_RATIO: u64 = 1000;

/// Kinds of elements.
const MATRIX: u32 = 14;
const PACKED: u32 = 15;

/// Classes of variables that are no numbers.
const CELL: u8 = 1;
const STRUCT: u8 = 2;
const CHAR: u8 = 4;
const SPARSE: u8 = 5;

/// Classes of real numbers, however they are stored.
const DOUBLE: u8 = 6;
const SINGLE: u8 = 7;

/// Flags of variables.
const COMPLEX: u8 = 8;
const LOGICAL: u8 = 2;

/// The refusal of a file that is HDF5.
pub(super) fn refused(path: &Path) -> Error {
    Error::WrongFormat {
        path: path.into(),
        problem: "a .mat of version 7.3 is HDF5, which only Python reads".into(),
        mend: "save it in MATLAB with '-v7', or open it in Python, as `ff.open(\"run.mat\")` with h5py",
    }
}

/// Content of a file: variables that are arrays of numbers, and those left out.
#[derive(Default)]
struct Content {
    arrays: Vec<Array>,
    others: Vec<String>,
    damaged: Vec<String>,
}

/// The table of a file: the arrays of the most common number of rows.
///
/// # Errors
/// A file without arrays that are rows.
pub(super) fn table(path: &Path, map: Arc<Map>) -> Result<ArrayTable, Error> {
    let big = map.get(126..HEADER) == Some(b"MI");
    let mut left = FREE_GROWTH.max((map.len() as u64).saturating_mul(MAX_RATIO));
    let mut content = Content::default();
    let mut elements = Elements { bytes: &map, at: HEADER, limit: map.len(), big };
    let mut cut = None;
    while elements.at < map.len() {
        let begin = elements.at;
        match elements.next() {
            Some(element) if element.kind == MATRIX => content.variable(&map, elements.inside(element), None, 0),
            Some(element) if element.kind == PACKED => {
                let unpacked = inflated(flate2::read::ZlibDecoder::new(elements.data(element)), left);
                left = left.saturating_sub(unpacked.as_ref().map_or(0, |(inner_bytes, _)| inner_bytes.len() as u64));
                if left == 0 {
                    let problem = "it unpacks to more than a thousand times its size".into();
                    return Err(Error::WrongFormat { path: path.into(), problem, mend: "save it again" });
                }
                let inner_bytes = unpacked.map(|(inner_bytes, _)| Arc::new(inner_bytes));
                let inner = inner_bytes.as_ref().and_then(|inner_bytes| {
                    let mut all = Elements { bytes: inner_bytes, at: 0, limit: inner_bytes.len(), big };
                    all.next().filter(|inner| inner.kind == MATRIX).map(|inner| (inner_bytes, all.inside(inner)))
                });
                match inner {
                    Some((inner_bytes, inner)) => content.variable(inner_bytes, inner, None, 0),
                    None => content.damaged.push(format!("a variable at byte {begin}")),
                }
            }
            Some(_) => {}
            None => {
                cut = Some(begin);
                break;
            }
        }
    }
    content.table(path, cut)
}

impl Content {
    fn table(self, path: &Path, cut: Option<usize>) -> Result<ArrayTable, Error> {
        let Self { arrays, others, damaged } = self;
        let vector = |array: &Array| {
            let mut long = array.shape.iter().filter(|&&length| length != 1);
            match (long.next(), long.next()) {
                (None, _) => Some(1),
                (Some(&length), None) => Some(length),
                _ => None,
            }
        };
        let longest = |array: &Array| array.shape.iter().copied().max().unwrap_or(0);
        // Scalars are settings: where there are no vectors the matrices have the rows.
        let rows = common(arrays.iter().filter_map(vector).filter(|&length| length != 1))
            .or_else(|| common(arrays.iter().map(longest)))
            .unwrap_or(0);
        let (mut columns, mut other_lengths) = (Vec::new(), Vec::new());
        for array in arrays {
            match array.shape.iter().position(|&length| length == rows) {
                Some(axis) => columns.push((array, axis)),
                None => other_lengths.push(format!("{} ({})", array.name, array.dimensions())),
            }
        }
        let mut notes = Vec::new();
        notes.extend(
            cut.map(|at| format!("damaged: the file is cut or damaged at byte {at}; what stands before is used")),
        );
        notes.extend(left_out(&damaged, "they are damaged"));
        notes.extend(left_out(&others, "they are not arrays of numbers"));
        notes.extend(left_out(&other_lengths, &format!("they do not have {rows} rows")));
        ArrayTable::new(path, rows, &columns, notes)
    }

    /// Adds the variable in some elements; `path`: that of a field of a struct, which has no other name.
    fn variable(&mut self, map: &Arc<Map>, mut elements: Elements<'_>, path: Option<String>, depth: usize) {
        let (flags, dimensions, name) = (elements.next(), elements.next(), elements.next());
        let (Some(flags), Some(dimensions), Some(name)) = (flags, dimensions, name) else {
            return self.damaged.push(path.unwrap_or_else(|| format!("a variable at byte {}", elements.at)));
        };
        let name = path.unwrap_or_else(|| String::from_utf8_lossy(elements.data(name)).into_owned());
        let word = elements.word(flags.begin);
        let (class, flags) = (word as u8, (word >> 8) as u8);
        let shape: Vec<usize> =
            (0..dimensions.size / 4).map(|place| elements.word(dimensions.begin + 4 * place) as usize).collect();
        match class {
            STRUCT if shape.iter().any(|&length| length != 1) => {
                self.others.push(format!("{name} (an array of structs)"));
            }
            STRUCT if depth < MAX_DEPTH => self.structure(map, elements, &name, depth),
            6..=15 if flags & COMPLEX != 0 => self.others.push(format!("{name} (complex numbers)")),
            6..=15 => match numbers(map, elements, &name, shape, class, flags) {
                Some(array) => self.arrays.push(array),
                None => self.damaged.push(name),
            },
            _ => {
                let what = match class {
                    CELL => "a cell array",
                    CHAR => "a text",
                    SPARSE => "sparse",
                    // Tables, timetables and datetimes are objects, whose form is not public.
                    _ => "an object of MATLAB",
                };
                self.others.push(format!("{name} ({what})"));
            }
        }
    }

    /// Adds the fields of a struct by their paths.
    fn structure(&mut self, map: &Arc<Map>, mut elements: Elements<'_>, name: &str, depth: usize) {
        let (Some(length), Some(names)) = (elements.next(), elements.next()) else {
            return self.damaged.push(name.to_owned());
        };
        let length = elements.word(length.begin) as usize;
        for field in elements.data(names).chunks(length.max(1)) {
            let end = field.iter().position(|&byte| byte == 0).unwrap_or(field.len());
            let path = format!("{name}.{}", String::from_utf8_lossy(field.get(..end).unwrap_or_default()));
            match elements.next() {
                // An empty field.
                Some(tag) if tag.kind == MATRIX && tag.size == 0 => {}
                Some(tag) if tag.kind == MATRIX => self.variable(map, elements.inside(tag), Some(path), depth + 1),
                _ => return self.damaged.push(path),
            }
        }
    }
}

/// The array of a variable's numbers; `None` where they are damaged.
fn numbers(
    map: &Arc<Map>,
    mut elements: Elements<'_>,
    name: &str,
    shape: Vec<usize>,
    class: u8,
    flags: u8,
) -> Option<Array> {
    let data = elements.next()?;
    // Numbers are stored as small as they fit.
    let kind = match data.kind {
        1 => Kind::I8,
        2 if flags & LOGICAL != 0 => Kind::Bool,
        2 => Kind::U8,
        3 => Kind::I16,
        4 => Kind::U16,
        5 => Kind::I32,
        6 => Kind::U32,
        7 => Kind::F32,
        9 => Kind::F64,
        12 => Kind::I64,
        13 => Kind::U64,
        _ => return None,
    };
    let real = kind != Kind::Bool && matches!(class, DOUBLE | SINGLE);
    let number = Number { kind, big: elements.big, real };
    let needed = shape.iter().try_fold(number.size(), |all, &length| all.checked_mul(length))?;
    let strides = strides(&shape, number.size(), true)?;
    let element = Element::Number(number);
    let array = Array { name: name.to_owned(), bytes: map.clone(), at: data.begin, shape, strides, element };
    (needed <= data.size).then_some(array)
}

/// Elements one after the other.
#[derive(Debug, Clone, Copy)]
struct Elements<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Offset of their end.
    limit: usize,
    big: bool,
}

impl<'a> Elements<'a> {
    /// The next element; `None` where it would end behind the others, or nothing is left.
    fn next(&mut self) -> Option<Tagged> {
        let at = self.at;
        if at.checked_add(8)? > self.limit {
            return None;
        }
        let word = self.word(at);
        let tag = match word >> 16 {
            0 => {
                let (size, begin) = (self.word(at + 4) as usize, at + 8);
                // Packed elements are not filled up to eight bytes.
                let filled = if word == PACKED { size } else { size.checked_next_multiple_of(8)? };
                Tagged { kind: word, begin, size, end: begin.checked_add(filled)? }
            }
            // Up to four bytes of data stand in the tag itself.
            size => Tagged { kind: word & 0xffff, begin: at + 4, size: (size as usize).min(4), end: at + 8 },
        };
        let end = tag.begin.checked_add(tag.size)?;
        self.at = tag.end;
        (end <= self.limit).then_some(tag)
    }

    /// The elements that an element holds.
    fn inside(&self, tag: Tagged) -> Self {
        Self { at: tag.begin, limit: tag.begin + tag.size, ..*self }
    }

    fn data(&self, tag: Tagged) -> &'a [u8] {
        self.bytes.get(tag.begin..tag.begin + tag.size).unwrap_or_default()
    }

    fn word(&self, at: usize) -> u32 {
        let bytes: [u8; 4] =
            self.bytes.get(at..).and_then(|bytes_there| bytes_there.first_chunk()).copied().unwrap_or_default();
        if self.big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }
}

/// An element: its kind and where its data are.
#[derive(Debug, Clone, Copy)]
struct Tagged {
    kind: u32,
    begin: usize,
    size: usize,
    /// The place of the next one.
    end: usize,
}

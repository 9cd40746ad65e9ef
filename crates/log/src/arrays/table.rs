//! Arrays of one length as a table in memory.

use std::{collections::HashMap, ops::Range, path::Path, sync::OnceLock};

use fleetfoot_data::{Column, ColumnKind, ScalarBuffer};

use super::columns::{Array, Element, MAX_COLUMNS, Part};
use crate::{
    Error, MemoryTable, TimeUnit,
    table::{MAX_CATEGORIES, MISSING},
};

/// Names that a note lists.
const LISTED: usize = 8;

/// Rows of a text column that are looked at together.
const ROWS: usize = 4096;

/// A table whose columns are arrays.
#[derive(Debug)]
pub(super) struct ArrayTable {
    name: String,
    rows: usize,
    parts: Vec<Part>,
    columns: Vec<Column>,
    notes: Vec<String>,
    /// For each column of texts its texts and their codes.
    texts: Vec<OnceLock<Texts>>,
}

/// Different texts, in the order of their first rows; `None` where there are too many.
type Texts = Option<(Vec<String>, HashMap<String, u32>)>;

impl ArrayTable {
    /// A table of arrays, each with the dimension that counts the rows. Every array has at least so many rows.
    ///
    /// # Errors
    /// A file without rows or columns, one with too many columns, and arrays that end behind their bytes.
    pub(super) fn new(path: &Path, rows: usize, arrays: &[(Array, usize)], notes: Vec<String>) -> Result<Self, Error> {
        let wrong = |problem: String, mend| Error::WrongFormat { path: path.into(), problem, mend };
        let mut parts = Vec::new();
        if !arrays.iter().all(|(array, axis)| array.parts(*axis, &mut parts)) {
            let problem = format!("its arrays have more than {MAX_COLUMNS} values a row");
            return Err(wrong(problem, "the first dimension is the rows: save the transposed array, or fewer columns"));
        }
        if rows == 0 || parts.is_empty() {
            return Err(Error::NoRows { path: path.into() });
        }
        for part in &parts {
            let last = part.stride.checked_mul(rows - 1).and_then(|last| part.at.checked_add(last));
            let end = last.and_then(|last| last.checked_add(part.element.size()));
            if end.is_none_or(|end| end > part.bytes.len()) {
                return Err(wrong(format!("it ends before `{}` does", part.name), "copy it again"));
            }
        }
        let columns = parts.iter().map(|part| {
            let kind = match &part.element {
                Element::Number(number) if number.is_whole() => ColumnKind::Integer,
                Element::Number(number) if number.kind == super::number::Kind::Bool => ColumnKind::Boolean,
                Element::Time { .. } => ColumnKind::Integer,
                Element::Text { .. } => ColumnKind::Category(Vec::new()),
                _ => ColumnKind::Float,
            };
            Column { name: part.name.clone(), unit: None, kind }
        });
        let columns = columns.collect();
        let texts = parts.iter().map(|_| OnceLock::new()).collect();
        Ok(Self { name: path.to_string_lossy().into_owned(), rows, parts, columns, notes, texts })
    }

    /// Notes on the file.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// For each column, why it cannot be read, if so.
    pub(super) fn problems(&self) -> impl Iterator<Item = Result<(), String>> + '_ {
        self.parts.iter().map(|part| match &part.element {
            Element::Other { kind, .. } => Err(kind.clone()),
            _ => Ok(()),
        })
    }

    /// The texts of a column.
    fn texts(&self, column: usize) -> Option<&(Vec<String>, HashMap<String, u32>)> {
        let texts = self.texts.get(column)?.get_or_init(|| {
            let (mut names, mut codes) = (Vec::new(), HashMap::new());
            for from in (0..self.rows).step_by(ROWS) {
                for row in from..(from + ROWS).min(self.rows) {
                    let text = self.text(column, row)?;
                    if !text.is_empty() && !codes.contains_key(&text) {
                        if names.len() >= MAX_CATEGORIES {
                            return None;
                        }
                        codes.insert(text.clone(), names.len() as u32);
                        names.push(text);
                    }
                }
            }
            Some((names, codes))
        });
        texts.as_ref()
    }

    /// A text without the zeros at its end; empty texts are missing ones.
    fn text(&self, column: usize, row: usize) -> Option<String> {
        let part = self.parts.get(column)?;
        let Element::Text { size, wide, big } = part.element else { return None };
        let at = part.at + part.stride * row;
        let bytes = part.bytes.get(at..at + size)?;
        let text: String = match wide {
            true => {
                let (units, _) = bytes.as_chunks::<4>();
                let sign = |unit: &[u8; 4]| if big { u32::from_be_bytes(*unit) } else { u32::from_le_bytes(*unit) };
                units.iter().map(|unit| char::from_u32(sign(unit)).unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
            }
            false => String::from_utf8_lossy(bytes).into_owned(),
        };
        Some(text.trim_end_matches('\0').to_owned())
    }
}

/// A note about arrays that are no columns, with why.
pub(super) fn left_out(names: &[String], why: &str) -> Option<String> {
    let more = names.len().saturating_sub(LISTED);
    let listed = names.iter().take(LISTED).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!names.is_empty()).then(|| format!("left out, because {why}: {listed}{more}"))
}

/// The number of rows that most arrays have; of several the largest.
pub(super) fn common(lengths: impl Iterator<Item = usize>) -> Option<usize> {
    let mut counts: HashMap<usize, usize> = HashMap::new();
    lengths.for_each(|length| *counts.entry(length).or_default() += 1);
    // One value is a setting, not a row, unless nothing else is there.
    let many = counts.keys().any(|&length| length > 1);
    let all = counts.into_iter().filter(|(length, _)| *length > usize::from(many));
    all.max_by_key(|&(length, count)| (count, length)).map(|(length, _)| length)
}

impl MemoryTable for ArrayTable {
    fn name(&self) -> &str {
        &self.name
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn selected(&self, column: usize) -> Result<Column, Error> {
        let path = || Path::new(&self.name).to_path_buf();
        let array = &self.columns[column];
        match &self.parts[column].element {
            Element::Other { kind, .. } => {
                Err(Error::UnsupportedColumn { path: path(), column: array.name.clone(), kind: kind.clone() })
            }
            Element::Text { .. } => {
                let many =
                    || Error::TooManyCategories { path: path(), column: array.name.clone(), limit: MAX_CATEGORIES };
                let (names, _) = self.texts(column).ok_or_else(many)?;
                Ok(Column { kind: ColumnKind::Category(names.clone()), ..array.clone() })
            }
            _ => Ok(array.clone()),
        }
    }

    fn time_unit(&self, column: usize) -> Option<TimeUnit> {
        match self.parts[column].element {
            Element::Time { unit, .. } => Some(unit),
            _ => None,
        }
    }

    fn values(&self, columns: &[usize], rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
        let of = |&column: &usize| {
            let part = &self.parts[column];
            let at = part.at + part.stride * rows.start;
            match &part.element {
                Element::Number(number) => number.values(&part.bytes, at, part.stride, rows.len()).into(),
                Element::Text { .. } => {
                    let codes = self.texts(column);
                    let code = |row| {
                        let text = self.text(column, row)?;
                        codes?.1.get(&text).copied()
                    };
                    rows.clone().map(|row| code(row).map_or(f64::NAN, f64::from)).collect::<Vec<_>>().into()
                }
                Element::Time { .. } => {
                    let all = self.integers(column, rows.clone()).unwrap_or_else(|| Vec::new().into());
                    let value = |&value: &i64| if value == MISSING { f64::NAN } else { value as f64 };
                    all.iter().map(value).collect::<Vec<_>>().into()
                }
                _ => vec![f64::NAN; rows.len()].into(),
            }
        };
        columns.iter().map(of).collect()
    }

    fn integers(&self, column: usize, rows: Range<usize>) -> Option<ScalarBuffer<i64>> {
        let part = self.parts.get(column)?;
        let at = part.at + part.stride * rows.start;
        match &part.element {
            Element::Number(number) if number.is_whole() => {
                Some(number.integers(&part.bytes, at, part.stride, rows.len()).into())
            }
            Element::Time { number, factor, .. } => {
                let all = number.integers(&part.bytes, at, part.stride, rows.len());
                let times = |value: i64| value.checked_mul(*factor).filter(|_| value != MISSING).unwrap_or(MISSING);
                Some(all.into_iter().map(times).collect::<Vec<_>>().into())
            }
            _ => None,
        }
    }
}

//! Marks: hashes over a few consecutive values of one field, by which rows are recognised again.

use std::{collections::BTreeSet, ops::Range, sync::Arc};

use crate::{Block, Column, ColumnKind, mix};

/// Consecutive values of a mark.
pub(crate) const VALUES: usize = 16;
/// Different values that it needs: a robot at rest has the same values in every log.
const DIFFERENT: usize = 8;
/// Places of an episode that are marked, spread evenly: an eighth of its rows, and 31 more, hold one of them.
const PLACES: usize = 9;
/// Marks of a field at a place. One alone may be chance: a counter has the same values wherever it starts from the same
/// number.
const AT_A_PLACE: usize = 2;
/// The odd factor of the rolling hash.
pub(crate) const FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;

/// Some consecutive values of a field.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Mark {
    /// The name of the field.
    pub field: Arc<str>,
    /// The first row.
    pub row: usize,
    /// The hash of the field's name and the values.
    pub hash: u64,
}

impl Mark {
    /// The rows of an episode of `rows` rows that are marked.
    pub fn places(rows: usize) -> Vec<Range<usize>> {
        let length = AT_A_PLACE * VALUES;
        if rows < PLACES * length {
            return (0..rows).step_by(length).map(|first| first..(first + length).min(rows)).collect();
        }
        (0..PLACES).map(|place| (rows - length) * place / (PLACES - 1)).map(|first| first..first + length).collect()
    }

    /// The rows that it is made of.
    pub fn rows(&self) -> Range<usize> {
        self.row..self.row + VALUES
    }

    /// The marks of some rows, which are core rows of a block, field by field. Codes of categories are not those of another log.
    pub fn of(columns: &[Column], block: &Block, rows: Range<usize>) -> Vec<Self> {
        let mut marks = Vec::new();
        let numbers = columns.iter().enumerate().filter(|(_, column)| !matches!(column.kind, ColumnKind::Category(_)));
        for (field, column) in numbers {
            let (key, name) = (name_key(&column.name), Arc::<str>::from(column.name.as_str()));
            let values = &block.core(field)[rows.start - block.first..rows.end - block.first];
            for (at, values) in values.chunks_exact(VALUES).take(AT_A_PLACE).enumerate() {
                if differ(values) {
                    marks.push(Self {
                        field: name.clone(),
                        row: rows.start + at * VALUES,
                        hash: mix(rolled(values) ^ key),
                    });
                }
            }
        }
        marks
    }
}

/// The name's part of a mark.
pub(crate) fn name_key(name: &str) -> u64 {
    name.bytes().fold(0, |key, byte| mix(key ^ u64::from(byte)))
}

/// The value's part of a mark. All NaN are one value.
pub(crate) fn value_key(value: f64) -> u64 {
    mix(if value.is_nan() { f64::NAN } else { value }.to_bits())
}

/// Returns true if enough of the values are numbers and differ from one another.
fn differ(values: &[f64]) -> bool {
    let numbers: BTreeSet<u64> = values.iter().filter(|value| value.is_finite()).map(|value| value.to_bits()).collect();
    numbers.len() >= DIFFERENT
}

/// The polynomial hash of some values.
fn rolled(values: &[f64]) -> u64 {
    values.iter().fold(0, |sum, &value| sum.wrapping_mul(FACTOR).wrapping_add(value_key(value)))
}

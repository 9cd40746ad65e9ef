//! Columns out of arrays: one an element of what a row holds.

use std::sync::Arc;

use super::number::Number;
use crate::{TimeUnit, container::Map};

/// Columns of one file; more only make it slow.
pub(super) const MAX_COLUMNS: usize = 1 << 16;

/// Type of an array's elements.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Element {
    Number(Number),
    /// Dates, times and durations: so many of a unit since 1970, or since the beginning.
    Time {
        number: Number,
        factor: i64,
        unit: TimeUnit,
    },
    /// A text of so many bytes, with zeros at the end; `wide`: four bytes a character.
    Text {
        size: usize,
        wide: bool,
        big: bool,
    },
    Struct {
        fields: Vec<Field>,
        size: usize,
    },
    /// An element that is not read: its type and its size in bytes.
    Other {
        kind: String,
        size: usize,
    },
}

/// A field of a struct.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) at: usize,
    pub(super) element: Element,
    /// Its own dimensions, in the order of C.
    pub(super) shape: Vec<usize>,
}

impl Element {
    pub(super) fn size(&self) -> usize {
        match self {
            Self::Number(number) | Self::Time { number, .. } => number.size(),
            Self::Text { size, .. } | Self::Struct { size, .. } | Self::Other { size, .. } => *size,
        }
    }
}

/// An array of a file.
#[derive(Debug, Clone)]
pub(super) struct Array {
    pub(super) name: String,
    pub(super) bytes: Arc<Map>,
    /// Offset of its first element.
    pub(super) at: usize,
    pub(super) shape: Vec<usize>,
    /// Bytes from one element to the next, by dimension.
    pub(super) strides: Vec<usize>,
    pub(super) element: Element,
}

/// Bytes from element to element: of arrays as C has them, or Fortran and MATLAB. `None` where they are beyond all.
pub(super) fn strides(shape: &[usize], size: usize, fortran: bool) -> Option<Vec<usize>> {
    let mut strides = vec![0; shape.len()];
    let mut next = size;
    let mut fill = |place: usize| {
        *strides.get_mut(place)? = next;
        next = next.checked_mul(*shape.get(place)?)?;
        Some(())
    };
    match fortran {
        true => (0..shape.len()).try_for_each(&mut fill)?,
        false => (0..shape.len()).rev().try_for_each(&mut fill)?,
    }
    Some(strides)
}

/// A column: its values lie at even distances.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) name: String,
    pub(super) bytes: Arc<Map>,
    pub(super) at: usize,
    pub(super) stride: usize,
    pub(super) element: Element,
}

impl Array {
    /// Its dimensions for people.
    pub(super) fn dimensions(&self) -> String {
        let all: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        if all.is_empty() { "one value".into() } else { all.join(" x ") }
    }

    /// Adds a column for each element of what a row holds, where the dimension `axis` counts the rows. Answers `false` where these are too many.
    pub(super) fn parts(&self, axis: usize, parts: &mut Vec<Part>) -> bool {
        let Some(&stride) = self.strides.get(axis) else { return true };
        let others: Vec<(usize, usize)> = (0..self.shape.len())
            .filter(|&place| place != axis && (self.shape[place] != 1 || self.name.is_empty()))
            .map(|place| (self.shape[place], self.strides[place]))
            .collect();
        // Columns of an array without a name are called as those of arrays in Python are.
        let is_plain = self.name.is_empty() && !matches!(self.element, Element::Struct { .. });
        let named = if is_plain && others.is_empty() { vec![(1, 0)] } else { others };
        let prefix = if self.name.is_empty() && !named.is_empty() { "x" } else { self.name.as_str() };
        each(&named, &mut |index, offset| {
            let name = match (self.name.is_empty(), index.split_first()) {
                (true, Some((first, rest))) => format!("{prefix}{first}{}", brackets(rest)),
                _ => format!("{prefix}{}", brackets(index)),
            };
            leaves(&name, self.at.saturating_add(offset), &self.element, &mut |name, at, element| {
                if parts.len() >= MAX_COLUMNS {
                    return false;
                }
                parts.push(Part { name, bytes: self.bytes.clone(), at, stride, element: element.clone() });
                true
            })
        })
    }
}

fn brackets(index: &[usize]) -> String {
    index.iter().map(|place| format!("[{place}]")).collect()
}

/// Calls for all places of some dimensions, with the offset of each; stops where the answer is `false`.
fn each(dimensions: &[(usize, usize)], call: &mut dyn FnMut(&[usize], usize) -> bool) -> bool {
    if dimensions.iter().any(|(length, _)| *length == 0) {
        return true;
    }
    let mut index = vec![0_usize; dimensions.len()];
    loop {
        let offset = index.iter().zip(dimensions).fold(0_usize, |all, (place, (_, stride))| {
            let stride: usize = *stride;
            all.saturating_add(stride.saturating_mul(*place))
        });
        if !call(&index, offset) {
            return false;
        }
        let mut place = dimensions.len();
        loop {
            let Some(before) = place.checked_sub(1) else { return true };
            place = before;
            index[place] += 1;
            if index[place] < dimensions[place].0 {
                break;
            }
            index[place] = 0;
        }
    }
}

/// The elements of an element that are columns.
fn leaves(name: &str, at: usize, element: &Element, call: &mut dyn FnMut(String, usize, &Element) -> bool) -> bool {
    let Element::Struct { fields, .. } = element else { return call(name.to_owned(), at, element) };
    fields.iter().all(|field| {
        let inside = if name.is_empty() { field.name.clone() } else { format!("{name}.{}", field.name) };
        let Some(strides) = strides(&field.shape, field.element.size(), false) else { return true };
        let dimensions: Vec<(usize, usize)> = field.shape.iter().copied().zip(strides).collect();
        each(&dimensions, &mut |index, offset| {
            let name = format!("{inside}{}", brackets(index));
            leaves(&name, at.saturating_add(field.at).saturating_add(offset), &field.element, call)
        })
    })
}

//! scipy's sparse rows (CSR) as a design: a block of rows is made dense when it is read, and never the whole.

use std::ops::Range;

use fleetfoot::{data::ScalarBuffer, sparse::dense::Nonzeros};
use pyo3::prelude::*;

use crate::{array::Array, error::Kind};

/// Numbers of columns that are checked at once.
const CHECKED: usize = 65_536;

/// A matrix in compressed rows, its values and the columns of these borrowed from numpy. Values at one place are added.
#[derive(Debug)]
pub(crate) struct SparseRows {
    columns: usize,
    /// Start of every row among the values, and the end of the last.
    starts: Vec<usize>,
    /// Column of every value.
    places: Array,
    values: Array,
}

impl SparseRows {
    /// Borrows a matrix of scipy's in compressed rows; `None` for any other object.
    pub(crate) fn of(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Option<Self>> {
        let format = object.getattr_opt("format")?.and_then(|format| format.extract::<String>().ok());
        if format.as_deref() != Some("csr") {
            return Ok(None);
        }
        let part = |name: &str| Array::of(&object.getattr(name)?, what);
        let (_, columns): (usize, usize) = object.getattr("shape")?.extract()?;
        let (starts, places, values) = (part("indptr")?, part("indices")?, part("data")?);
        let broken = |how: &str| Kind::Data.error(format!("{what} is not a valid sparse matrix: {how}"));
        let starts = starts.integers(0, 0..starts.rows()).unwrap_or_default();
        let starts: Option<Vec<usize>> = starts.into_iter().map(|start| usize::try_from(start).ok()).collect();
        let starts = starts.ok_or_else(|| broken("a row begins before the first value"))?;
        let held = places.rows().min(values.rows());
        if starts.first() != Some(&0) || !starts.is_sorted() || starts.last().is_some_and(|&end| end > held) {
            return Err(broken("its rows do not follow each other within the values"));
        }
        let sparse_rows = Self { columns, starts, places, values };
        match sparse_rows.beyond() {
            Some(column) => Err(broken(&format!("column {column} of {columns}"))),
            None => Ok(Some(sparse_rows)),
        }
    }

    /// A column that does not exist.
    fn beyond(&self) -> Option<i64> {
        let held = self.starts[self.starts.len() - 1];
        let parts = (0..held).step_by(CHECKED).map(|first| first..(first + CHECKED).min(held));
        let mut places = parts.flat_map(|part| self.places.integers(0, part).unwrap_or_default());
        places.find(|&place| usize::try_from(place).map_or(true, |place| place >= self.columns))
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of columns.
    pub(crate) fn columns(&self) -> usize {
        self.columns
    }

    /// Share of its values that are held.
    pub(crate) fn density(&self) -> f64 {
        let cells = self.rows() as f64 * self.columns as f64;
        if cells > 0.0 { self.starts[self.rows()] as f64 / cells } else { 1.0 }
    }

    /// The values of some neighbouring rows that are held, by column within a row, those at one place added.
    pub(crate) fn nonzeros(&self, rows: Range<usize>) -> Nonzeros {
        let held = self.starts[rows.start]..self.starts[rows.end];
        let places = self.places.integers(0, held.clone()).unwrap_or_default();
        let values = self.values.values(&[0], held.clone()).into_iter().next().unwrap_or_default();
        let mut nonzero_list = Nonzeros { starts: vec![0], ..Nonzeros::default() };
        let mut row: Vec<(u32, f64)> = Vec::new();
        for ends in self.starts[rows.start..=rows.end].windows(2) {
            row.clear();
            // That columns fit was checked.
            row.extend((ends[0] - held.start..ends[1] - held.start).map(|at| (places[at] as u32, values[at])));
            if !row.is_sorted_by_key(|(column, _)| *column) {
                row.sort_by_key(|(column, _)| *column);
            }
            for part in row.chunk_by(|a, b| a.0 == b.0) {
                nonzero_list.columns.push(part[0].0);
                nonzero_list.values.push(part.iter().map(|(_, value)| value).sum());
            }
            nonzero_list.starts.push(nonzero_list.columns.len());
        }
        nonzero_list
    }

    /// Appends some neighbouring rows to `out`, column after column.
    pub(crate) fn read(&self, rows: Range<usize>, out: &mut Vec<f64>) {
        let (first, count) = (out.len(), rows.len());
        out.resize(first + count * self.columns, 0.0);
        let held = self.starts[rows.start]..self.starts[rows.end];
        let places = self.places.integers(0, held.clone()).unwrap_or_default();
        let values: ScalarBuffer<f64> = match self.values.values(&[0], held.clone()).into_iter().next() {
            Some(values) => values,
            None => return,
        };
        for (row, ends) in self.starts[rows.start..=rows.end].windows(2).enumerate() {
            for at in ends[0] - held.start..ends[1] - held.start {
                out[first + places[at] as usize * count + row] += values[at];
            }
        }
    }
}

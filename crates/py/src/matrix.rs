//! X as Python gives it: an array of any order and type of number, or scipy's compressed rows.

use std::ops::Range;

use fleetfoot::{data::ScalarBuffer, pwa::KMeansRows};
use pyo3::prelude::*;

use crate::{array::Array, sparse_array::SparseRows};

/// Rows of numbers, borrowed from Python.
#[derive(Debug)]
pub(crate) enum Matrix {
    Dense(Array),
    Sparse(SparseRows),
}

impl Matrix {
    /// Borrows a matrix; `what` is the argument's name.
    pub(crate) fn of(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Self> {
        Ok(match SparseRows::of(object, what)? {
            Some(sparse) => Self::Sparse(sparse),
            None => Self::Dense(Array::of(object, what)?),
        })
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        match self {
            Self::Dense(array) => array.rows(),
            Self::Sparse(rows) => rows.rows(),
        }
    }

    /// Number of columns.
    pub(crate) fn columns(&self) -> usize {
        match self {
            Self::Dense(array) => array.columns(),
            Self::Sparse(rows) => rows.columns(),
        }
    }

    /// The columns of some neighbouring rows.
    fn values(&self, rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
        match self {
            Self::Dense(array) => array.values(&(0..array.columns()).collect::<Vec<_>>(), rows),
            Self::Sparse(sparse) => {
                let mut values = Vec::new();
                sparse.read(rows.clone(), &mut values);
                let values = ScalarBuffer::from(values);
                (0..sparse.columns()).map(|column| values.slice(column * rows.len(), rows.len())).collect()
            }
        }
    }

    /// Appends some neighbouring rows to `out`, column after column.
    pub(crate) fn read(&self, rows: Range<usize>, out: &mut Vec<f64>) {
        match self {
            Self::Dense(_) => self.values(rows).iter().for_each(|values| out.extend_from_slice(values)),
            Self::Sparse(sparse) => sparse.read(rows, out),
        }
    }

    /// Appends some neighbouring columns of some neighbouring rows to `out`, column after column.
    pub(crate) fn read_columns(&self, columns: Range<usize>, rows: Range<usize>, out: &mut Vec<f64>) {
        match self {
            Self::Dense(array) => {
                let columns: Vec<usize> = columns.collect();
                array.values(&columns, rows).iter().for_each(|values| out.extend_from_slice(values));
            }
            Self::Sparse(_) if columns.is_empty() => {}
            Self::Sparse(sparse) => {
                let mut all = Vec::new();
                sparse.read(rows.clone(), &mut all);
                out.extend_from_slice(&all[columns.start * rows.len()..columns.end * rows.len()]);
            }
        }
    }
}

impl KMeansRows for Matrix {
    fn rows(&self) -> usize {
        self.rows()
    }

    fn dimensions(&self) -> usize {
        self.columns()
    }

    fn read(&self, rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
        self.values(rows)
    }
}

//! Indexing of a table: a column, columns, rows.

use std::{ops::Range, sync::Arc};

use arrow_array::{
    Array, ArrayRef, DictionaryArray, Float64Array, Int32Array, RecordBatch, TimestampNanosecondArray,
    cast::AsArray,
    types::{Float64Type, Int32Type, TimestampNanosecondType},
};
use arrow_schema::DataType;
use numpy::PyReadonlyArray1;
use pyo3::{
    prelude::*,
    types::{PySlice, PyTuple},
};

use crate::error::Kind;

/// Selection from a table.
pub(crate) enum TableIndex {
    /// One column, as an array.
    Column(String),
    /// Columns, as a table.
    Columns(Vec<String>),
    /// Neighbouring rows: nothing is copied.
    Span(Range<usize>),
    /// Rows by their places.
    Rows(Vec<usize>),
    /// Some rows of some columns.
    Both(Box<[TableIndex; 2]>),
}

impl TableIndex {
    /// Reads the index of a table with so many rows: a name, names, a row, rows, a slice, a mask, or rows and names.
    ///
    /// # Errors
    /// The errors of numpy about rows that do not exist.
    pub(crate) fn of(key: &Bound<'_, PyAny>, rows: usize) -> PyResult<Self> {
        if let Ok(name) = key.extract::<String>() {
            return Ok(Self::Column(name));
        }
        if let Ok(pair) = key.cast::<PyTuple>()
            && pair.len() == 2
            && pair.get_item(0)?.extract::<String>().is_err()
        {
            return Ok(Self::Both(Box::new([
                Self::of(&pair.get_item(0)?, rows)?,
                Self::of(&pair.get_item(1)?, rows)?,
            ])));
        }
        if let Ok(names) = key.extract::<Vec<String>>()
            && !names.is_empty()
        {
            return Ok(Self::Columns(names));
        }
        if let Ok(slice) = key.cast::<PySlice>() {
            let slice_range = slice.indices(rows as isize)?;
            if slice_range.step == 1 {
                let start = slice_range.start.max(0) as usize;
                return Ok(Self::Span(start..start + slice_range.slicelength));
            }
        }
        Self::by_place(key, rows)
    }

    /// Rows as numpy understands them: numbers from either end, masks, slices with steps.
    fn by_place(key: &Bound<'_, PyAny>, rows: usize) -> PyResult<Self> {
        let numpy = key.py().import("numpy")?;
        let indices = numpy.call_method1("arange", (rows,))?.get_item(key)?;
        let indices = numpy.call_method1("ravel", (indices,))?.call_method1("astype", ("int64",))?;
        let places: PyReadonlyArray1<'_, i64> = indices.extract()?;
        Ok(Self::Rows(places.as_array().iter().map(|&place| place as usize).collect()))
    }
}

/// Rows of a table by their places, which are those of rows.
pub(crate) fn taken(batch: &RecordBatch, rows: &[usize]) -> PyResult<RecordBatch> {
    let columns = batch.columns().iter().map(|column| of_column(column, rows)).collect::<PyResult<Vec<_>>>()?;
    let options = arrow_array::RecordBatchOptions::new().with_row_count(Some(rows.len()));
    RecordBatch::try_new_with_options(batch.schema(), columns, &options).map_err(|error| Kind::Internal.error(error))
}

fn of_column(column: &ArrayRef, rows: &[usize]) -> PyResult<ArrayRef> {
    let there = |row: &usize| column.is_valid(*row).then_some(*row);
    Ok(match column.data_type() {
        DataType::Float64 => {
            let values = column.as_primitive::<Float64Type>().values();
            Arc::new(rows.iter().map(|&row| values[row]).collect::<Float64Array>())
        }
        DataType::Timestamp(..) => {
            let values = column.as_primitive::<TimestampNanosecondType>().values();
            Arc::new(rows.iter().map(|row| there(row).map(|row| values[row])).collect::<TimestampNanosecondArray>())
        }
        _ => {
            let Some(texts) = column.as_dictionary_opt::<Int32Type>() else {
                return Err(Kind::Internal.error(format!("a column of {} has no rows to take", column.data_type())));
            };
            let keys = texts.keys().values();
            let keys: Int32Array = rows.iter().map(|row| there(row).map(|row| keys[row])).collect();
            let made = DictionaryArray::<Int32Type>::try_new(keys, texts.values().clone());
            Arc::new(made.map_err(|error| Kind::Internal.error(error))?)
        }
    })
}

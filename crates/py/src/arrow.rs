//! Arrow tables as sources of the engine: shared if the layout allows, else turned into numbers.
//!
//! Leaves become columns as those of a Parquet file do: nested structs by their path (`pose.x`), times in seconds, texts as categories.

use std::{ops::Range, path::Path};

use arrow_array::{ArrayRef, RecordBatch, RecordBatchReader};
use arrow_schema::{ArrowError, SchemaRef};
use fleetfoot::{
    data::{Column, ScalarBuffer},
    log::{Error, MemoryTable, TimeUnit},
};
use pyo3::prelude::*;

use crate::{
    arrow_column::{ArrowColumn, leaves},
    capsule,
    error::Kind,
};

/// A table of Arrow columns, each in one or several chunks of rows.
pub(crate) struct ArrowTable {
    name: String,
    rows: usize,
    columns: Vec<Column>,
    stored: Vec<ArrowColumn>,
}

impl ArrowTable {
    /// A table of record batches of one schema.
    ///
    /// # Errors
    /// A column whose missing values cannot be put together with those of the struct that it is in.
    pub(crate) fn new(name: String, schema: &SchemaRef, batches: &[RecordBatch]) -> Result<Self, ArrowError> {
        let rows = batches.iter().map(RecordBatch::num_rows).sum();
        let (mut columns, mut stored) = (Vec::new(), Vec::new());
        for (place, field) in schema.fields().iter().enumerate() {
            let chunks: Vec<ArrayRef> =
                batches.iter().filter(|batch| batch.num_rows() > 0).map(|batch| batch.column(place).clone()).collect();
            for (column, leaf) in leaves(field, field.name().clone(), chunks)? {
                columns.push(column);
                stored.push(leaf);
            }
        }
        Ok(Self { name, rows, columns, stored })
    }

    /// The record batches that Python objects hand over, as one table.
    pub(crate) fn of(name: String, parts: &[Bound<'_, PyAny>]) -> PyResult<Self> {
        let (schema, batches) = collect(&name, parts)?;
        Self::new(name.clone(), &schema, &batches).map_err(|error| Kind::Data.error(format!("{name}: {error}")))
    }
}

/// The record batches of tables, batches and streams of one schema.
pub(crate) fn collect(name: &str, parts: &[Bound<'_, PyAny>]) -> PyResult<(SchemaRef, Vec<RecordBatch>)> {
    let (mut schema, mut batches): (Option<SchemaRef>, Vec<RecordBatch>) = (None, Vec::new());
    for (at, part) in parts.iter().enumerate() {
        let reader = capsule::batches(part)?;
        let batch_schema = reader.schema();
        if let Some(first) = &schema {
            agree(name, at, first, &batch_schema)?;
        } else {
            schema = Some(batch_schema);
        }
        // A stream may compute its batches on threads of its own that need the interpreter.
        let read = part.py().detach(|| reader.collect::<Result<Vec<_>, ArrowError>>());
        batches.extend(read.map_err(|error| Kind::Data.error(format!("{name}: the Arrow stream failed: {error}")))?);
    }
    match schema {
        Some(schema) => Ok((schema, batches)),
        None => Err(Kind::Data.error(format!("{name}: there are no record batches"))),
    }
}

fn agree(name: &str, at: usize, first: &SchemaRef, batch_schema: &SchemaRef) -> PyResult<()> {
    let pairs = first.fields().iter().zip(batch_schema.fields());
    let differing = pairs.into_iter().find(|(a, b)| a.name() != b.name() || a.data_type() != b.data_type());
    let problem = match differing {
        Some((a, b)) => {
            format!("`{}` ({}) where the first has `{}` ({})", b.name(), b.data_type(), a.name(), a.data_type())
        }
        None if first.fields().len() != batch_schema.fields().len() => {
            format!("{} columns where the first has {}", batch_schema.fields().len(), first.fields().len())
        }
        None => return Ok(()),
    };
    Err(Kind::Data.error(format!("{name}: batch {at} has {problem}; give batches of one schema")))
}

impl MemoryTable for ArrowTable {
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
        let Column { name, unit, .. } = self.columns[column].clone();
        let kind = self.stored[column].kind(Path::new(&self.name), &name)?;
        Ok(Column { name, unit, kind })
    }

    fn time_unit(&self, column: usize) -> Option<TimeUnit> {
        self.stored[column].time_unit()
    }

    fn is_time_of_day(&self, column: usize) -> bool {
        self.stored[column].is_time_of_day()
    }

    fn values(&self, columns: &[usize], rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
        columns.iter().map(|&column| self.stored[column].values(rows.clone())).collect()
    }

    fn integers(&self, column: usize, rows: Range<usize>) -> Option<ScalarBuffer<i64>> {
        self.stored[column].integers(rows)
    }
}

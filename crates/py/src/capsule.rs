//! The Arrow PyCapsule interface: record batches of other libraries in, tables out, nothing copied.
//!
//! The layouts are Arrow's C data and C stream interfaces, and `arrow-array` reads and writes them; here are only the capsules that carry them.

use std::{ffi::CStr, ptr::NonNull, sync::Arc};

use arrow_array::{
    Array, RecordBatch, RecordBatchIterator, RecordBatchOptions, RecordBatchReader, StructArray,
    ffi::{FFI_ArrowArray, FFI_ArrowSchema, from_ffi},
    ffi_stream::{ArrowArrayStreamReader, FFI_ArrowArrayStream},
};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use pyo3::{
    exceptions::{PyTypeError, PyValueError},
    prelude::*,
    types::{PyCapsule, PyTuple},
};

const SCHEMA: &CStr = c"arrow_schema";
const ARRAY: &CStr = c"arrow_array";
const STREAM: &CStr = c"arrow_array_stream";

/// Record batches of one schema, perhaps computed on demand.
pub(crate) type Batches = Box<dyn RecordBatchReader + Send>;

fn invalid(error: ArrowError) -> PyErr {
    PyValueError::new_err(format!("the Arrow data cannot be taken over: {error}"))
}

/// Pointer of a capsule of this name.
fn pointer<T>(capsule: &Bound<'_, PyAny>, name: &CStr) -> PyResult<NonNull<T>> {
    Ok(capsule.cast::<PyCapsule>()?.pointer_checked(Some(name))?.cast())
}

/// The record batches that a Python object hands over: a batch by `__arrow_c_array__`, or a stream by `__arrow_c_stream__`.
///
/// # Errors
/// `ValueError` for an object with neither, for arrays that are no records, and for records that are missing as a whole.
pub(crate) fn batches(object: &Bound<'_, PyAny>) -> PyResult<Batches> {
    if object.hasattr("__arrow_c_array__")? {
        let pair = object.call_method0("__arrow_c_array__")?;
        let pair = pair.cast::<PyTuple>().map_err(|_| PyTypeError::new_err("__arrow_c_array__ gives a pair"))?;
        let batch = record_batch(&pair.get_item(0)?, &pair.get_item(1)?)?;
        let schema = batch.schema();
        return Ok(Box::new(RecordBatchIterator::new([Ok(batch)], schema)));
    }
    if object.hasattr("__arrow_c_stream__")? {
        let capsule = object.call_method0("__arrow_c_stream__")?;
        let stream = pointer::<FFI_ArrowArrayStream>(&capsule, STREAM)?;
        // SAFETY: a capsule of this name holds a stream; it is moved out, and what stays in the capsule is marked as released.
        let stream = unsafe { FFI_ArrowArrayStream::from_raw(stream.as_ptr()) };
        return Ok(Box::new(ArrowArrayStreamReader::try_new(stream).map_err(invalid)?));
    }
    Err(PyValueError::new_err("no Arrow data: an object with __arrow_c_array__ or __arrow_c_stream__ is expected"))
}

fn record_batch(schema: &Bound<'_, PyAny>, array: &Bound<'_, PyAny>) -> PyResult<RecordBatch> {
    let (schema, array) = (pointer::<FFI_ArrowSchema>(schema, SCHEMA)?, pointer::<FFI_ArrowArray>(array, ARRAY)?);
    // SAFETY: a capsule of this name holds a schema, and it lives as long as the pair that `batches` holds.
    let schema = unsafe { schema.as_ref() };
    let field = Field::try_from(schema).map_err(invalid)?;
    let DataType::Struct(fields) = field.data_type() else {
        return Err(PyValueError::new_err(format!("an Arrow array of {}: records are expected", field.data_type())));
    };
    // SAFETY: a capsule of this name holds an array; it is moved out, and what stays in the capsule is marked as released.
    let array = unsafe { FFI_ArrowArray::from_raw(array.as_ptr()) };
    // SAFETY: both come from one `__arrow_c_array__`, which says that the schema is the array's.
    let records = StructArray::from(unsafe { from_ffi(array, schema) }.map_err(invalid)?);
    if records.null_count() != 0 {
        return Err(PyValueError::new_err("Arrow records that are missing as a whole cannot be rows"));
    }
    let schema = Schema::new_with_metadata(fields.clone(), field.metadata().clone());
    let rows = RecordBatchOptions::new().with_row_count(Some(records.len()));
    RecordBatch::try_new_with_options(Arc::new(schema), records.into_parts().1, &rows).map_err(invalid)
}

/// A schema for other libraries.
pub(crate) fn of_schema<'py>(py: Python<'py>, schema: &Schema) -> PyResult<Bound<'py, PyCapsule>> {
    PyCapsule::new_with_value(py, FFI_ArrowSchema::try_from(schema).map_err(invalid)?, SCHEMA)
}

/// Record batches for other libraries.
pub(crate) fn of_batches(py: Python<'_>, batches: Batches) -> PyResult<Bound<'_, PyCapsule>> {
    PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(batches), STREAM)
}

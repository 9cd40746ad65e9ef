//! A table that the engine read, for Python: Arrow outside, numpy without a copy.

use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, DictionaryArray, Float64Array, Int32Array, RecordBatch, RecordBatchIterator, StringArray,
    TimestampNanosecondArray, cast::AsArray, types::Float64Type, types::Int32Type, types::TimestampNanosecondType,
};
use arrow_buffer::{NullBuffer, ScalarBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use fleetfoot::data::ColumnKind;
use numpy::{PyArray1, ndarray::ArrayView1};
use pyo3::{
    exceptions::{PyImportError, PyKeyError},
    prelude::*,
    types::{PyCapsule, PyDict, PyTuple},
};

use crate::{
    capsule,
    error::Kind,
    run::guard,
    table_rows::{TableIndex, taken},
};

/// A stamp that is missing, and numpy's "not a time".
const MISSING: i64 = i64::MIN;

/// A table: named columns of equal length. Hands itself to any library that reads Arrow, without a copy.
#[pyclass(frozen, module = "fleetfoot", name = "Table")]
pub(crate) struct Table {
    batch: RecordBatch,
    notes: Vec<String>,
}

/// Columns on the way to a table.
#[derive(Default)]
pub(crate) struct TableBuilder {
    fields: Vec<Field>,
    arrays: Vec<ArrayRef>,
    rows: usize,
}

impl TableBuilder {
    /// Stamps in nanoseconds, `i64::MIN` where one is missing.
    pub(crate) fn stamps(&mut self, name: &str, values: Vec<i64>) {
        let is_missing = values.contains(&MISSING);
        let nulls = is_missing.then(|| values.iter().map(|&value| value != MISSING).collect::<NullBuffer>());
        let array = TimestampNanosecondArray::new(ScalarBuffer::from(values), nulls);
        self.push(Field::new(name, DataType::Timestamp(TimeUnit::Nanosecond, None), is_missing), Arc::new(array));
    }

    /// Numbers, NaN where one is missing; or the codes of a category's names, which become texts.
    pub(crate) fn values(&mut self, name: &str, unit: Option<&str>, kind: &ColumnKind, values: Vec<f64>) {
        let metadata = unit.map(|unit| ("unit".to_owned(), unit.to_owned())).into_iter().collect();
        if let ColumnKind::Category(names) = kind
            && !(names.is_empty() && values.iter().any(|value| !value.is_nan()))
        {
            let keys = values.iter().map(|&code| (!code.is_nan()).then_some(code as i32));
            return self.texts(name, names, keys.collect());
        }
        let array = Float64Array::new(ScalarBuffer::from(values), None);
        self.push(Field::new(name, DataType::Float64, false).with_metadata(metadata), Arc::new(array));
    }

    /// Texts by their places among the names.
    pub(crate) fn texts(&mut self, name: &str, names: &[String], keys: Int32Array) {
        let values: ArrayRef = Arc::new(StringArray::from_iter_values(names));
        // Places are within the names: whoever made the codes made the names.
        let Ok(array) = DictionaryArray::<Int32Type>::try_new(keys, values) else { return };
        self.push(Field::new(name, array.data_type().clone(), true), Arc::new(array));
    }

    fn push(&mut self, field: Field, array: ArrayRef) {
        self.rows = array.len();
        self.fields.push(field);
        self.arrays.push(array);
    }

    /// The table.
    ///
    /// # Errors
    /// Columns of different lengths.
    pub(crate) fn finish(self, notes: Vec<String>) -> Result<Table, ArrowError> {
        let options = arrow_array::RecordBatchOptions::new().with_row_count(Some(self.rows));
        let schema = Arc::new(Schema::new(self.fields));
        let batch = RecordBatch::try_new_with_options(schema, self.arrays, &options)?;
        Ok(Table { batch, notes })
    }
}

impl Table {
    fn schema(&self) -> SchemaRef {
        self.batch.schema()
    }

    fn place(&self, name: &str) -> PyResult<usize> {
        let schema = self.schema();
        schema.index_of(name).map_err(|_| {
            let names: Vec<&str> = schema.fields().iter().map(|field| field.name().as_str()).take(20).collect();
            let more = if schema.fields().len() > 20 { ", ..." } else { "" };
            PyKeyError::new_err(format!("no column `{name}`; there are {}{more}", names.join(", ")))
        })
    }

    /// Some rows, or some columns, as a table.
    fn part(&self, index: &TableIndex) -> PyResult<Self> {
        let batch = match index {
            TableIndex::Column(name) => self.projected(std::slice::from_ref(name))?,
            TableIndex::Columns(names) => self.projected(names)?,
            TableIndex::Span(rows) => self.batch.slice(rows.start, rows.len()),
            TableIndex::Rows(rows) => taken(&self.batch, rows)?,
            TableIndex::Both(pair) => return self.part(&pair[0])?.part(&pair[1]),
        };
        Ok(Self { batch, notes: self.notes.clone() })
    }

    fn projected(&self, names: &[String]) -> PyResult<RecordBatch> {
        let places = names.iter().map(|name| self.place(name)).collect::<PyResult<Vec<_>>>()?;
        self.batch.project(&places).map_err(|error| Kind::Internal.error(error))
    }
}

/// Imports a library that a method needs.
fn library<'py>(py: Python<'py>, name: &str, method: &str) -> PyResult<Bound<'py, PyModule>> {
    py.import(name).map_err(|_| PyImportError::new_err(format!("{method} needs {name}: pip install {name}")))
}

#[pymethods]
impl Table {
    /// Names of the columns.
    #[getter]
    fn columns(&self) -> Vec<String> {
        self.schema().fields().iter().map(|field| field.name().clone()).collect()
    }

    /// The unit of each column, by its name; ``None`` where it is not known.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let units = PyDict::new(py);
        for field in self.schema().fields() {
            units.set_item(field.name(), field.metadata().get("unit"))?;
        }
        Ok(units)
    }

    /// Assumptions and omissions of the reading.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Rows and columns.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.batch.num_rows(), self.batch.num_columns())
    }

    fn __len__(&self) -> usize {
        self.batch.num_rows()
    }

    /// The rows, each a dict by the names of the columns, in the form that ``pandas.DataFrame(table)`` reads.
    fn __iter__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("fleetfoot._rows")?.call_method1("rows", (slf,))
    }

    /// Columns of numbers side by side (rows, columns), a copy, for libraries that read DLPack.
    #[pyo3(signature = (**options))]
    fn __dlpack__<'py>(slf: &Bound<'py, Self>, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let matrix = slf.py().import("fleetfoot._rows")?.call_method1("matrix", (slf,))?;
        matrix.call_method("__dlpack__", (), options)
    }

    /// The processor's memory, as DLPack numbers it.
    fn __dlpack_device__(&self) -> (i32, i32) {
        (1, 0)
    }

    fn __contains__(&self, name: &str) -> bool {
        self.schema().index_of(name).is_ok()
    }

    fn __repr__(&self) -> String {
        let schema = self.schema();
        let shown = schema.fields().iter().take(8).map(|field| match field.metadata().get("unit") {
            Some(unit) => format!("{} [{unit}]", field.name()),
            None => field.name().clone(),
        });
        let more = if schema.fields().len() > 8 { ", ..." } else { "" };
        format!("Table({} rows: {}{more})", self.batch.num_rows(), shown.collect::<Vec<_>>().join(", "))
    }

    /// For a name: a column as a numpy array that shares the table's memory and cannot be written (texts are made
    /// anew). For a list of names, for rows, and for ``rows, names``: a table. Rows are a number, numbers, a mask or a
    /// slice; neighbouring rows are not copied.
    fn __getitem__<'py>(slf: &Bound<'py, Self>, key: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let table = slf.get();
        match TableIndex::of(key, table.batch.num_rows())? {
            TableIndex::Column(name) => {
                let column = table.batch.column(table.place(&name)?);
                guard(|| numpy_of(slf, column))
            }
            index => Ok(Bound::new(slf.py(), table.part(&index)?)?.into_any()),
        }
    }

    /// The table for notebooks: its first rows.
    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("fleetfoot._html")?.call_method1("of_table", (slf,))
    }

    /// The schema as a capsule of Arrow's C interface.
    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        capsule::of_schema(py, &self.schema())
    }

    /// The rows as a capsule of Arrow's C interface; nothing is copied. They come in the table's schema; a consumer
    /// casts them to another one itself, as the interface allows.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        capsule::of_batches(py, Box::new(RecordBatchIterator::new([Ok(self.batch.clone())], self.schema())))
    }

    /// The table as a ``pyarrow.Table``, without a copy.
    fn to_pyarrow<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        library(slf.py(), "pyarrow", "to_pyarrow()")?.call_method1("table", (slf,))
    }

    /// The table as a ``polars.DataFrame``, without a copy of its numbers.
    fn to_polars<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        library(slf.py(), "polars", "to_polars()")?.call_method1("DataFrame", (slf,))
    }

    /// The table as a ``pandas.DataFrame``; texts become categories.
    fn to_pandas<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let pandas = library(slf.py(), "pandas", "to_pandas()")?;
        if slf.py().import("pyarrow").is_ok() {
            return Self::to_pyarrow(slf)?.call_method0("to_pandas");
        }
        let columns = PyDict::new(slf.py());
        for name in slf.get().columns() {
            columns.set_item(&name, slf.get_item(&name)?)?;
        }
        pandas.call_method1("DataFrame", (columns,))
    }
}

/// A column as numpy sees it.
fn numpy_of<'py>(table: &Bound<'py, Table>, column: &ArrayRef) -> PyResult<Bound<'py, PyAny>> {
    let (py, container) = (table.py(), table.clone().into_any());
    let array = match column.data_type() {
        DataType::Float64 => {
            let values = ArrayView1::from(&column.as_primitive::<Float64Type>().values()[..]);
            // SAFETY: the values live as long as the table, which never changes them.
            unsafe { PyArray1::borrow_from_array(&values, container) }.into_any()
        }
        DataType::Timestamp(..) => {
            let values = ArrayView1::from(&column.as_primitive::<TimestampNanosecondType>().values()[..]);
            // SAFETY: as above.
            let array = unsafe { PyArray1::borrow_from_array(&values, container) };
            array.call_method1("view", ("datetime64[ns]",))?
        }
        _ => return texts(py, column),
    };
    let options = PyDict::new(py);
    options.set_item("write", false)?;
    array.call_method("setflags", (), Some(&options))?;
    Ok(array)
}

/// Texts as an array of objects, `None` where there is none.
fn texts<'py>(py: Python<'py>, column: &ArrayRef) -> PyResult<Bound<'py, PyAny>> {
    let Some(dictionary) = column.as_dictionary_opt::<Int32Type>() else {
        return Err(Kind::Internal.error(format!("a column of {} has no numpy array", column.data_type())));
    };
    let Some(names) = dictionary.values().as_string_opt::<i32>() else {
        return Err(Kind::Internal.error("a dictionary of other things than texts"));
    };
    let numpy = py.import("numpy")?;
    let options = PyDict::new(py);
    options.set_item("dtype", "object")?;
    let all: Vec<Option<&str>> = names.iter().chain([None]).collect();
    let all = numpy.call_method("array", (all,), Some(&options))?;
    let none = names.len() as i32;
    let keys: Vec<i32> = dictionary.keys().iter().map(|key| key.unwrap_or(none)).collect();
    all.call_method1("take", PyTuple::new(py, [PyArray1::from_vec(py, keys)])?)
}

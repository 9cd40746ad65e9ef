//! numpy arrays as columns, read where they are: any order of memory, any strides, any type of number.

use std::{ops::Range, panic::AssertUnwindSafe, sync::Arc};

use arrow_buffer::{Buffer, alloc::Allocation};
use fleetfoot::{
    data::{Column, ColumnKind, ScalarBuffer},
    log::{MemoryTable, TimeUnit},
};
use numpy::{PyArrayDescrMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::Kind;

/// Rows that are turned from rows into columns at a time: they stay in the nearest cache meanwhile.
const TURNED: usize = 64;

/// The array that memory belongs to. It lives as long as anything reads from it.
#[derive(Debug)]
struct Owner(#[expect(dead_code, reason = "held, not read")] AssertUnwindSafe<Py<PyAny>>);

/// Type of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scalar {
    Bool,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
    /// Dates and durations; `i64::MIN` is missing.
    Time(TimeUnit),
}

/// An array of one or two dimensions, borrowed from numpy.
///
/// A caller should not write into an array while a call reads it: the call would see some of the old and some of the
/// new values.
#[derive(Debug, Clone)]
pub(crate) struct Array {
    owner: Arc<Owner>,
    data: *const u8,
    scalar: Scalar,
    rows: usize,
    columns: usize,
    /// Bytes from a row to the next and from a column to the next.
    strides: [isize; 2],
}

// SAFETY: the memory is kept alive by `owner` and only read.
unsafe impl Send for Array {}
// SAFETY: as above.
unsafe impl Sync for Array {}

impl Array {
    /// Borrows an array of numbers, or an object that becomes one ([`plain`]); `what` is its name for messages.
    pub(crate) fn of(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Self> {
        let as_it_lies = match object.cast_exact::<PyUntypedArray>() {
            Ok(array) if scalar(array)?.is_some() => Some(array.clone()),
            _ => None,
        };
        let array = match as_it_lies {
            Some(array) => array,
            None => plain(object, what, "numbers")?.cast_into::<PyUntypedArray>()?,
        };
        let (shape, strides) = (array.shape().to_vec(), array.strides().to_vec());
        let (rows, columns, strides) = match (shape.as_slice(), strides.as_slice()) {
            (&[rows], &[stride]) => (rows, 1, [stride, 0]),
            (&[rows, columns], &[down, right]) => (rows, columns, [down, right]),
            _ => {
                return Err(Kind::Data
                    .error(format!("{what} has {} dimensions; give rows (1) or rows and columns (2)", shape.len())));
            }
        };
        let Some(scalar) = scalar(&array)? else {
            let kind = array.dtype().str()?.to_string();
            return Err(Kind::Data.error(format!("{what} has the type {kind}, which cannot be read as numbers")));
        };
        // SAFETY: the pointer is that of a live array, whose fields are set.
        let data = unsafe { (*array.as_array_ptr()).fields.data }.cast::<u8>().cast_const();
        Ok(Self {
            owner: Arc::new(Owner(AssertUnwindSafe(array.into_any().unbind()))),
            data,
            scalar,
            rows,
            columns,
            strides,
        })
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub(crate) fn columns(&self) -> usize {
        self.columns
    }

    /// Type of its cells.
    pub(crate) fn scalar(&self) -> Scalar {
        self.scalar
    }

    /// Returns true if a column's values are `f64` one after the other.
    fn is_contiguous(&self) -> bool {
        self.scalar == Scalar::F64
            && self.strides[0] == 8
            && (self.data as usize).is_multiple_of(8)
            && self.strides[1] % 8 == 0
    }

    /// Address of a cell.
    fn at(&self, row: usize, column: usize) -> *const u8 {
        // Both products stay within the array's memory, and so within `isize`.
        self.data.wrapping_offset(row as isize * self.strides[0]).wrapping_offset(column as isize * self.strides[1])
    }

    /// Values of a column, shared where they lie one after the other.
    fn shared(&self, column: usize, rows: Range<usize>) -> ScalarBuffer<f64> {
        if rows.is_empty() {
            return Vec::new().into();
        }
        let start = self.at(rows.start, column).cast_mut();
        let Some(start) = std::ptr::NonNull::new(start) else { return Vec::new().into() };
        let owner: Arc<dyn Allocation> = self.owner.clone();
        // SAFETY: `is_contiguous` was checked by the caller: the rows of the column are aligned `f64` one after the other, alive while `owner` is.
        let buffer = unsafe { Buffer::from_custom_allocation(start, 8 * rows.len(), owner) };
        ScalarBuffer::from(buffer)
    }

    /// Values of some columns as `f64`.
    pub(crate) fn values(&self, columns: &[usize], rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
        if self.is_contiguous() {
            return columns.iter().map(|&column| self.shared(column, rows.clone())).collect();
        }
        macro_rules! turned {
            ($kind:ty, $convert:expr) => {
                self.turned::<$kind>(columns, rows, $convert)
            };
        }
        let scaled = match self.scalar {
            Scalar::Bool => turned!(u8, |value| f64::from(u8::from(value != 0))),
            Scalar::I8 => turned!(i8, f64::from),
            Scalar::I16 => turned!(i16, f64::from),
            Scalar::I32 => turned!(i32, f64::from),
            Scalar::I64 => turned!(i64, |value| value as f64),
            Scalar::U8 => turned!(u8, f64::from),
            Scalar::U16 => turned!(u16, f64::from),
            Scalar::U32 => turned!(u32, f64::from),
            Scalar::U64 => turned!(u64, |value| value as f64),
            Scalar::F32 => turned!(f32, f64::from),
            Scalar::F64 => turned!(f64, |value| value),
            // Seconds, as those of a file; split so that the fraction keeps its digits as far as f64 goes.
            Scalar::Time(unit) => {
                let each = 1_000_000_000 / unit.nanoseconds();
                turned!(i64, |value| match value {
                    i64::MIN => f64::NAN,
                    _ => (value / each) as f64 + (value % each) as f64 / each as f64,
                })
            }
        };
        scaled.into_iter().map(ScalarBuffer::from).collect()
    }

    fn turned<T: Copy>(&self, columns: &[usize], rows: Range<usize>, convert: impl Fn(T) -> f64) -> Vec<Vec<f64>> {
        let mut turned_columns: Vec<Vec<f64>> = columns.iter().map(|_| Vec::with_capacity(rows.len())).collect();
        for from in rows.clone().step_by(TURNED) {
            let to = (from + TURNED).min(rows.end);
            for (&column, values) in columns.iter().zip(&mut turned_columns) {
                let start = self.at(from, column);
                values.extend((0..to - from).map(|row| {
                    // SAFETY: the row and the column are within the array, which is alive; cells need not be aligned.
                    convert(unsafe {
                        start.wrapping_offset(row as isize * self.strides[0]).cast::<T>().read_unaligned()
                    })
                }));
            }
        }
        turned_columns
    }

    /// Whole numbers of a column; `None` where it holds others.
    pub(crate) fn integers(&self, column: usize, rows: Range<usize>) -> Option<Vec<i64>> {
        macro_rules! read {
            ($kind:ty) => {
                rows.map(|row| {
                    // SAFETY: the row and the column are within the array, which is alive; cells need not be aligned.
                    i64::try_from(unsafe { self.at(row, column).cast::<$kind>().read_unaligned() }).unwrap_or(i64::MIN)
                })
                .collect()
            };
        }
        Some(match self.scalar {
            Scalar::Bool | Scalar::F32 | Scalar::F64 => return None,
            Scalar::I8 => read!(i8),
            Scalar::I16 => read!(i16),
            Scalar::I32 => read!(i32),
            Scalar::I64 | Scalar::Time(_) => read!(i64),
            Scalar::U8 => read!(u8),
            Scalar::U16 => read!(u16),
            Scalar::U32 => read!(u32),
            Scalar::U64 => read!(u64),
        })
    }
}

/// A plain array of a caller's object, by a function of `fleetfoot._arrays`. All arrays go through it that are not of
/// this machine's numbers already.
pub(crate) fn plain<'py>(object: &Bound<'py, PyAny>, what: &str, function: &str) -> PyResult<Bound<'py, PyAny>> {
    object.py().import("fleetfoot._arrays")?.call_method1(function, (object, what))
}

/// Type of an array's cells; `None` if they are no numbers of this machine.
fn scalar(array: &Bound<'_, PyUntypedArray>) -> PyResult<Option<Scalar>> {
    let kind = array.dtype();
    if kind.is_native_byteorder() == Some(false) {
        return Ok(None);
    }
    Ok(Some(match (kind.kind(), kind.itemsize()) {
        (b'b', 1) => Scalar::Bool,
        (b'i', 1) => Scalar::I8,
        (b'i', 2) => Scalar::I16,
        (b'i', 4) => Scalar::I32,
        (b'i', 8) => Scalar::I64,
        (b'u', 1) => Scalar::U8,
        (b'u', 2) => Scalar::U16,
        (b'u', 4) => Scalar::U32,
        (b'u', 8) => Scalar::U64,
        (b'f', 4) => Scalar::F32,
        (b'f', 8) => Scalar::F64,
        (b'M' | b'm', 8) => {
            let unit = array.py().import("numpy")?.call_method1("datetime_data", (&kind,))?;
            let (unit, count): (String, i64) = unit.extract()?;
            match TimeUnit::parse(&unit) {
                Some(unit) if count == 1 => Scalar::Time(unit),
                _ => return Ok(None),
            }
        }
        _ => return Ok(None),
    }))
}

/// Arrays beside each other as a table.
pub(crate) struct Arrays {
    name: String,
    rows: usize,
    columns: Vec<Column>,
    /// For every column the array that holds it and its place there.
    places: Vec<(usize, usize)>,
    arrays: Vec<Array>,
}

impl Arrays {
    /// A table of arrays of equal length, each with the names of its columns.
    pub(crate) fn new(name: String, arrays: Vec<(Array, Vec<String>)>) -> PyResult<Self> {
        let rows = arrays.first().map_or(0, |(array, _)| array.rows());
        let (mut columns, mut places) = (Vec::new(), Vec::new());
        for (at, (array, names)) in arrays.iter().enumerate() {
            if array.rows() != rows {
                let first = arrays.first().and_then(|(_, names)| names.first()).map_or("the first", String::as_str);
                return Err(Kind::Data.error(format!(
                    "{name}: `{}` has {} rows and `{first}` has {rows}; give arrays of one length",
                    names.first().map_or("", String::as_str),
                    array.rows()
                )));
            }
            if array.columns() != names.len() {
                return Err(Kind::Data.error(format!(
                    "{name}: {} names ({}) for {} columns",
                    names.len(),
                    names.join(", "),
                    array.columns()
                )));
            }
            for (place, column) in names.iter().enumerate() {
                let kind = match array.scalar() {
                    Scalar::F32 | Scalar::F64 => ColumnKind::Float,
                    Scalar::Bool => ColumnKind::Boolean,
                    _ => ColumnKind::Integer,
                };
                columns.push(Column { name: column.clone(), unit: None, kind });
                places.push((at, place));
            }
        }
        Ok(Self { name, rows, columns, places, arrays: arrays.into_iter().map(|(array, _)| array).collect() })
    }
}

impl MemoryTable for Arrays {
    fn name(&self) -> &str {
        &self.name
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn time_unit(&self, column: usize) -> Option<TimeUnit> {
        match self.arrays[self.places[column].0].scalar() {
            Scalar::Time(unit) => Some(unit),
            _ => None,
        }
    }

    fn values(&self, columns: &[usize], rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
        let mut values_read = Vec::with_capacity(columns.len());
        // Neighbours in one array are read together.
        for group in columns.chunk_by(|&a, &b| self.places[a].0 == self.places[b].0) {
            let inside: Vec<usize> = group.iter().map(|&column| self.places[column].1).collect();
            values_read.extend(self.arrays[self.places[group[0]].0].values(&inside, rows.clone()));
        }
        values_read
    }

    fn integers(&self, column: usize, rows: Range<usize>) -> Option<ScalarBuffer<i64>> {
        let (array, place) = self.places[column];
        self.arrays[array].integers(place, rows).map(ScalarBuffer::from)
    }
}

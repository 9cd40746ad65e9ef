//! Columns into Parquet files, streamed row group by row group; the file appears whole or not at all.

use std::{
    collections::{BTreeMap, HashMap},
    io,
    path::{Path, PathBuf},
    sync::Arc,
};

use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, StringArray, TimestampNanosecondArray,
};
use arrow_schema::{DataType, Field, Schema, SchemaRef, TimeUnit};
use parquet::{
    arrow::ArrowWriter,
    basic::{Compression, ZstdLevel},
    errors::ParquetError,
    file::{metadata::KeyValue, properties::WriterProperties},
    schema::types::ColumnPath,
};

use crate::{AtomicFile, Error, check_outputs};

/// A column to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteColumn {
    /// Its name.
    pub name: String,
    /// Its unit; stored in the field's metadata, where [`crate::open`] finds it again.
    pub unit: Option<String>,
    /// What it holds.
    pub kind: WriteKind,
}

impl WriteColumn {
    /// A column without a unit.
    pub fn new(name: impl Into<String>, kind: WriteKind) -> Self {
        Self { name: name.into(), unit: None, kind }
    }

    /// The same column with a unit.
    pub fn with_unit(self, unit: impl Into<String>) -> Self {
        Self { unit: Some(unit.into()), ..self }
    }
}

/// What a written column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum WriteKind {
    /// 64-bit floats; NaN stays NaN.
    Float,
    /// 64-bit whole numbers.
    Integer,
    /// Nanoseconds as a timestamp.
    Stamp,
    /// Truth values.
    Boolean,
    /// UTF-8.
    Text,
}

/// Values for one column; as many as the other columns of the same call have.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum Values<'a> {
    /// For [`WriteKind::Float`].
    Float(&'a [f64]),
    /// For [`WriteKind::Integer`] and [`WriteKind::Stamp`].
    Integer(&'a [i64]),
    /// For [`WriteKind::Boolean`].
    Boolean(&'a [bool]),
    /// For [`WriteKind::Text`].
    Text(&'a [&'a str]),
}

/// How a Parquet file is written.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteOptions {
    /// Key-value metadata of the file.
    pub metadata: BTreeMap<String, String>,
    /// Files that must not be overwritten: the inputs of the command.
    pub inputs: Vec<PathBuf>,
    /// Compress with Zstandard.
    pub compress: bool,
    /// Rows of a row group; also what is held in memory, encoded, at any time.
    pub row_group_rows: usize,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self { metadata: BTreeMap::new(), inputs: Vec::new(), compress: true, row_group_rows: 1 << 17 }
    }
}

/// Writes a Parquet file. Dropping it before [`ParquetWriter::finish`] leaves nothing behind.
#[derive(Debug)]
pub struct ParquetWriter {
    path: PathBuf,
    columns: Vec<WriteColumn>,
    schema: SchemaRef,
    writer: ArrowWriter<AtomicFile>,
}

impl ParquetWriter {
    /// Begins a file.
    ///
    /// # Errors
    /// A target that is one of the inputs, a folder or in a folder that is not there; two columns of one name.
    pub fn create(path: impl Into<PathBuf>, columns: Vec<WriteColumn>, options: &WriteOptions) -> Result<Self, Error> {
        let path = path.into();
        check_outputs(&[&path], &options.inputs)?;
        check_names(&path, &columns)?;
        let schema = Arc::new(Schema::new(columns.iter().map(field).collect::<Vec<_>>()));
        let file = AtomicFile::create(&path)?;
        let writer = ArrowWriter::try_new(file, schema.clone(), Some(properties(&columns, options)))
            .map_err(|problem| write_error(&path, problem))?;
        Ok(Self { path, columns, schema, writer })
    }

    /// Appends rows: one slice a column, in the order of the columns, all of one length.
    pub fn write(&mut self, values: &[Values<'_>]) -> Result<(), Error> {
        if values.len() != self.columns.len() {
            let problem = format!("{} columns of values for {} columns", values.len(), self.columns.len());
            return Err(Error::BadBatch { path: self.path.clone(), problem });
        }
        let mut arrays: Vec<ArrayRef> = Vec::with_capacity(values.len());
        for (column, values) in self.columns.iter().zip(values) {
            arrays.push(array(column, values).map_err(|problem| Error::BadBatch { path: self.path.clone(), problem })?);
        }
        if arrays.is_empty() {
            return Ok(());
        }
        let batch = RecordBatch::try_new(self.schema.clone(), arrays)
            .map_err(|problem| Error::BadBatch { path: self.path.clone(), problem: problem.to_string() })?;
        self.writer.write(&batch).map_err(|problem| write_error(&self.path, problem))
    }

    /// Completes the file and gives it its name.
    pub fn finish(self) -> Result<(), Error> {
        let Self { path, writer, .. } = self;
        let file = writer.into_inner().map_err(|problem| write_error(&path, problem))?;
        file.commit()
    }
}

/// An error when two columns have one name.
pub(crate) fn check_names(path: &Path, columns: &[WriteColumn]) -> Result<(), Error> {
    let twice = |(i, column): &(usize, &WriteColumn)| columns[..*i].iter().any(|other| other.name == column.name);
    match columns.iter().enumerate().find(twice) {
        Some((_, column)) => {
            Err(Error::BadBatch { path: path.into(), problem: format!("two columns named `{}`", column.name) })
        }
        None => Ok(()),
    }
}

fn field(column: &WriteColumn) -> Field {
    let kind = match column.kind {
        WriteKind::Float => DataType::Float64,
        WriteKind::Integer => DataType::Int64,
        WriteKind::Stamp => DataType::Timestamp(TimeUnit::Nanosecond, None),
        WriteKind::Boolean => DataType::Boolean,
        WriteKind::Text => DataType::Utf8,
    };
    let unit: HashMap<String, String> = column.unit.iter().map(|unit| ("unit".to_owned(), unit.clone())).collect();
    Field::new(&column.name, kind, false).with_metadata(unit)
}

fn properties(columns: &[WriteColumn], options: &WriteOptions) -> WriterProperties {
    let compression =
        if options.compress { Compression::ZSTD(ZstdLevel::default()) } else { Compression::UNCOMPRESSED };
    let pairs = options.metadata.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone())).collect();
    let mut builder = WriterProperties::builder()
        .set_compression(compression)
        .set_max_row_group_row_count(Some(options.row_group_rows.max(1)))
        .set_key_value_metadata(Some(pairs));
    for column in columns.iter().filter(|column| column.kind == WriteKind::Float) {
        // Measured numbers rarely repeat: a dictionary of them only costs.
        builder = builder.set_column_dictionary_enabled(ColumnPath::from(vec![column.name.clone()]), false);
    }
    builder.build()
}

fn array(column: &WriteColumn, values: &Values<'_>) -> Result<ArrayRef, String> {
    Ok(match (column.kind, values) {
        (WriteKind::Float, Values::Float(values)) => Arc::new(Float64Array::from_iter_values(values.iter().copied())),
        (WriteKind::Integer, Values::Integer(values)) => Arc::new(Int64Array::from_iter_values(values.iter().copied())),
        (WriteKind::Stamp, Values::Integer(values)) => {
            Arc::new(TimestampNanosecondArray::from_iter_values(values.iter().copied()))
        }
        (WriteKind::Boolean, Values::Boolean(values)) => Arc::new(BooleanArray::from(values.to_vec())),
        (WriteKind::Text, Values::Text(values)) => Arc::new(StringArray::from_iter_values(values.iter())),
        (kind, _) => {
            return Err(format!("column `{}` is {kind:?}, the values are of another kind", column.name));
        }
    })
}

fn write_error(path: &Path, problem: ParquetError) -> Error {
    let source = match problem {
        ParquetError::External(inner) => match inner.downcast::<io::Error>() {
            Ok(inner) => *inner,
            Err(inner) => io::Error::other(inner),
        },
        other => io::Error::other(other),
    };
    Error::Io { path: path.into(), action: "write", source }
}

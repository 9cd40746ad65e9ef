//! Columns into Parquet files, streamed row group by row group; the file appears whole or not at all.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt, io,
    path::{Path, PathBuf},
    sync::Arc,
};

use parquet::{
    basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical, ZstdLevel},
    data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type},
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        properties::WriterProperties,
        writer::{SerializedColumnWriter, SerializedFileWriter},
    },
    schema::types::{ColumnPath, Type},
};

use crate::{
    arrow_schema,
    atomic::AtomicFile,
    destination::check_outputs,
    error::Error,
    write_column::{WriteColumn, WriteKind},
};

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

/// Options of a Parquet file.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteOptions {
    /// Key-value metadata of the file.
    pub metadata: BTreeMap<String, String>,
    /// Files that must not be overwritten: the inputs of the command.
    pub inputs: Vec<PathBuf>,
    /// Compress with Zstandard.
    pub compress: bool,
    /// Rows of a row group, which also limits the memory.
    pub row_group_rows: usize,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self { metadata: BTreeMap::new(), inputs: Vec::new(), compress: true, row_group_rows: 1 << 17 }
    }
}

/// Writes a Parquet file. Dropping it before [`ParquetWriter::finish`] leaves nothing behind.
pub struct ParquetWriter {
    path: PathBuf,
    columns: Vec<WriteColumn>,
    /// Values of the row group to come, one buffer a column, and their number.
    buffers: Vec<Buffer>,
    rows: usize,
    row_group_rows: usize,
    writer: SerializedFileWriter<AtomicFile>,
}

impl fmt::Debug for ParquetWriter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ParquetWriter")
            .field("path", &self.path)
            .field("columns", &self.columns)
            .finish_non_exhaustive()
    }
}

/// Values of a column until there are enough for a row group.
enum Buffer {
    Float(Vec<f64>),
    Integer(Vec<i64>),
    Boolean(Vec<bool>),
    Text(Vec<ByteArray>),
}

impl Buffer {
    fn of(kind: WriteKind) -> Self {
        match kind {
            WriteKind::Float => Self::Float(Vec::new()),
            WriteKind::Integer | WriteKind::Stamp => Self::Integer(Vec::new()),
            WriteKind::Boolean => Self::Boolean(Vec::new()),
            WriteKind::Text => Self::Text(Vec::new()),
        }
    }

    /// Takes the rows in `from..to` over; `false` for values of another kind.
    fn append(&mut self, values: &Values<'_>, from: usize, to: usize) -> bool {
        match (self, values) {
            (Self::Float(column), Values::Float(values)) => column.extend_from_slice(&values[from..to]),
            (Self::Integer(column), Values::Integer(values)) => column.extend_from_slice(&values[from..to]),
            (Self::Boolean(column), Values::Boolean(values)) => column.extend_from_slice(&values[from..to]),
            (Self::Text(column), Values::Text(values)) => {
                column.extend(values[from..to].iter().map(|&text| text.into()))
            }
            _ => return false,
        }
        true
    }

    /// Encodes the values, and forgets them.
    fn flush(&mut self, column: &mut SerializedColumnWriter<'_>) -> Result<(), ParquetError> {
        match self {
            Self::Float(values) => column.typed::<DoubleType>().write_batch(values, None, None)?,
            Self::Integer(values) => column.typed::<Int64Type>().write_batch(values, None, None)?,
            Self::Boolean(values) => column.typed::<BoolType>().write_batch(values, None, None)?,
            Self::Text(values) => column.typed::<ByteArrayType>().write_batch(values, None, None)?,
        };
        match self {
            Self::Float(values) => values.clear(),
            Self::Integer(values) => values.clear(),
            Self::Boolean(values) => values.clear(),
            Self::Text(values) => values.clear(),
        }
        Ok(())
    }
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Float(values) => values.len(),
            Self::Integer(values) => values.len(),
            Self::Boolean(values) => values.len(),
            Self::Text(values) => values.len(),
        }
    }
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
        let file = AtomicFile::create(&path)?;
        let writer = schema(&columns)
            .and_then(|schema| {
                SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties(&columns, options)))
            })
            .map_err(|problem| write_error(&path, problem))?;
        let buffers = columns.iter().map(|column| Buffer::of(column.kind)).collect();
        Ok(Self { path, columns, buffers, rows: 0, row_group_rows: options.row_group_rows.max(1), writer })
    }

    /// Appends rows: one slice a column, in the order of the columns, all of one length.
    pub fn write(&mut self, values: &[Values<'_>]) -> Result<(), Error> {
        let bad = |problem| Error::BadBatch { path: self.path.clone(), problem };
        if values.len() != self.columns.len() {
            return Err(bad(format!("{} columns of values for {} columns", values.len(), self.columns.len())));
        }
        let Some(count) = values.first().map(Values::len) else { return Ok(()) };
        for ((column, buffer), values) in self.columns.iter().zip(&mut self.buffers).zip(values) {
            let (name, kind) = (&column.name, column.kind);
            if !buffer.append(values, 0, 0) {
                return Err(bad(format!("column `{name}` is {kind:?}, the values are of another kind")));
            }
            if values.len() != count {
                return Err(bad(format!("{} values of column `{name}`, {count} of the first", values.len())));
            }
        }
        let mut from = 0;
        while from < count {
            let to = count.min(from + self.row_group_rows - self.rows);
            for (buffer, values) in self.buffers.iter_mut().zip(values) {
                buffer.append(values, from, to);
            }
            self.rows += to - from;
            from = to;
            if self.rows == self.row_group_rows {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Writes the row group that is held.
    fn flush(&mut self) -> Result<(), Error> {
        let mut write = || {
            let mut group = self.writer.next_row_group()?;
            for buffer in &mut self.buffers {
                let Some(mut column) = group.next_column()? else { break };
                buffer.flush(&mut column)?;
                column.close()?;
            }
            group.close()
        };
        write().map_err(|problem| write_error(&self.path, problem))?;
        self.rows = 0;
        Ok(())
    }

    /// Completes the file and gives it its name.
    pub fn finish(mut self) -> Result<(), Error> {
        if self.rows > 0 {
            self.flush()?;
        }
        let Self { path, writer, .. } = self;
        let file = writer.into_inner().map_err(|problem| write_error(&path, problem))?;
        file.commit()
    }
}

/// An error when two columns have one name.
pub(crate) fn check_names(path: &Path, columns: &[WriteColumn]) -> Result<(), Error> {
    let mut seen = BTreeSet::new();
    match columns.iter().find(|column| !seen.insert(column.name.as_str())) {
        Some(column) => {
            Err(Error::BadBatch { path: path.into(), problem: format!("two columns named `{}`", column.name) })
        }
        None => Ok(()),
    }
}

fn schema(columns: &[WriteColumn]) -> Result<Type, ParquetError> {
    let field = |column: &WriteColumn| {
        let nanoseconds = || LogicalType::timestamp(false, TimeUnit::NANOS);
        let (physical, logical) = match column.kind {
            WriteKind::Float => (Physical::DOUBLE, None),
            WriteKind::Integer => (Physical::INT64, None),
            WriteKind::Stamp => (Physical::INT64, Some(nanoseconds())),
            WriteKind::Boolean => (Physical::BOOLEAN, None),
            WriteKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let builder = Type::primitive_type_builder(&column.name, physical);
        builder.with_repetition(Repetition::REQUIRED).with_logical_type(logical).build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<_, _>>()?;
    Type::group_type_builder("schema").with_fields(fields).build()
}

fn properties(columns: &[WriteColumn], options: &WriteOptions) -> WriterProperties {
    let compression =
        if options.compress { Compression::ZSTD(ZstdLevel::default()) } else { Compression::UNCOMPRESSED };
    // Other readers find the units here, too.
    let arrow = KeyValue::new(arrow_schema::KEY.to_owned(), arrow_schema::encode(columns));
    let pairs = options.metadata.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone()));
    let pairs = [arrow].into_iter().chain(pairs).collect();
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

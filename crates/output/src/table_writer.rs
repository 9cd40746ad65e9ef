//! Columns into a table file, Parquet or text by its name.

use std::path::{Path, PathBuf};

use crate::{
    csv_writer::CsvWriter,
    destination::is_stream,
    error::Error,
    write_column::WriteColumn,
    writer::{ParquetWriter, Values, WriteOptions},
};

/// Writes rows of columns into a file. Dropping it before [`TableWriter::finish`] leaves nothing behind.
#[derive(Debug)]
pub enum TableWriter {
    /// Parquet.
    Parquet(Box<ParquetWriter>),
    /// Delimited text, without the metadata.
    Csv(Box<CsvWriter>),
}

impl TableWriter {
    /// Begins a file of the format that its name gives: text for `.csv`, `.tsv` and `.txt`, and for a device or a pipe
    /// without an extension. Else Parquet.
    ///
    /// # Errors
    /// As [`ParquetWriter::create`].
    pub fn create(path: impl Into<PathBuf>, columns: Vec<WriteColumn>, options: &WriteOptions) -> Result<Self, Error> {
        let path = path.into();
        Ok(if is_text(&path) {
            Self::Csv(Box::new(CsvWriter::create(path, columns, &options.inputs)?))
        } else {
            Self::Parquet(Box::new(ParquetWriter::create(path, columns, options)?))
        })
    }

    /// Appends rows: one slice a column, in the order of the columns, all of one length.
    ///
    /// # Errors
    /// Values that do not fit the columns; refusals of the system.
    pub fn write(&mut self, values: &[Values<'_>]) -> Result<(), Error> {
        match self {
            Self::Parquet(writer) => writer.write(values),
            Self::Csv(writer) => writer.write(values),
        }
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// A refusal of the system; there is then no file.
    pub fn finish(self) -> Result<(), Error> {
        match self {
            Self::Parquet(writer) => writer.finish(),
            Self::Csv(writer) => writer.finish(),
        }
    }
}

/// Returns true if text is written: the name says so, or a device or a pipe has a name without an extension.
fn is_text(path: &Path) -> bool {
    match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("csv" | "tsv" | "txt") => true,
        Some("parquet" | "pq") => false,
        _ => is_stream(path),
    }
}

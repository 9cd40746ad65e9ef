//! Rows of truth into Parquet files.

use std::path::Path;

use fleetfoot_data::{Column, ColumnKind};
use fleetfoot_fit::Error;
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};

/// The column of the stamps.
pub(super) const TIME: &str = "t";

/// Rows that are held before they are handed on.
const ROWS: usize = 4096;

/// A run's Parquet file under construction.
pub(super) struct ParquetSink {
    writer: ParquetWriter,
    stamps: Vec<i64>,
    columns: Vec<Held>,
}

/// Values of a column that are not yet written.
enum Held {
    Float(Vec<f64>),
    Integer(Vec<i64>),
    Boolean(Vec<bool>),
    /// Codes, and their names.
    Category(Vec<usize>, Vec<String>),
}

impl ParquetSink {
    /// Begins a file of rows with these columns.
    pub(super) fn create(path: &Path, options: &WriteOptions, columns: &[Column]) -> Result<Self, Error> {
        let mut written = vec![WriteColumn::new(TIME, WriteKind::Stamp)];
        let mut held = Vec::with_capacity(columns.len());
        for column in columns {
            let (kind, values) = match &column.kind {
                ColumnKind::Float => (WriteKind::Float, Held::Float(Vec::with_capacity(ROWS))),
                ColumnKind::Integer => (WriteKind::Integer, Held::Integer(Vec::with_capacity(ROWS))),
                ColumnKind::Boolean => (WriteKind::Boolean, Held::Boolean(Vec::with_capacity(ROWS))),
                ColumnKind::Category(names) => {
                    (WriteKind::Text, Held::Category(Vec::with_capacity(ROWS), names.clone()))
                }
            };
            let plain = WriteColumn::new(&column.name, kind);
            written.push(column.unit.iter().fold(plain, |column, unit| column.with_unit(unit)));
            held.push(values);
        }
        let writer = ParquetWriter::create(path, written, options)?;
        Ok(Self { writer, stamps: Vec::with_capacity(ROWS), columns: held })
    }

    /// Appends a row; `stamp` in ns, a value a column.
    pub(super) fn row(&mut self, stamp: i64, values: &[f64]) -> Result<(), Error> {
        self.stamps.push(stamp);
        for (column, &value) in self.columns.iter_mut().zip(values) {
            match column {
                Held::Float(held) => held.push(value),
                Held::Integer(held) => held.push(value as i64),
                Held::Boolean(held) => held.push(value != 0.0),
                Held::Category(held, _) => held.push(value as usize),
            }
        }
        if self.stamps.len() == ROWS { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), Error> {
        let texts = self.columns.iter().map(|column| match column {
            Held::Category(codes, names) => {
                codes.iter().map(|&code| names.get(code).map_or("", String::as_str)).collect()
            }
            _ => Vec::new(),
        });
        let texts: Vec<Vec<&str>> = texts.collect();
        let mut values = vec![Values::Integer(&self.stamps)];
        values.extend(self.columns.iter().zip(&texts).map(|(column, texts)| match column {
            Held::Float(held) => Values::Float(held),
            Held::Integer(held) => Values::Integer(held),
            Held::Boolean(held) => Values::Boolean(held),
            Held::Category(..) => Values::Text(texts),
        }));
        self.writer.write(&values)?;
        self.stamps.clear();
        for column in &mut self.columns {
            match column {
                Held::Float(held) => held.clear(),
                Held::Integer(held) => held.clear(),
                Held::Boolean(held) => held.clear(),
                Held::Category(held, _) => held.clear(),
            }
        }
        Ok(())
    }

    /// Completes the file.
    pub(super) fn finish(mut self) -> Result<(), Error> {
        self.flush()?;
        Ok(self.writer.finish()?)
    }
}

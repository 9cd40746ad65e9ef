//! Bytes and values of one column chunk.

use std::{
    fs::File,
    io::{self, Read},
    sync::Arc,
};

use bytes::Bytes;
use parquet::{
    basic::Encoding,
    column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader},
    data_type::{
        BoolType, ByteArrayType, DataType, DoubleType, FixedLenByteArrayType, FloatType, Int32Type, Int64Type,
        Int96Type,
    },
    errors::{ParquetError, Result},
    file::{
        metadata::ColumnChunkMetaData,
        page_index::offset_index::PageLocation,
        reader::{ChunkReader, Length},
        serialized_reader::SerializedPageReader,
    },
    schema::types::ColumnDescPtr,
};

use super::buffers::Buffers;
use super::leaf::{Meaning, Rule, Word, decimal_bytes, half, int96_nanoseconds};
use crate::file_io::read_exact_at;

/// A file read at offsets.
#[derive(Debug)]
pub(super) struct FileBytes {
    pub file: Arc<File>,
    pub length: u64,
    pub buffers: Arc<Buffers>,
}

impl Length for FileBytes {
    fn len(&self) -> u64 {
        self.length
    }
}

impl ChunkReader for FileBytes {
    type T = HeaderReader;

    fn get_read(&self, start: u64) -> Result<HeaderReader> {
        // Used for page headers only: they are short, and a few KiB at once cost no more than a few bytes.
        let length = self.length.saturating_sub(start).min(2048) as usize;
        let rest = HeaderReader {
            buffer: self.get_bytes(start, length)?,
            at: 0,
            next: start + length as u64,
            file: self.file.clone(),
        };
        Ok(rest)
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        if start.checked_add(length as u64).is_none_or(|end| end > self.length) {
            return Err(ParquetError::EOF(format!(
                "{length} bytes at {start} lie outside the file of {} bytes",
                self.length
            )));
        }
        Ok(self.buffers.filled(length, |buffer| read_exact_at(&self.file, buffer, start))?)
    }
}

/// Reads on from an offset; the first bytes are there already.
#[derive(Debug)]
pub(super) struct HeaderReader {
    buffer: Bytes,
    at: usize,
    next: u64,
    file: Arc<File>,
}

impl Read for HeaderReader {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.at == self.buffer.len() {
            // A header with long statistics.
            let mut more = vec![0; 16 << 10];
            let read = read_some_at(&self.file, &mut more, self.next)?;
            more.truncate(read);
            self.next += read as u64;
            (self.buffer, self.at) = (more.into(), 0);
        }
        let count = out.len().min(self.buffer.len() - self.at);
        out[..count].copy_from_slice(&self.buffer[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}

fn read_some_at(file: &File, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
    let left = file.metadata()?.len().saturating_sub(offset);
    let count = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
    read_exact_at(file, &mut buffer[..count], offset)?;
    Ok(count)
}

/// Decodes one column chunk from its first row on.
pub(super) struct ChunkDecoder {
    values: Values,
    levels: Levels,
    /// Values of 32 bits as packed differences: see [`ChunkDecoder::skip`].
    packed: bool,
}

/// Values that are read at once where they cannot be skipped.
const SKIPPED: usize = 1 << 16;

/// Definition and repetition levels of the rows that were read last.
struct Levels {
    /// The definition level of a value that is there.
    full: i16,
    /// True of columns of lists.
    lists: bool,
    defined: Vec<i16>,
    repeated: Vec<i16>,
}

impl Levels {
    /// Reads rows into a buffer; answers rows and values.
    fn read<T: DataType>(
        &mut self,
        reader: &mut ColumnReaderImpl<T>,
        rows: usize,
        buffer: &mut Vec<T::T>,
    ) -> Result<(usize, usize)> {
        self.defined.clear();
        self.repeated.clear();
        let defined = (self.full > 0).then_some(&mut self.defined);
        let repeated = self.lists.then_some(&mut self.repeated);
        let (read, present, _) = reader.read_records(rows, defined, repeated, buffer)?;
        enough(read, rows)?;
        Ok((read, present))
    }
}

enum Values {
    Bool(ColumnReaderImpl<BoolType>, Vec<bool>),
    Int32(ColumnReaderImpl<Int32Type>, Vec<i32>),
    Int64(ColumnReaderImpl<Int64Type>, Vec<i64>),
    Int96(ColumnReaderImpl<Int96Type>, Vec<parquet::data_type::Int96>),
    Float(ColumnReaderImpl<FloatType>, Vec<f32>),
    Double(ColumnReaderImpl<DoubleType>, Vec<f64>),
    Bytes(ColumnReaderImpl<ByteArrayType>, Vec<parquet::data_type::ByteArray>),
    Fixed(ColumnReaderImpl<FixedLenByteArrayType>, Vec<parquet::data_type::FixedLenByteArray>),
}

impl ChunkDecoder {
    /// A decoder of a chunk of `rows` rows; `pages` are its page locations when the file has an offset index.
    pub(super) fn new(
        file: Arc<FileBytes>,
        chunk: &ColumnChunkMetaData,
        descriptor: ColumnDescPtr,
        rows: usize,
        pages: Option<Vec<PageLocation>>,
    ) -> Result<Self> {
        let (full, lists) = (descriptor.max_def_level(), descriptor.max_rep_level() > 0);
        let levels = Levels { full, lists, defined: Vec::new(), repeated: Vec::new() };
        let packed = chunk.encodings().any(|encoding| encoding == Encoding::DELTA_BINARY_PACKED);
        let pages = SerializedPageReader::new(file, chunk, rows, pages)?;
        let values = match get_column_reader(descriptor, Box::new(pages)) {
            ColumnReader::BoolColumnReader(reader) => Values::Bool(reader, Vec::new()),
            ColumnReader::Int32ColumnReader(reader) => Values::Int32(reader, Vec::new()),
            ColumnReader::Int64ColumnReader(reader) => Values::Int64(reader, Vec::new()),
            ColumnReader::Int96ColumnReader(reader) => Values::Int96(reader, Vec::new()),
            ColumnReader::FloatColumnReader(reader) => Values::Float(reader, Vec::new()),
            ColumnReader::DoubleColumnReader(reader) => Values::Double(reader, Vec::new()),
            ColumnReader::ByteArrayColumnReader(reader) => Values::Bytes(reader, Vec::new()),
            ColumnReader::FixedLenByteArrayColumnReader(reader) => Values::Fixed(reader, Vec::new()),
        };
        Ok(Self { values, levels, packed })
    }

    /// Skips rows.
    ///
    /// Packed differences of 32 bits are read: to skip them fails in the `parquet` crate (59.3) where equal steps pass the range of 32 bits.
    pub(super) fn skip(&mut self, rows: usize) -> Result<()> {
        let Self { values, levels, packed } = self;
        let skipped = match values {
            Values::Int32(reader, buffer) if *packed => {
                let mut left = rows;
                while left > 0 {
                    buffer.clear();
                    left -= levels.read(reader, left.min(SKIPPED), buffer)?.0;
                }
                Ok(rows)
            }
            Values::Bool(reader, _) => reader.skip_records(rows),
            Values::Int32(reader, _) => reader.skip_records(rows),
            Values::Int64(reader, _) => reader.skip_records(rows),
            Values::Int96(reader, _) => reader.skip_records(rows),
            Values::Float(reader, _) => reader.skip_records(rows),
            Values::Double(reader, _) => reader.skip_records(rows),
            Values::Bytes(reader, _) => reader.skip_records(rows),
            Values::Fixed(reader, _) => reader.skip_records(rows),
        }?;
        enough(skipped, rows)
    }

    /// Appends the next rows, converted.
    pub(super) fn read<W: Word>(&mut self, rows: usize, rule: &Rule, out: &mut Vec<W>) -> Result<()> {
        let Self { values, levels, .. } = self;
        let element = rule.element;
        match values {
            Values::Bool(reader, buffer) => {
                pull(reader, rows, element, levels, buffer, out, |&value| W::from_int(i64::from(value), rule))
            }
            Values::Int32(reader, buffer) => {
                let unsigned = matches!(rule.meaning, Meaning::Integer { unsigned: true });
                let widen = |value: i32| {
                    if unsigned { i64::from(value as u32) } else { i64::from(value) }
                };
                pull(reader, rows, element, levels, buffer, out, |&value| W::from_int(widen(value), rule))
            }
            Values::Int64(reader, buffer) => {
                pull(reader, rows, element, levels, buffer, out, |&value| W::from_int(value, rule))
            }
            Values::Int96(reader, buffer) => {
                pull(reader, rows, element, levels, buffer, out, |value| W::from_int(int96_nanoseconds(value), rule))
            }
            Values::Float(reader, buffer) => {
                pull(reader, rows, element, levels, buffer, out, |&value| W::from_float(f64::from(value), rule))
            }
            Values::Double(reader, buffer) => match W::as_doubles(out) {
                Some(doubles) if element.is_none() => pull_doubles(reader, rows, levels, doubles),
                _ => pull(reader, rows, element, levels, buffer, out, |&value| W::from_float(value, rule)),
            },
            Values::Bytes(reader, buffer) => match rule.meaning {
                Meaning::Decimal { scale } => pull(reader, rows, element, levels, buffer, out, |value| {
                    W::from_float(decimal_bytes(value.data(), scale), rule)
                }),
                _ => pull(reader, rows, element, levels, buffer, out, |value| W::from_text(value.data(), rule)),
            },
            Values::Fixed(reader, buffer) => match rule.meaning {
                Meaning::Decimal { scale } => pull(reader, rows, element, levels, buffer, out, |value| {
                    W::from_float(decimal_bytes(value.data(), scale), rule)
                }),
                _ => pull(reader, rows, element, levels, buffer, out, |value| W::from_float(half(value.data()), rule)),
            },
        }
    }

    /// The non-null texts of the next rows.
    pub(super) fn texts(&mut self, rows: usize, mut each: impl FnMut(&[u8])) -> Result<()> {
        let Values::Bytes(reader, buffer) = &mut self.values else {
            return Err(ParquetError::General("not a column of texts".into()));
        };
        buffer.clear();
        self.levels.read(reader, rows, buffer)?;
        buffer.iter().for_each(|text| each(text.data()));
        Ok(())
    }
}

fn enough(rows_there: usize, wanted: usize) -> Result<()> {
    if rows_there == wanted {
        Ok(())
    } else {
        Err(ParquetError::EOF(format!("{} rows are missing", wanted.saturating_sub(rows_there))))
    }
}

/// Reads rows and appends them converted, of lists one element each; nulls become [`Word::NONE`].
fn pull<T: DataType, W: Word>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    element: Option<usize>,
    levels: &mut Levels,
    buffer: &mut Vec<T::T>,
    out: &mut Vec<W>,
    convert: impl Fn(&T::T) -> W,
) -> Result<()> {
    buffer.clear();
    let (read, present) = levels.read(reader, rows, buffer)?;
    let full_level = levels.full;
    let mut values = buffer.iter();
    if let Some(element) = element {
        let (before, mut place) = (out.len(), 0);
        for (&level, &repeated) in levels.defined.iter().zip(&levels.repeated) {
            place += 1;
            if repeated == 0 {
                place = 0;
                out.push(W::NONE);
            }
            let value = if level == full_level { values.next() } else { None };
            if let Some((value, last)) = value.zip(out.last_mut()).filter(|_| place == element) {
                *last = convert(value);
            }
        }
        return enough(out.len() - before, rows);
    }
    if present == read {
        out.extend(buffer.iter().map(convert));
        return Ok(());
    }
    out.extend(
        levels.defined.iter().map(
            |&level| {
                if level == full_level { values.next().map_or(W::NONE, &convert) } else { W::NONE }
            },
        ),
    );
    Ok(())
}

/// Doubles go straight to where they are wanted; the columns of a log rarely have nulls, and then there is nothing more to do.
fn pull_doubles(
    reader: &mut ColumnReaderImpl<DoubleType>,
    rows: usize,
    levels: &mut Levels,
    out: &mut Vec<f64>,
) -> Result<()> {
    let start = out.len();
    let (read, present) = levels.read(reader, rows, out)?;
    if present == read {
        return Ok(());
    }
    // The values stand together at the front: spread them from the back, so that none is overwritten before it has moved.
    let mut from = out.len();
    out.resize(start + rows, f64::NAN);
    for (place, &level) in levels.defined.iter().enumerate().rev() {
        out[start + place] = if level == levels.full {
            from -= 1;
            out[from]
        } else {
            f64::NAN
        };
    }
    Ok(())
}

//! Parquet files, read in place.

pub(crate) mod arrow_schema;
mod buffers;
mod chunk;
mod clock;
mod cursors;
mod footer;
mod leaf;
mod open;

pub(crate) use cursors::Cursors;
pub(crate) use open::{MAX_CATEGORIES, describe, key_value, list, metadata, open};

use std::{
    fs::File,
    ops::Range,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
    time::SystemTime,
};

use fleetfoot_data::ScalarBuffer;
use parquet::{errors::ParquetError, file::metadata::ParquetMetaData};

use crate::{
    Error,
    table::{Table, TableColumn, TableRows},
};
use buffers::Buffers;
use chunk::{ChunkDecoder, FileBytes};
use cursors::{Cursor, Key, Turn};
use leaf::{Rule, Word};

/// Rows of a piece of the pass over the stamps.
const PIECE: usize = 1 << 19;

/// An open Parquet file: its metadata and what is wanted of it. The file itself is opened when a decoder is made, so that a recording of thousands of
/// files needs no thousands of handles.
pub(crate) struct ParquetTable {
    file: ParquetFile,
    cursors: Arc<Cursors>,
    /// The file's number among the cursors.
    number: u64,
    rows: usize,
    /// First rows of the row groups.
    starts: Vec<usize>,
    columns: Vec<TableColumn>,
    /// Leaf and conversion of the stamps.
    time: Option<(usize, Rule)>,
    /// Leaf and conversion of the columns.
    leaves: Vec<(usize, Rule)>,
}

/// A file with its checked metadata.
pub(crate) struct ParquetFile {
    path: PathBuf,
    metadata: Arc<ParquetMetaData>,
    length: u64,
    modified: Option<SystemTime>,
    buffers: Arc<Buffers>,
}

impl ParquetFile {
    /// Opens the file again, and makes sure that it is still the same.
    fn reopen(&self) -> Result<Arc<FileBytes>, Error> {
        let io = |source| Error::Io { path: self.path.clone(), action: "read", source };
        let file = File::open(&self.path).map_err(io)?;
        let now = file.metadata().map_err(io)?;
        if now.len() != self.length || now.modified().ok() != self.modified {
            return Err(Error::Damaged {
                path: self.path.clone(),
                place: "the whole file".into(),
                problem: "it changed while it was being read".into(),
                mend: "wait until it is written, and start again",
            });
        }
        Ok(Arc::new(FileBytes { file: Arc::new(file), length: self.length, buffers: self.buffers.clone() }))
    }

    fn group_rows(&self, group: usize) -> usize {
        self.metadata.row_group(group).num_rows() as usize
    }

    /// A decoder of a leaf at the beginning of a row group.
    fn decoder(&self, file: &Arc<FileBytes>, leaf: usize, group: usize) -> Result<ChunkDecoder, Error> {
        let chunk = self.metadata.row_group(group).column(leaf);
        let descriptor = self.metadata.file_metadata().schema_descr().column(leaf);
        let pages = open::page_locations(&self.metadata, group, leaf);
        self.guarded(leaf, group, || ChunkDecoder::new(file.clone(), chunk, descriptor, self.group_rows(group), pages))
    }

    /// Runs a decoder; what fails in it, or panics on bytes that it did not foresee, becomes an error that names the place.
    fn guarded<R>(
        &self,
        leaf: usize,
        group: usize,
        work: impl FnOnce() -> Result<R, ParquetError>,
    ) -> Result<R, Error> {
        let problem = match catch_unwind(AssertUnwindSafe(work)) {
            Ok(Ok(result)) => return Ok(result),
            Ok(Err(error)) => error.to_string(),
            Err(_) => "its pages cannot be decoded".into(),
        };
        let name = self.metadata.file_metadata().schema_descr().column(leaf).path().string();
        Err(Error::Damaged {
            path: self.path.clone(),
            place: format!("column `{name}`, row group {group}"),
            problem,
            mend: "copy or write the file again, or leave the column out",
        })
    }
}

/// The file, opened when the first decoder of a read needs it.
struct Handle<'a> {
    file: &'a ParquetFile,
    open: OnceLock<Arc<FileBytes>>,
}

impl Handle<'_> {
    fn get(&self) -> Result<Arc<FileBytes>, Error> {
        if let Some(open) = self.open.get() {
            return Ok(open.clone());
        }
        let open = self.file.reopen()?;
        Ok(self.open.get_or_init(|| open).clone())
    }
}

impl ParquetTable {
    /// Rows of a leaf, decoded on from where an earlier read stopped if possible.
    fn column<W: Word>(
        &self,
        turn: &Turn<'_>,
        handle: &Handle<'_>,
        order: usize,
        (leaf, rule): &(usize, Rule),
        rows: Range<usize>,
    ) -> Result<Vec<W>, Error> {
        let mut out = Vec::with_capacity(rows.len());
        let mut group = self.starts.partition_point(|&start| start <= rows.start) - 1;
        let mut at = rows.start;
        while at < rows.end {
            let start = self.starts[group];
            let end = start + self.file.group_rows(group);
            let to = rows.end.min(end);
            if at < to {
                let key = Key { file: self.number, leaf: *leaf, group };
                let mut cursor = match turn.take(order, key, start, at - start) {
                    Some(cursor) => cursor,
                    None => Cursor {
                        decoder: Some(self.file.decoder(&handle.get()?, *leaf, group)?),
                        row: 0,
                        tail: Vec::new(),
                    },
                };
                self.file.guarded(*leaf, group, || {
                    advance(&mut cursor, at - start..to - start, rule, turn.keep, &mut out)
                })?;
                if cursor.row == end - start {
                    cursor.decoder = None;
                }
                turn.put(key, cursor);
                at = to;
            }
            group += 1;
        }
        turn.done(order);
        Ok(out)
    }

    fn handle(&self) -> Handle<'_> {
        Handle { file: &self.file, open: OnceLock::new() }
    }
}

/// Appends rows of a row group, from the cursor's tail and then from its decoder.
fn advance<W: Word>(
    cursor: &mut Cursor,
    rows: Range<usize>,
    rule: &Rule,
    keep: usize,
    out: &mut Vec<W>,
) -> Result<(), ParquetError> {
    let before = out.len();
    let mut at = rows.start;
    if at < cursor.row {
        let tail_start = cursor.row - cursor.tail.len();
        let to = rows.end.min(cursor.row);
        out.extend(cursor.tail[at - tail_start..to - tail_start].iter().map(|&bits| W::from_bits(bits)));
        at = to;
    }
    if at < rows.end {
        let decoder = (cursor.decoder.as_mut()).ok_or_else(|| ParquetError::EOF("the row group is through".into()))?;
        if at > cursor.row {
            decoder.skip(at - cursor.row)?;
        }
        decoder.read(rows.end - at, rule, out)?;
        cursor.row = rows.end;
        let produced = &out[before..];
        cursor.tail.clear();
        cursor.tail.extend(produced[produced.len().saturating_sub(keep)..].iter().map(|&word| word.to_bits()));
    }
    Ok(())
}

impl Table for ParquetTable {
    fn rows(&self) -> usize {
        self.rows
    }

    fn columns(&self) -> &[TableColumn] {
        &self.columns
    }

    fn pieces(&self) -> Vec<Range<usize>> {
        let mut pieces = Vec::new();
        for (group, &start) in self.starts.iter().enumerate() {
            let end = start + self.file.group_rows(group);
            pieces.extend((start..end).step_by(PIECE).map(|from| from..(from + PIECE).min(end)));
        }
        pieces
    }

    fn stamps(&self, rows: Range<usize>) -> Result<ScalarBuffer<i64>, Error> {
        let Some(time) = &self.time else {
            return Ok(Vec::new().into());
        };
        let turn = self.cursors.begin(self.number, rows.clone(), 0);
        Ok(self.column(&turn, &self.handle(), 0, time, rows)?.into())
    }

    fn values(&self, rows: Range<usize>, keep: usize) -> Result<TableRows, Error> {
        let turn = self.cursors.begin(self.number, rows.clone(), keep);
        let handle = self.handle();
        let time = match &self.time {
            Some(time) => self.column(&turn, &handle, 0, time, rows.clone())?,
            None => Vec::new(),
        };
        let mut columns = Vec::with_capacity(self.leaves.len());
        for (order, leaf) in self.leaves.iter().enumerate() {
            columns.push(ScalarBuffer::from(self.column::<f64>(&turn, &handle, order + 1, leaf, rows.clone())?));
        }
        Ok(TableRows { time: time.into(), columns })
    }
}

/// A short text for messages about a file as a whole.
fn damaged(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> Error {
    Error::Damaged {
        path: path.into(),
        place: place.into(),
        problem: problem.into(),
        mend: "copy or write the file again",
    }
}

//! The rows of an open Parquet file, decoded on demand.

use std::{
    ops::Range,
    sync::{Arc, OnceLock},
};

use fleetfoot_data::ScalarBuffer;
use parquet::errors::ParquetError;

use super::{
    chunk::FileBytes,
    cursors::{Cursor, Cursors, Key, Turn},
    file::ParquetFile,
    leaf::{Rule, Word},
};
use crate::{
    Error, stamp,
    table::{Table, TableColumn, TableRows},
};

/// Rows of a piece of the pass over the stamps.
const PIECE: usize = 1 << 19;

/// An open Parquet file: its metadata and what is wanted of it. The file itself is opened when a decoder is made, so that a recording of thousands of
/// files needs no thousands of handles.
pub(super) struct ParquetTable {
    pub(super) file: ParquetFile,
    pub(super) cursors: Arc<Cursors>,
    /// The file's number among the cursors.
    pub(super) number: u64,
    pub(super) rows: usize,
    /// First rows of the row groups.
    pub(super) starts: Vec<usize>,
    pub(super) columns: Vec<TableColumn>,
    /// Leaves and conversions of the stamps; of several they are added up.
    pub(super) time: Vec<(usize, Rule)>,
    /// True if the first of them counts weeks of GPS.
    pub(super) gps_weeks: bool,
    /// Leaf and conversion of the columns.
    pub(super) leaves: Vec<(usize, Rule)>,
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
                let key = Key { file: self.number, order, group };
                let mut cursor = match turn.take(key, start, at - start) {
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

    /// The stamps of these rows; empty without a clock.
    fn sum_of_stamps(
        &self,
        turn: &Turn<'_>,
        handle: &Handle<'_>,
        rows: Range<usize>,
    ) -> Result<ScalarBuffer<i64>, Error> {
        let parts = self.time.iter().enumerate();
        let parts: Result<Vec<ScalarBuffer<i64>>, Error> = parts
            .map(|(order, part)| Ok(self.column::<i64>(turn, handle, order, part, rows.clone())?.into()))
            .collect();
        Ok(stamp::sum(parts?.into_iter(), self.gps_weeks))
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
        let turn = self.cursors.begin(self.number, rows.clone(), 0);
        self.sum_of_stamps(&turn, &self.handle(), rows)
    }

    fn values(&self, rows: Range<usize>, keep: usize) -> Result<TableRows, Error> {
        let turn = self.cursors.begin(self.number, rows.clone(), keep);
        let handle = self.handle();
        let time = self.sum_of_stamps(&turn, &handle, rows.clone())?;
        let mut columns = Vec::with_capacity(self.leaves.len());
        for (order, leaf) in self.leaves.iter().enumerate() {
            columns.push(ScalarBuffer::from(self.column::<f64>(
                &turn,
                &handle,
                order + self.time.len(),
                leaf,
                rows.clone(),
            )?));
        }
        Ok(TableRows { time, columns })
    }
}

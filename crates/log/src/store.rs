//! Decoded columns until they are read: in memory while they fit a budget, in an unnamed temporary file beyond it.

use std::{
    fs::File,
    io::{self, Write},
    ops::Range,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use fleetfoot_data::ScalarBuffer;

use crate::{
    Error,
    file_io::read_exact_at,
    table::{Table, TableColumn, TableRows},
};

/// Rows of a segment.
pub(crate) const SEGMENT: usize = 65_536;

/// Values that are turned from rows into columns at a time.
const TURNED: usize = 2048;

/// Bytes that all stores of a recording may hold in memory together.
#[derive(Debug)]
pub(crate) struct Budget {
    left: AtomicUsize,
}

impl Budget {
    pub(crate) fn new(bytes: usize) -> Self {
        Self { left: AtomicUsize::new(bytes) }
    }

    /// Takes `bytes` off the budget when they fit. Which store gets them depends on timing; what is read back does not.
    fn take(&self, bytes: usize) -> bool {
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(bytes)).is_ok()
    }

    fn give_back(&self, bytes: usize) {
        self.left.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// Columns of `f64` with a stamp a row, appended row by row and read by range.
#[derive(Debug)]
pub(crate) struct ColumnStore {
    /// The file that the rows come from, for messages.
    source: PathBuf,
    /// The columns by their places in the segments.
    order: Vec<usize>,
    rows: usize,
    segments: Vec<Segment>,
    spill: Option<File>,
    budget: Arc<Budget>,
    /// Bytes taken off the budget.
    held: usize,
}

impl Drop for ColumnStore {
    /// Returns the memory to the budget: columns that were only an intermediate result make room for the next.
    fn drop(&mut self) {
        self.budget.give_back(self.held);
    }
}

#[derive(Debug)]
enum Segment {
    /// Stamps and columns.
    Memory(ScalarBuffer<i64>, Vec<ScalarBuffer<f64>>),
    /// Offset in the spill file; stamps first, then column after column, little-endian, `rows` values each.
    Disk { offset: u64, rows: usize },
}

impl ColumnStore {
    /// The same rows with these columns, by their places among the present ones, in this order; places that there are not are left out.
    pub(crate) fn select(mut self, columns: &[usize]) -> Self {
        self.order = columns.iter().filter_map(|&column| self.order.get(column).copied()).collect();
        self
    }

    /// Rows held.
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// The segments as ranges of rows.
    pub(crate) fn pieces(&self) -> Vec<Range<usize>> {
        (0..self.rows).step_by(SEGMENT).map(|from| from..(from + SEGMENT).min(self.rows)).collect()
    }

    /// Stamps of a range of rows.
    pub(crate) fn stamps(&self, rows: Range<usize>) -> Result<ScalarBuffer<i64>, Error> {
        self.gather(rows, |segment, part| self.segment_stamps(segment, part))
    }

    /// Stamps and values of a range of rows; shared, not copied, within a segment in memory.
    pub(crate) fn values(&self, rows: Range<usize>) -> Result<TableRows, Error> {
        let columns = (self.order.iter())
            .map(|&c| self.gather(rows.clone(), |segment, part| self.segment_values(segment, c, part)))
            .collect::<Result<_, _>>()?;
        Ok(TableRows { time: self.stamps(rows)?, columns })
    }

    fn gather<T: arrow_buffer::ArrowNativeType>(
        &self,
        rows: Range<usize>,
        part_of: impl Fn(&Segment, Range<usize>) -> Result<ScalarBuffer<T>, Error>,
    ) -> Result<ScalarBuffer<T>, Error> {
        let mut parts = Vec::new();
        let mut at = rows.start;
        while at < rows.end {
            let (segment, within) = (at / SEGMENT, at % SEGMENT);
            let take = (SEGMENT - within).min(rows.end - at);
            parts.push(part_of(&self.segments[segment], within..within + take)?);
            at += take;
        }
        if parts.len() == 1 {
            return Ok(parts.remove(0));
        }
        let mut all = Vec::with_capacity(rows.len());
        parts.iter().for_each(|part| all.extend_from_slice(part));
        Ok(all.into())
    }

    fn segment_stamps(&self, segment: &Segment, part: Range<usize>) -> Result<ScalarBuffer<i64>, Error> {
        match segment {
            Segment::Memory(time, _) => Ok(time.slice(part.start, part.len())),
            Segment::Disk { offset, .. } => {
                let bytes = self.read_spill(offset + 8 * part.start as u64, 8 * part.len())?;
                Ok(bytes.chunks_exact(8).map(|word| i64::from_le_bytes(array(word))).collect::<Vec<_>>().into())
            }
        }
    }

    fn segment_values(&self, segment: &Segment, column: usize, part: Range<usize>) -> Result<ScalarBuffer<f64>, Error> {
        match segment {
            Segment::Memory(_, columns) => Ok(columns[column].slice(part.start, part.len())),
            Segment::Disk { offset, rows } => {
                let at = offset + 8 * ((1 + column) * rows + part.start) as u64;
                let bytes = self.read_spill(at, 8 * part.len())?;
                Ok(bytes.chunks_exact(8).map(|word| f64::from_le_bytes(array(word))).collect::<Vec<_>>().into())
            }
        }
    }

    fn read_spill(&self, offset: u64, length: usize) -> Result<Vec<u8>, Error> {
        let mut bytes = vec![0; length];
        let read = match &self.spill {
            Some(file) => read_exact_at(file, &mut bytes, offset),
            None => Err(io::Error::other("the temporary file is gone")),
        };
        read.map_err(|source| spill_error(&self.source, source))?;
        Ok(bytes)
    }
}

fn fill(bytes: &mut [u8], words: impl Iterator<Item = [u8; 8]>) {
    bytes.as_chunks_mut::<8>().0.iter_mut().zip(words).for_each(|(slot, word)| *slot = word);
}

/// The decoded columns of a file with their descriptions.
pub(crate) struct StoredTable {
    pub store: ColumnStore,
    pub columns: Vec<TableColumn>,
    /// True if the rows have stamps.
    pub has_time: bool,
}

impl Table for StoredTable {
    fn rows(&self) -> usize {
        self.store.rows()
    }

    fn columns(&self) -> &[TableColumn] {
        &self.columns
    }

    fn pieces(&self) -> Vec<Range<usize>> {
        self.store.pieces()
    }

    fn stamps(&self, rows: Range<usize>) -> Result<ScalarBuffer<i64>, Error> {
        if self.has_time { self.store.stamps(rows) } else { Ok(Vec::new().into()) }
    }

    fn values(&self, rows: Range<usize>, _keep: usize) -> Result<TableRows, Error> {
        self.store.values(rows)
    }
}

fn array(word: &[u8]) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(word);
    bytes
}

fn spill_error(path: &Path, source: io::Error) -> Error {
    Error::Io {
        path: path.into(),
        action: "keep its decoded columns in a temporary file (TMPDIR sets the folder)",
        source,
    }
}

/// Fills a [`ColumnStore`].
pub(crate) struct StoreBuilder {
    store: ColumnStore,
    time: Vec<i64>,
    values: Vec<Vec<f64>>,
    spilled: u64,
}

impl StoreBuilder {
    /// A store of `columns` columns of the file `source`.
    pub(crate) fn new(source: &Path, columns: usize, budget: Arc<Budget>) -> Self {
        let store = ColumnStore {
            source: source.into(),
            order: (0..columns).collect(),
            rows: 0,
            segments: Vec::new(),
            spill: None,
            budget,
            held: 0,
        };
        Self { store, time: Vec::new(), values: vec![Vec::new(); columns], spilled: 0 }
    }

    /// Adds a row, with one value a column.
    pub(crate) fn push(&mut self, stamp: i64, row: &[f64]) -> Result<(), Error> {
        self.time.push(stamp);
        for (column, &value) in self.values.iter_mut().zip(row) {
            column.push(value);
        }
        if self.time.len() == SEGMENT { self.close_segment() } else { Ok(()) }
    }

    /// Adds rows whose values stand row by row.
    pub(crate) fn push_rows(&mut self, mut stamps: &[i64], mut rows: &[f64]) -> Result<(), Error> {
        let width = self.values.len();
        while !stamps.is_empty() {
            // Few enough rows to stay in the nearest cache while column after column picks its values.
            let room = (SEGMENT - self.time.len()).min(TURNED.div_ceil(width.max(1))).min(stamps.len());
            let (now, later) = stamps.split_at(room);
            let (values, rest) = rows.split_at(rows.len().min(room * width));
            self.time.extend_from_slice(now);
            for (c, column) in self.values.iter_mut().enumerate() {
                column.extend(values.chunks_exact(width).map(|row| row[c]));
            }
            (stamps, rows) = (later, rest);
            if self.time.len() == SEGMENT {
                self.close_segment()?;
            }
        }
        Ok(())
    }

    /// Adds rows whose values stand column by column.
    pub(crate) fn push_columns(&mut self, stamps: &[i64], columns: &[Vec<f64>]) -> Result<(), Error> {
        let mut at = 0;
        while at < stamps.len() {
            let to = stamps.len().min(at + (SEGMENT - self.time.len()));
            self.time.extend_from_slice(&stamps[at..to]);
            for (column, values) in self.values.iter_mut().zip(columns) {
                column.extend_from_slice(&values[at..to]);
            }
            at = to;
            if self.time.len() == SEGMENT {
                self.close_segment()?;
            }
        }
        Ok(())
    }

    fn close_segment(&mut self) -> Result<(), Error> {
        let rows = self.time.len();
        if rows == 0 {
            return Ok(());
        }
        let (time, values) =
            (std::mem::take(&mut self.time), self.values.iter_mut().map(std::mem::take).collect::<Vec<_>>());
        let bytes = 8 * rows * (1 + values.len());
        let segment = if self.store.budget.take(bytes) {
            self.store.held += bytes;
            let shrink = |mut column: Vec<f64>| {
                column.shrink_to_fit();
                column.into()
            };
            if rows == SEGMENT {
                // More will come, as likely as not: room at once, so that growing copies nothing.
                self.time.reserve_exact(SEGMENT);
                self.values.iter_mut().for_each(|column| column.reserve_exact(SEGMENT));
            }
            Segment::Memory(time.into(), values.into_iter().map(shrink).collect())
        } else {
            let segment = self.spill(&time, &values).map_err(|source| spill_error(&self.store.source, source))?;
            // The next segment reuses the buffers.
            self.time = time;
            self.time.clear();
            self.values = values;
            self.values.iter_mut().for_each(Vec::clear);
            segment
        };
        self.store.segments.push(segment);
        self.store.rows += rows;
        Ok(())
    }

    fn spill(&mut self, time: &[i64], values: &[Vec<f64>]) -> io::Result<Segment> {
        let mut file = match self.store.spill.take() {
            Some(file) => file,
            None => tempfile::tempfile()?,
        };
        let offset = self.spilled;
        let mut bytes = vec![0; 8 * time.len()];
        fill(&mut bytes, time.iter().map(|stamp| stamp.to_le_bytes()));
        file.write_all(&bytes)?;
        for column in values {
            fill(&mut bytes, column.iter().map(|value| value.to_le_bytes()));
            file.write_all(&bytes)?;
        }
        self.spilled += 8 * (time.len() * (1 + values.len())) as u64;
        self.store.spill = Some(file);
        Ok(Segment::Disk { offset, rows: time.len() })
    }

    /// The filled store.
    pub(crate) fn finish(mut self) -> Result<ColumnStore, Error> {
        self.close_segment()?;
        Ok(self.store)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(rows: usize, budget: usize) -> ColumnStore {
        let mut builder = StoreBuilder::new(Path::new("x.csv"), 2, Arc::new(Budget::new(budget)));
        for row in 0..rows {
            builder.push(row as i64 * 3, &[row as f64, -(row as f64)]).unwrap();
        }
        builder.finish().unwrap()
    }

    #[test]
    fn selected_columns_come_in_their_new_order() {
        for budget in [usize::MAX, 0] {
            let read = filled(5, budget).select(&[1, 0, 1]).select(&[2, 1, 7]).values(1..4).unwrap();
            assert_eq!(read.columns.iter().map(|column| column[1]).collect::<Vec<_>>(), [-2.0, 2.0]);
        }
    }

    #[test]
    fn batched_rows_equal_single_rows() {
        let rows = SEGMENT + 5000;
        let stamps: Vec<i64> = (0..rows as i64).map(|row| row * 3).collect();
        let columns: Vec<Vec<f64>> = [1.0, -1.0].map(|sign| (0..rows).map(|row| sign * row as f64).collect()).into();
        let flat: Vec<f64> = (0..rows).flat_map(|row| [row as f64, -(row as f64)]).collect();
        for budget in [usize::MAX, 0] {
            let expected = filled(rows, budget).values(0..rows).unwrap();
            for by_rows in [true, false] {
                let mut builder = StoreBuilder::new(Path::new("x.csv"), 2, Arc::new(Budget::new(budget)));
                for (from, to) in
                    [(0, 7), (7, 7), (7, 4000), (4000, SEGMENT), (SEGMENT, SEGMENT + 1), (SEGMENT + 1, rows)]
                {
                    if by_rows {
                        builder.push_rows(&stamps[from..to], &flat[2 * from..2 * to]).unwrap();
                    } else {
                        let part: Vec<Vec<f64>> = columns.iter().map(|column| column[from..to].to_vec()).collect();
                        builder.push_columns(&stamps[from..to], &part).unwrap();
                    }
                }
                let store = builder.finish().unwrap();
                assert_eq!(store.rows(), rows);
                let read = store.values(0..rows).unwrap();
                assert_eq!((read.time, read.columns), (expected.time.clone(), expected.columns.clone()));
            }
        }
    }

    #[test]
    fn rows_come_back_from_memory_and_from_the_spill_file() {
        let rows = 2 * SEGMENT + 100;
        // All in memory; the first segment only; nothing.
        for (budget, spilled) in [(usize::MAX, 0), (SEGMENT * 24 + 1, 1), (0, 3)] {
            let store = filled(rows, budget);
            assert_eq!(store.rows(), rows);
            assert_eq!(store.spill.is_some(), spilled > 0);
            for range in [0..10, SEGMENT - 5..SEGMENT + 5, SEGMENT - 1..2 * SEGMENT + 7, rows - 1..rows, 5..5] {
                let read = store.values(range.clone()).unwrap();
                assert_eq!(read.time.to_vec(), range.clone().map(|row| row as i64 * 3).collect::<Vec<_>>());
                assert_eq!(read.columns[1].to_vec(), range.map(|row| -(row as f64)).collect::<Vec<_>>());
            }
            assert_eq!(store.pieces().len(), 3);
        }
    }
}

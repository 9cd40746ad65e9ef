//! Decoders that keep their position, so that a scan in chunks decompresses every page once.
//!
//! A Parquet page holds far more or fewer rows than a chunk, and a column's dictionary comes before all its pages. A
//! range that is decoded from the start pays for both. So each column's decoder is put back at the row where it
//! stopped, with the last few values for the next halo. Threads that scan neighbouring chunks follow each other through
//! the columns: while the first decodes column 3 of its chunk, the second goes on with column 2. A read waits only for
//! reads that begin at an earlier row of the same file. These never wait for it, so no circle can form.

use std::{
    ops::Range,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
};

use super::{buffers::Buffers, chunk::ChunkDecoder};

/// Values kept behind a decoder's place at least.
const TAIL: usize = 64;

/// The decoder's file, its place among the columns of a read, and its row group.
///
/// The leaf would not do instead of the place: the clock's leaf may be a column too, which another rule converts, and a tail holds converted values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Key {
    pub file: u64,
    pub order: usize,
    pub group: usize,
}

/// A decoder and where it stands.
pub(super) struct Cursor {
    /// Dropped with its pages and buffers once the row group is through: the tail may still be wanted.
    pub decoder: Option<ChunkDecoder>,
    /// The next row of the row group that it will decode.
    pub row: usize,
    /// The bits of the values before that row.
    pub tail: Vec<u64>,
}

/// The cursors of a recording, shared by its files and threads.
pub(crate) struct Cursors {
    state: Mutex<State>,
    changed: Condvar,
    capacity: usize,
    pub(super) buffers: Arc<Buffers>,
}

#[derive(Default)]
struct State {
    idle: Vec<(Key, Cursor)>,
    reads: Vec<Read>,
    next: u64,
}

/// A read under way.
struct Read {
    id: u64,
    file: u64,
    rows: Range<usize>,
    /// Columns that it is through with.
    done: usize,
}

/// Registers a read as long as it lives.
pub(super) struct Turn<'a> {
    cursors: &'a Cursors,
    id: u64,
    file: u64,
    from: usize,
    pub(super) keep: usize,
}

impl Cursors {
    /// Room for the decoders of recordings with so many columns, stamps included.
    pub(crate) fn new(columns: usize) -> Self {
        Self {
            state: Mutex::default(),
            changed: Condvar::new(),
            capacity: (columns + columns / 2).max(64),
            buffers: Arc::default(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic while the lock was held cannot leave more than a cursor too few.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A number for a file.
    pub(super) fn new_file(&self) -> u64 {
        let mut state = self.lock();
        state.next += 1;
        state.next
    }

    /// Begins a read of these rows of a file.
    pub(super) fn begin(&self, file: u64, rows: Range<usize>, keep: usize) -> Turn<'_> {
        let mut state = self.lock();
        state.next += 1;
        let id = state.next;
        let from = rows.start;
        state.reads.push(Read { id, file, rows, done: 0 });
        Turn { cursors: self, id, file, from, keep: keep.max(TAIL) }
    }
}

impl Turn<'_> {
    /// The best decoder for the row `row` of a row group that begins at `group_start`.
    ///
    /// Waits for a read that is about to leave its decoder there.
    pub(super) fn take(&self, key: Key, group_start: usize, row: usize) -> Option<Cursor> {
        let mut state = self.cursors.lock();
        while state.reads.iter().any(|read| {
            let ahead =
                read.file == self.file && read.rows.start < self.from && read.done <= key.order && read.id != self.id;
            let reaches = read.rows.end > group_start && (self.from..=self.from + self.keep).contains(&read.rows.end);
            ahead && reaches
        }) {
            state = self.cursors.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        let usable = |cursor: &Cursor| cursor.row - cursor.tail.len() <= row;
        let best = state
            .idle
            .iter()
            .enumerate()
            .filter(|(_, (cached_key, cursor))| *cached_key == key && usable(cursor))
            .max_by_key(|(_, (_, cursor))| cursor.row);
        let at = best.map(|(at, _)| at)?;
        Some(state.idle.remove(at).1)
    }

    /// Puts a decoder back, the one that was not used for longest making room.
    pub(super) fn put(&self, key: Key, cursor: Cursor) {
        let mut state = self.cursors.lock();
        state.idle.push((key, cursor));
        if state.idle.len() > self.cursors.capacity {
            state.idle.remove(0);
        }
    }

    /// The `order`-th column is read.
    pub(super) fn done(&self, order: usize) {
        let mut state = self.cursors.lock();
        if let Some(read) = state.reads.iter_mut().find(|read| read.id == self.id) {
            read.done = order + 1;
        }
        drop(state);
        self.cursors.changed.notify_all();
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.cursors.lock().reads.retain(|read| read.id != self.id);
        self.cursors.changed.notify_all();
    }
}

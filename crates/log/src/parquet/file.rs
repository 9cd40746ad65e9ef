//! A Parquet file with its checked metadata, and decoders of its columns.

use std::{
    fs::File,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::Arc,
    time::SystemTime,
};

use parquet::{
    errors::ParquetError,
    file::{metadata::ParquetMetaData, page_index::offset_index::PageLocation},
};

use super::{
    buffers::Buffers,
    chunk::{ChunkDecoder, FileBytes},
    leaf::Leaf,
};
use crate::Error;

/// A file with its checked metadata.
pub(super) struct ParquetFile {
    pub(super) path: PathBuf,
    pub(super) metadata: Arc<ParquetMetaData>,
    pub(super) length: u64,
    pub(super) modified: Option<SystemTime>,
    pub(super) buffers: Arc<Buffers>,
}

impl ParquetFile {
    /// Opens the file again, and makes sure that it is still the same.
    pub(super) fn reopen(&self) -> Result<Arc<FileBytes>, Error> {
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

    pub(super) fn group_rows(&self, group: usize) -> usize {
        self.metadata.row_group(group).num_rows() as usize
    }

    /// A decoder of a leaf at the beginning of a row group.
    pub(super) fn decoder(&self, file: &Arc<FileBytes>, leaf: usize, group: usize) -> Result<ChunkDecoder, Error> {
        let chunk = self.metadata.row_group(group).column(leaf);
        let descriptor = self.metadata.file_metadata().schema_descr().column(leaf);
        let pages = page_locations(&self.metadata, group, leaf);
        self.guarded(leaf, group, || ChunkDecoder::new(file.clone(), chunk, descriptor, self.group_rows(group), pages))
    }

    /// Runs a decoder; what fails in it, or panics on bytes that it did not foresee, becomes an error that names the place.
    pub(super) fn guarded<R>(
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

/// The page locations of a chunk, when they make sense.
fn page_locations(metadata: &ParquetMetaData, group: usize, leaf: usize) -> Option<Vec<PageLocation>> {
    let pages = metadata.offset_index()?.get(group)?.get(leaf)?.page_locations();
    let chunk = metadata.row_group(group);
    let (start, length) = chunk.column(leaf).byte_range();
    let end = start.checked_add(length)?;
    let (mut offset, mut row) = (start, -1);
    for page in pages {
        let at = u64::try_from(page.offset).ok()?;
        let size = u64::try_from(page.compressed_page_size).ok()?;
        if at < offset || at.checked_add(size)? > end || page.first_row_index <= row {
            return None;
        }
        (offset, row) = (at + size, page.first_row_index);
    }
    let first = pages.first()?;
    let sound = first.first_row_index == 0 && row < chunk.num_rows() && first.offset as u64 - start <= i32::MAX as u64;
    sound.then(|| pages.clone())
}

/// The chunks of a leaf lie inside the file and have as many values as the row group has rows.
pub(super) fn check_chunks(file: &ParquetFile, leaf: &Leaf) -> Result<(), Error> {
    for (number, group) in file.metadata.row_groups().iter().enumerate() {
        let place = || format!("column `{}`, row group {number}", leaf.name);
        let Some(chunk) = group.columns().get(leaf.index) else {
            return Err(damaged(&file.path, place(), "it is missing"));
        };
        let width = leaf.element.and_then(|element| i64::try_from(element.width).ok()).unwrap_or(1);
        if Some(chunk.num_values()) != group.num_rows().checked_mul(width) {
            let problem = format!("{} values in a group of {} rows", chunk.num_values(), group.num_rows());
            return Err(damaged(&file.path, place(), problem));
        }
        let start = chunk.dictionary_page_offset().unwrap_or(chunk.data_page_offset());
        let range = u64::try_from(start).ok().zip(u64::try_from(chunk.compressed_size()).ok());
        if range.and_then(|(start, length)| start.checked_add(length)).is_none_or(|end| end > file.length) {
            let problem =
                format!("{} bytes at {start} lie outside the file of {} bytes", chunk.compressed_size(), file.length);
            return Err(damaged(&file.path, place(), problem));
        }
    }
    Ok(())
}

/// A short text for messages about a file as a whole.
pub(super) fn damaged(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> Error {
    Error::Damaged {
        path: path.into(),
        place: place.into(),
        problem: problem.into(),
        mend: "copy or write the file again",
    }
}

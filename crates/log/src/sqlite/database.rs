//! Pages of a database file and of the write-ahead log beside it.

use std::path::{Path, PathBuf};

use super::write_ahead::{WriteAheadLog, beside};
use crate::{
    Compression, Error,
    container::{Kind, Map},
};

/// First bytes of a database.
const KIND: Kind = Kind { name: "SQLite", magic: b"SQLite format 3\0" };

/// Bytes of the file's header, on its first page before the page's own.
pub(super) const FILE_HEADER: usize = 100;

/// Encodings of text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TextEncoding {
    Utf8,
    Utf16 { big: bool },
}

/// An open database.
#[derive(Debug)]
pub(crate) struct Database {
    path: PathBuf,
    map: Map,
    page_size: usize,
    /// Bytes of a page without those reserved for extensions.
    pub(super) usable: usize,
    pub(super) encoding: TextEncoding,
    write_ahead: Option<WriteAheadLog>,
    /// Facts that a person should know.
    pub(crate) notes: Vec<String>,
}

impl Database {
    /// Opens a database, and the write-ahead log beside it where its writer has left one.
    ///
    /// # Errors
    /// A file that is not there or is no database, a header that contradicts itself.
    pub(crate) fn open(path: &Path, compression: Compression) -> Result<Self, Error> {
        let map = Map::open(path, compression, KIND)?;
        let wrong = |problem: &str| Error::WrongFormat {
            path: path.into(),
            problem: problem.to_owned(),
            mend: "copy it again, or recover it: `sqlite3 FILE .recover | sqlite3 NEW.db3`",
        };
        let header = map.first_chunk::<FILE_HEADER>().ok_or_else(|| wrong("the file ends inside its header"))?;
        let page_size = match u16::from_be_bytes([header[16], header[17]]) {
            1 => 1 << 16,
            size => usize::from(size),
        };
        let usable = page_size.saturating_sub(usize::from(header[20]));
        if !page_size.is_power_of_two() || page_size < 512 || usable < 480 {
            return Err(wrong("its header gives an invalid page size"));
        }
        let encoding = match header[59] {
            2 => TextEncoding::Utf16 { big: false },
            3 => TextEncoding::Utf16 { big: true },
            _ => TextEncoding::Utf8,
        };
        let mut notes = Vec::new();
        let write_ahead = WriteAheadLog::beside(path, page_size, &mut notes);
        if beside(path, "-journal").is_some_and(|journal| journal.metadata().is_ok_and(|data| data.len() > 512)) {
            notes.push(
                "a rollback journal lies beside it: its writer was stopped, and rows of its last transaction may be torn"
                    .to_owned(),
            );
        }
        Ok(Self { path: path.into(), map, page_size, usable, encoding, write_ahead, notes })
    }

    /// The file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Number of the last page that can be there.
    pub(super) fn pages(&self) -> usize {
        self.write_ahead.as_ref().map_or(0, WriteAheadLog::pages).max(self.file_pages())
    }

    /// Whole pages of the file.
    pub(crate) fn file_pages(&self) -> usize {
        self.map.len() / self.page_size
    }

    /// A page by its number, which begins at 1.
    pub(super) fn page(&self, number: u32) -> Option<&[u8]> {
        if let Some(page) = self.write_ahead.as_ref().and_then(|log| log.page(number)) {
            return Some(page);
        }
        let start = usize::try_from(number).ok()?.checked_sub(1)?.checked_mul(self.page_size)?;
        self.map.get(start..start.checked_add(self.page_size)?)
    }

    /// Place of a page in the file, bytes; for messages about damage.
    pub(crate) fn place(&self, number: u32) -> usize {
        (number as usize).saturating_sub(1).saturating_mul(self.page_size)
    }

    /// Bytes of a page.
    pub(crate) fn page_size(&self) -> usize {
        self.page_size
    }

    /// Why the bytes end before the file does, for a compressed file that is cut; or that the last page is not whole.
    pub(crate) fn cut(&self) -> Option<String> {
        let torn = !self.map.len().is_multiple_of(self.page_size);
        self.map.cut.clone().or_else(|| torn.then(|| "the file ends inside a page: it was cut".to_owned()))
    }

    /// Tells the system that what was read will not be needed soon.
    pub(crate) fn release(&self) {
        self.map.release(0..self.map.len());
    }

    /// The same of the stretch of the file that some pages lie in, with the overflow pages between them.
    pub(crate) fn release_around(&self, pages: &[u32]) {
        if let (Some(&first), Some(&last)) = (pages.iter().min(), pages.iter().max()) {
            let end = self.place(last).saturating_add(self.page_size).min(self.map.len());
            self.map.release(self.place(first)..end);
        }
    }
}

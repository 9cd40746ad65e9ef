//! The write-ahead log beside a database: pages that were committed and not yet moved into the file.

use std::{
    collections::HashMap,
    fs::File,
    path::{Path, PathBuf},
};

use memmap2::Mmap;

const HEADER: usize = 32;
const FRAME_HEADER: usize = 24;

/// First four bytes, without the lowest bit, which names the byte order of checksums.
const MAGIC: u32 = 0x377f_0682;

/// Committed pages.
#[derive(Debug)]
pub(super) struct WriteAheadLog {
    bytes: Mmap,
    page_size: usize,
    /// Offsets of the latest committed content of pages, by page number.
    places: HashMap<u32, usize>,
    /// Pages of the database at the last commit.
    pages: usize,
}

impl WriteAheadLog {
    /// The log beside a database of a page size; `None` where there is none, or where nothing in it was committed.
    pub(super) fn beside(database: &Path, page_size: usize, notes: &mut Vec<String>) -> Option<Self> {
        let file = File::open(beside(database, "-wal")?).ok()?;
        if file.metadata().ok()?.len() < (HEADER + FRAME_HEADER) as u64 {
            return None;
        }
        // SAFETY: as for the database itself (`container::Map`): every length is checked where it is used, and nothing that was read is believed
        // to be the same when it is read again.
        let bytes = unsafe { Mmap::map(&file) }.ok()?;
        let (places, pages) = committed(&bytes, page_size)?;
        notes.push(format!("{} pages are taken from the write-ahead log beside it", places.len()));
        Some(Self { bytes, page_size, places, pages })
    }

    pub(super) fn pages(&self) -> usize {
        self.pages
    }

    pub(super) fn page(&self, number: u32) -> Option<&[u8]> {
        let start = *self.places.get(&number)?;
        self.bytes.get(start..start + self.page_size)
    }
}

/// Places of the pages of all committed transactions, and the pages that the database has after the last.
fn committed(bytes: &[u8], page_size: usize) -> Option<(HashMap<u32, usize>, usize)> {
    let header = bytes.first_chunk::<HEADER>()?;
    let magic = word(header, 0)?;
    if magic & !1 != MAGIC || word(header, 8)? as usize != page_size {
        return None;
    }
    let mut sum = Checksum { big: magic & 1 == 1, a: 0, b: 0 };
    sum.add(header.get(..24)?);
    if (sum.a, sum.b) != (word(header, 24)?, word(header, 28)?) {
        return None;
    }
    let salts = header.get(16..24)?;
    let (mut places, mut pages) = (HashMap::new(), 0);
    let mut uncommitted: Vec<(u32, usize)> = Vec::new();
    for (at, frame) in
        (HEADER..).step_by(FRAME_HEADER + page_size).zip(bytes[HEADER..].chunks_exact(FRAME_HEADER + page_size))
    {
        let (head, page) = frame.split_at_checked(FRAME_HEADER)?;
        // Frames of an older round have other salts, those of a torn write another checksum.
        sum.add(head.get(..8)?);
        sum.add(page);
        if head.get(8..16)? != salts || (sum.a, sum.b) != (word(head, 16)?, word(head, 20)?) {
            break;
        }
        uncommitted.push((word(head, 0)?, at + FRAME_HEADER));
        let after = word(head, 4)?;
        if after != 0 {
            places.extend(uncommitted.drain(..));
            pages = after as usize;
        }
    }
    (!places.is_empty()).then_some((places, pages))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk::<4>()?))
}

/// Running checksum of the log, over pairs of words.
struct Checksum {
    big: bool,
    a: u32,
    b: u32,
}

impl Checksum {
    fn add(&mut self, bytes: &[u8]) {
        let read = |word: [u8; 4]| if self.big { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) };
        for &[a, b, c, d, e, f, g, h] in bytes.as_chunks::<8>().0 {
            self.a = self.a.wrapping_add(read([a, b, c, d])).wrapping_add(self.b);
            self.b = self.b.wrapping_add(read([e, f, g, h])).wrapping_add(self.a);
        }
    }
}

/// The file of a name that SQLite puts beside a database.
pub(super) fn beside(path: &Path, ending: &str) -> Option<PathBuf> {
    let mut name = path.file_name()?.to_owned();
    name.push(ending);
    Some(path.with_file_name(name)).filter(|path| path.is_file())
}

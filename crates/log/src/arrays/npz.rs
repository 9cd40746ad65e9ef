//! NumPy's `.npz`: a zip archive of `.npy` files, stored or deflated.

use std::{
    io::{Read, Write},
    ops::Range,
    path::Path,
    sync::Arc,
};

use super::{
    columns::Array,
    npy,
    table::{ArrayTable, common, left_out},
};
use crate::{Error, container::Map};

/// First bytes of an archive.
pub(super) const MAGIC: &[u8] = b"PK\x03\x04";

const END: &[u8] = b"PK\x05\x06";
const END64: &[u8] = b"PK\x06\x06";
const LOCATOR64: &[u8] = b"PK\x06\x07";
const ENTRY: &[u8] = b"PK\x01\x02";

/// Bytes of the archive's end, without the comment that may follow, of which there may be as many.
const END_BYTES: usize = 22;
const MAX_COMMENT: usize = 1 << 16;

/// Bytes that a file may unpack to, whatever its size; beyond, how many times its size.
const FREE_GROWTH: u64 = 1 << 30;
const MAX_RATIO: u64 = 1000;

/// A file of an archive.
#[derive(Debug, Clone)]
struct Entry {
    name: String,
    method: u16,
    sum: u32,
    packed: usize,
    unpacked: u64,
    /// Offset of its head.
    at: usize,
}

/// The table of an archive: the arrays of the most common number of rows.
///
/// # Errors
/// An archive without its list of files, or without arrays that are rows.
pub(super) fn table(path: &Path, map: Arc<Map>) -> Result<ArrayTable, Error> {
    let wrong = |problem: &str, mend| Error::WrongFormat { path: path.into(), problem: problem.into(), mend };
    let entries =
        entries(&map).ok_or_else(|| wrong("the list of files at its end is cut or damaged", "copy it again"))?;
    let limit = FREE_GROWTH.max((map.len() as u64).saturating_mul(MAX_RATIO));
    let (mut arrays, mut notes, mut damaged, mut strange): (Vec<Array>, _, _, _) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut total = 0_u64;
    for entry in &entries {
        let Some(name) = entry.name.strip_suffix(".npy") else {
            strange.push(entry.name.clone());
            continue;
        };
        total = total.saturating_add(entry.unpacked);
        if total > limit {
            return Err(wrong("it says that it unpacks to more than a thousand times its size", "save it again"));
        }
        let Some((map, place)) = unpacked(&map, entry) else {
            damaged.push(name.to_owned());
            continue;
        };
        let end = place.end;
        match npy::array(name.to_owned(), map, place) {
            Ok(array) => {
                let needed = npy::needed(&array).and_then(|needed| needed.checked_add(array.at));
                if needed.is_some_and(|needed| needed <= end) {
                    arrays.push(array);
                } else {
                    damaged.push(name.to_owned());
                }
            }
            Err(problem) => strange.push(format!("{name} ({problem})")),
        }
    }
    let rows = common(arrays.iter().filter_map(|array| array.shape.first().copied())).unwrap_or(0);
    let (columns, others): (Vec<Array>, Vec<Array>) =
        arrays.into_iter().partition(|array| array.shape.first() == Some(&rows));
    let others: Vec<String> =
        others.iter().map(|other_array| format!("{} ({})", other_array.name, other_array.dimensions())).collect();
    notes.extend(left_out(&damaged, "they are damaged"));
    notes.extend(left_out(&strange, "they are not arrays of numbers"));
    notes.extend(left_out(&others, &format!("they do not have {rows} rows")));
    let columns: Vec<(Array, usize)> = columns.into_iter().map(|array| (array, 0)).collect();
    ArrayTable::new(path, rows, &columns, notes)
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> Option<u64> {
    let bytes: &[u8; N] = bytes.get(at..)?.first_chunk()?;
    Some(bytes.iter().rev().fold(0, |all, &byte| all << 8 | u64::from(byte)))
}

fn place(number: Option<u64>) -> Option<usize> {
    usize::try_from(number?).ok()
}

/// The files of an archive, by the list at its end.
fn entries(bytes: &[u8]) -> Option<Vec<Entry>> {
    let tail = bytes.len().saturating_sub(END_BYTES + MAX_COMMENT);
    let end = tail + memchr::memmem::rfind(bytes.get(tail..)?, END)?;
    let (mut count, mut at) = (number::<2>(bytes, end + 10)?, place(number::<4>(bytes, end + 16))?);
    if let Some(locator) =
        end.checked_sub(20).filter(|&at| bytes.get(at..).is_some_and(|rest| rest.starts_with(LOCATOR64)))
    {
        let end = place(number::<8>(bytes, locator + 8))?;
        if bytes.get(end..)?.starts_with(END64) {
            (count, at) = (number::<8>(bytes, end + 32)?, place(number::<8>(bytes, end + 48))?);
        }
    }
    let mut all = Vec::new();
    for _ in 0..count {
        if !bytes.get(at..)?.starts_with(ENTRY) {
            return None;
        }
        let field = |offset: usize| number::<4>(bytes, at + offset);
        let length = |offset: usize| place(number::<2>(bytes, at + offset));
        let (name, extra, comment) = (length(28)?, length(30)?, length(32)?);
        let name_bytes = bytes.get(at + 46..at + 46 + name)?;
        let mut sizes = [field(24)?, field(20)?, field(42)?];
        wide(bytes.get(at + 46 + name..at + 46 + name + extra)?, &mut sizes);
        let [unpacked, packed, head] = sizes;
        all.push(Entry {
            name: String::from_utf8_lossy(name_bytes).into_owned(),
            method: number::<2>(bytes, at + 10)? as u16,
            sum: field(16)? as u32,
            packed: place(Some(packed))?,
            unpacked,
            at: place(Some(head))?,
        });
        at += 46 + name + extra + comment;
    }
    Some(all)
}

/// Puts numbers of eight bytes from an entry's extra fields in the place of those that four cannot hold.
fn wide(mut extra: &[u8], sizes: &mut [u64; 3]) {
    while let (Some(kind), Some(size)) = (number::<2>(extra, 0), place(number::<2>(extra, 2))) {
        let Some(field) = extra.get(4..4 + size) else { return };
        if kind == 1 {
            let mut at = 0;
            for value in sizes.iter_mut().filter(|value| **value == u64::from(u32::MAX)) {
                let Some(number) = number::<8>(field, at) else { return };
                *value = number;
                at += 8;
            }
        }
        extra = extra.get(4 + size..).unwrap_or_default();
    }
}

/// The bytes of a file: in the archive where they are stored, else unpacked into a temporary file. `None` where they are damaged.
fn unpacked(map: &Arc<Map>, entry: &Entry) -> Option<(Arc<Map>, Range<usize>)> {
    let (name, extra) = (place(number::<2>(map, entry.at + 26))?, place(number::<2>(map, entry.at + 28))?);
    let begin = entry.at.checked_add(30 + name + extra)?;
    let place = begin..begin.checked_add(entry.packed)?;
    let bytes = map.get(place.clone())?;
    match entry.method {
        0 => (crc32fast::hash(bytes) == entry.sum).then(|| (map.clone(), place)),
        8 => {
            let (map, sum) = inflated(flate2::read::DeflateDecoder::new(bytes), entry.unpacked)?;
            let end = map.len();
            (sum == entry.sum && end as u64 == entry.unpacked).then(|| (Arc::new(map), 0..end))
        }
        _ => None,
    }
}

/// Decoded bytes in a temporary file, at most `limit + 1`, with their checksum; `None` if empty or not writable.
pub(super) fn inflated(mut input: impl Read, limit: u64) -> Option<(Map, u32)> {
    let mut file = tempfile::tempfile().ok()?;
    let (mut buffer, mut sum, mut total) = (vec![0; 1 << 18], crc32fast::Hasher::new(), 0_u64);
    // Bytes before a damaged place are kept: callers check the length.
    while let Ok(count @ 1..) = input.read(&mut buffer) {
        let part = buffer.get(..count)?;
        sum.update(part);
        file.write_all(part).ok()?;
        total += count as u64;
        if total > limit {
            break;
        }
    }
    if total == 0 {
        return None;
    }
    Some((Map::unnamed(&file).ok()?, sum.finalize()))
}

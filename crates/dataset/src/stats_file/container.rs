//! Sections with checksums: the outside of a `.stats` file.
//!
//! ```text
//! magic (8) | version u32 | sections u32 | section ... | blake3 of all before (32)
//! section: name (8, padded with zeros) | length u64 | crc32 of name, length and payload | payload
//! ```
//!
//! All numbers are little-endian. The hash at the end tells that a byte is wrong, a section's checksum tells where. The first twelve bytes and the
//! hash at the end stay as they are in every version, so that a newer file is told from a damaged one.

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
};

use crate::statistic_error::{OLDEST, StatisticError, VERSION};

/// The first bytes. The first is no text, the last is changed by transfers that think it is.
const MAGIC: [u8; 8] = *b"\x8fFFSTAT\n";
const HEAD: usize = 16;
const SECTION_HEAD: usize = 20;
const HASH: usize = 32;

/// Bytes of a file, in all and by section.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Sizes {
    /// The whole file.
    pub total: u64,
    /// Name and bytes of every section.
    pub sections: Vec<(String, u64)>,
}

/// A file of sections under construction.
pub(crate) struct Writer<W> {
    inner: W,
    hasher: blake3::Hasher,
    left: u32,
    sizes: Sizes,
}

impl<W: Write> Writer<W> {
    /// Begins a file of `sections` sections.
    pub(crate) fn new(inner: W, sections: u32) -> io::Result<Self> {
        let mut writer = Self { inner, hasher: blake3::Hasher::new(), left: sections, sizes: Sizes::default() };
        writer.put(&MAGIC)?;
        writer.put(&VERSION.to_le_bytes())?;
        writer.put(&sections.to_le_bytes())?;
        Ok(writer)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.sizes.total += bytes.len() as u64;
        self.inner.write_all(bytes)
    }

    /// Writes one section; names have up to eight bytes.
    pub(crate) fn section(&mut self, name: &str, payload: &[u8]) -> io::Result<()> {
        self.left -= 1;
        let (name_bytes, length) = (padded(name), (payload.len() as u64).to_le_bytes());
        self.put(&name_bytes)?;
        self.put(&length)?;
        self.put(&checksum(&name_bytes, &length, payload).to_le_bytes())?;
        self.put(payload)?;
        self.sizes.sections.push((name.to_owned(), (SECTION_HEAD + payload.len()) as u64));
        Ok(())
    }

    /// Ends the file; tells its sizes.
    pub(crate) fn finish(mut self) -> io::Result<(W, Sizes)> {
        debug_assert_eq!(self.left, 0, "as many sections as were announced");
        let hash = self.hasher.finalize();
        self.inner.write_all(hash.as_bytes())?;
        self.inner.flush()?;
        self.sizes.total += HASH as u64;
        Ok((self.inner, self.sizes))
    }
}

fn padded(name: &str) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..name.len()].copy_from_slice(name.as_bytes());
    bytes
}

fn checksum(name: &[u8; 8], length: &[u8; 8], payload: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(name);
    hasher.update(length);
    hasher.update(payload);
    hasher.finalize()
}

/// Name and payload.
type Section<'a> = (String, &'a [u8]);

/// The sections of a file that was checked as a whole.
pub(super) struct Sections<'a> {
    path: PathBuf,
    /// The format.
    pub(super) version: u32,
    sections: std::vec::IntoIter<Section<'a>>,
    pub(super) sizes: Sizes,
}

impl<'a> Sections<'a> {
    /// Checks a file's bytes and finds its sections.
    pub(super) fn new(bytes: &'a [u8], path: &Path) -> Result<Self, StatisticError> {
        let damaged = |place: String, problem: &str| StatisticError::Damaged {
            path: path.to_owned(),
            place,
            problem: problem.to_owned(),
        };
        if bytes.len() < MAGIC.len() && MAGIC.starts_with(bytes) && !bytes.is_empty() {
            return Err(damaged("the beginning".into(), "the file ends there"));
        }
        if !bytes.starts_with(&MAGIC) {
            return Err(StatisticError::Foreign { path: path.to_owned() });
        }
        if bytes.len() < HEAD + HASH {
            return Err(damaged("the beginning".into(), "the file ends there"));
        }
        let (body, hash) = bytes.split_at(bytes.len() - HASH);
        let whole = blake3::hash(body).as_bytes() == hash;
        let version = word(body, MAGIC.len());
        if whole && version > VERSION {
            return Err(StatisticError::Newer { path: path.to_owned(), version });
        }
        if whole && version < OLDEST {
            return Err(StatisticError::Older { path: path.to_owned(), version });
        }
        let sections = walk(body).map_err(|(place, problem)| damaged(place, problem))?;
        if !whole {
            return Err(damaged("the file as a whole".into(), "its checksum differs"));
        }
        let sizes = Sizes {
            total: bytes.len() as u64,
            sections: sections
                .iter()
                .map(|(name, payload)| (name.clone(), (SECTION_HEAD + payload.len()) as u64))
                .collect(),
        };
        Ok(Self { path: path.to_owned(), version, sections: sections.into_iter(), sizes })
    }

    /// The next section, which must have this name.
    pub(super) fn next(&mut self, name: &str) -> Result<&'a [u8], StatisticError> {
        match self.sections.next() {
            Some((next_name, payload)) if next_name == name => Ok(payload),
            Some((next_name, _)) => Err(self.damaged(&next_name, &format!("section `{name}` should stand here"))),
            None => Err(self.damaged("the end", &format!("section `{name}` is missing"))),
        }
    }

    /// That there are no more sections.
    pub(super) fn end(&mut self) -> Result<(), StatisticError> {
        match self.sections.next() {
            None => Ok(()),
            Some((name, _)) => Err(self.damaged(&name, "this section should not be there")),
        }
    }

    pub(super) fn damaged(&self, place: &str, problem: &str) -> StatisticError {
        StatisticError::Damaged { path: self.path.clone(), place: place.to_owned(), problem: problem.to_owned() }
    }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes[at..].first_chunk().map_or(0, |word| u32::from_le_bytes(*word))
}

/// The sections, each as long as it says and with its checksum; else where it is not.
fn walk(body: &[u8]) -> Result<Vec<Section<'_>>, (String, &'static str)> {
    let mut rest = &body[HEAD..];
    let mut sections = Vec::new();
    while !rest.is_empty() {
        let at = body.len() - rest.len();
        let place = |name: &str| format!("section `{name}` at byte {at}");
        let name = rest.first_chunk::<8>().ok_or_else(|| (place("?"), "the file ends there"))?;
        let text: String = name.iter().take_while(|&&byte| byte != 0).map(|&byte| char::from(byte)).collect();
        let head = rest.first_chunk::<SECTION_HEAD>().ok_or_else(|| (place(&text), "the file ends there"))?;
        let mut length = [0; 8];
        length.copy_from_slice(&head[8..16]);
        let payload = usize::try_from(u64::from_le_bytes(length)).ok().and_then(|n| rest[SECTION_HEAD..].get(..n));
        let payload = payload.ok_or_else(|| (place(&text), "the file ends there"))?;
        if checksum(name, &length, payload) != word(head, 16) {
            return Err((place(&text), "its checksum differs"));
        }
        rest = &rest[SECTION_HEAD + payload.len()..];
        sections.push((text, payload));
    }
    if sections.len() as u64 != u64::from(word(body, 12)) {
        return Err(("the end".to_owned(), "sections are missing"));
    }
    Ok(sections)
}
/// A file of these sections, with right checksums whatever they hold: for tests of files that lie.
///
/// # Errors
/// Those of writing, of which there are none in memory.
#[doc(hidden)]
pub fn of_sections(sections: &[(&str, Vec<u8>)]) -> std::io::Result<Vec<u8>> {
    let mut writer = Writer::new(Vec::new(), sections.len() as u32)?;
    for (name, payload) in sections {
        writer.section(name, payload)?;
    }
    Ok(writer.finish()?.0)
}

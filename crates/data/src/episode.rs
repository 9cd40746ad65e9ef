//! Episodes: one uninterrupted recording each, with an identity that follows the data and not the file.

use std::{collections::BTreeMap, fmt, ops::Range, path::PathBuf, str::FromStr};

use crate::{Block, Column, Error, Mark};

/// One uninterrupted recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Identity by content.
    pub id: EpisodeId,
    /// For people: the file's name, with `#k` where a file holds several episodes.
    pub name: String,
    /// The file that it came from, where there is one.
    pub file: Option<PathBuf>,
    /// Labels given by the recipe.
    pub labels: BTreeMap<String, String>,
    /// Number of rows.
    pub rows: usize,
    /// First stamp, nanoseconds.
    pub start: i64,
    /// Last stamp, nanoseconds.
    pub end: i64,
    /// Median sampling period, seconds; 0 for a single row.
    pub period: f64,
    /// Marks by which its rows are recognised in other logs.
    pub marks: Vec<Mark>,
}

impl Episode {
    /// Seconds from the first to the last stamp.
    pub fn duration(&self) -> f64 {
        (self.end - self.start) as f64 * 1e-9
    }

    /// Refuses a range of rows that it does not have; for sources, which read no other.
    ///
    /// # Errors
    /// A range that ends before it begins, or behind the last row.
    pub fn check(&self, range: &Range<usize>) -> Result<(), Error> {
        if range.start <= range.end && range.end <= self.rows {
            return Ok(());
        }
        let (start, end) = (range.start, range.end);
        Err(Error::OutOfRange { episode: self.name.clone(), start, end, rows: self.rows })
    }
}

/// The identity of an episode: 128 bits of a blake3 hash over its stamps and sampled values ([`Fingerprint`]).
///
/// It does not depend on the file's name, format or compression, nor on the rest of the file. An episode that was used
/// in training is recognised when it is scored, and cannot be counted twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EpisodeId(pub u128);

impl fmt::Display for EpisodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

impl FromStr for EpisodeId {
    type Err = std::num::ParseIntError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        u128::from_str_radix(text, 16).map(Self)
    }
}

/// Builds an [`EpisodeId`]: all stamps in order, then sampled blocks of values.
///
/// Columns are hashed in the order of their names, so the order of the request does not matter. All NaN are one value.
#[derive(Debug, Clone, Default)]
pub struct Fingerprint {
    hasher: blake3::Hasher,
    rows: u64,
}

impl Fingerprint {
    /// An empty fingerprint.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds consecutive stamps.
    pub fn stamps(&mut self, nanoseconds: &[i64]) {
        self.rows += nanoseconds.len() as u64;
        let mut bytes = [0u8; 8 * 256];
        for part in nanoseconds.chunks(256) {
            for (slot, stamp) in bytes.chunks_exact_mut(8).zip(part) {
                slot.copy_from_slice(&stamp.to_le_bytes());
            }
            self.hasher.update(&bytes[..8 * part.len()]);
        }
    }

    /// Adds the core rows of a sampled block. The caller samples the same rows for the same number of rows.
    pub fn sample(&mut self, columns: &[Column], block: &Block) {
        let mut order: Vec<usize> = (0..columns.len()).collect();
        order.sort_by(|&a, &b| columns[a].name.cmp(&columns[b].name));
        for c in order {
            self.hasher.update(columns[c].name.as_bytes());
            for &value in block.core(c) {
                let bits = if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
                self.hasher.update(&bits.to_le_bytes());
            }
        }
    }

    /// The identity and the marks of an episode of `rows` rows, whose stamps have gone in. `read` gives some of them.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn identify<E>(
        mut self,
        columns: &[Column],
        rows: usize,
        read: impl Fn(Range<usize>) -> Result<Block, E>,
    ) -> Result<(EpisodeId, Vec<Mark>), E> {
        let mut marks = Vec::new();
        let mut places = Mark::places(rows);
        for sampled in Self::sampled_rows(rows) {
            let block = read(sampled.clone())?;
            self.sample(columns, &block);
            let within = |place: &mut Range<usize>| sampled.start <= place.start && place.end <= sampled.end;
            marks.extend(places.extract_if(.., within).flat_map(|place| Mark::of(columns, &block, place)));
        }
        for place in places {
            marks.extend(Mark::of(columns, &read(place.clone())?, place));
        }
        marks.sort_unstable();
        Ok((self.finish(), marks))
    }

    /// The identity.
    pub fn finish(mut self) -> EpisodeId {
        self.hasher.update(&self.rows.to_le_bytes());
        let mut bytes = [0u8; 16];
        bytes.copy_from_slice(&self.hasher.finalize().as_bytes()[..16]);
        EpisodeId(u128::from_be_bytes(bytes))
    }

    /// The row ranges to sample of an episode of `rows` rows: its beginning, its middle and its end.
    pub fn sampled_rows(rows: usize) -> Vec<Range<usize>> {
        const RUN: usize = 512;
        if rows <= 3 * RUN {
            return std::iter::once(0..rows).collect();
        }
        let middle = rows / 2 - RUN / 2;
        vec![0..RUN, middle..middle + RUN, rows - RUN..rows]
    }
}

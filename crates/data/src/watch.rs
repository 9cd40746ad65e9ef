//! Rows that are recognised again: whether a part of an episode stands in another log.
//!
//! The identity of an episode ([`EpisodeId`](crate::EpisodeId)) is that of all its rows: the first half of a log is
//! another episode. Marks show that its rows are the same. Each is a hash over a few consecutive values of one field. A
//! reader of rows searches for known marks among them ([`Watch`]).

use std::{
    collections::{BTreeSet, HashMap},
    ops::Range,
    sync::{Mutex, PoisonError},
};

use crate::{
    Block, Column, Episode, Error, Halo, Source,
    mark::{FACTOR, VALUES, name_key, value_key},
    mix,
};

/// The rows of training episodes that another log is searched for.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Known {
    /// The names of the fields whose marks are known.
    pub fields: BTreeSet<String>,
    /// The marks of every episode.
    pub episodes: Vec<BTreeSet<u64>>,
}

/// Looks for known marks among the rows that are read.
#[derive(Debug)]
pub struct Watch {
    /// Number and name's part of the fields that have marks.
    fields: Vec<(usize, u64)>,
    /// The episodes of every mark that is searched for.
    wanted: HashMap<u64, Vec<usize>>,
    /// Marks that suffice, for every episode that is searched for.
    enough: Vec<usize>,
    /// A bit for the first bits of every mark: nearly all rows are dismissed by it.
    sieve: Vec<u64>,
    /// The episode that was read, and the mark that it has.
    seen: Mutex<BTreeSet<(usize, u64)>>,
}

const SIEVE_BITS: u32 = 16;

impl Watch {
    /// Looks for the rows of known episodes in a source of these columns; nothing where none of their fields is there.
    pub fn new(known: &Known, columns: &[Column]) -> Option<Self> {
        let fields: Vec<(usize, u64)> = (columns.iter().enumerate())
            .filter(|(_, column)| known.fields.contains(&column.name))
            .map(|(field, column)| (field, name_key(&column.name)))
            .collect();
        let mut wanted: HashMap<u64, Vec<usize>> = HashMap::new();
        let mut sieve = vec![0; 1 << (SIEVE_BITS - 6)];
        for (episode, marks) in known.episodes.iter().enumerate() {
            for &mark in marks {
                wanted.entry(mark).or_default().push(episode);
                let slot = mark >> (64 - SIEVE_BITS);
                sieve[(slot >> 6) as usize] |= 1 << (slot & 63);
            }
        }
        let enough = known.episodes.iter().map(|marks| marks.len().min(2)).collect();
        (!fields.is_empty() && !wanted.is_empty()).then(|| Self {
            fields,
            wanted,
            enough,
            sieve,
            seen: Mutex::new(BTreeSet::new()),
        })
    }

    /// Searches the rows of a block of an episode.
    fn look(&self, episode: usize, block: &Block) {
        // Factor of the first value of a window after the last value is added.
        let oldest = (0..VALUES).fold(1_u64, |power, _| power.wrapping_mul(FACTOR));
        let mut rows = Vec::new();
        for &(field, name) in &self.fields {
            let values = &block.columns[field];
            let mut sum = 0_u64;
            for (at, &value) in values.iter().enumerate() {
                sum = sum.wrapping_mul(FACTOR).wrapping_add(value_key(value));
                if at >= VALUES {
                    sum = sum.wrapping_sub(value_key(values[at - VALUES]).wrapping_mul(oldest));
                }
                let hash = mix(sum ^ name);
                let slot = hash >> (64 - SIEVE_BITS);
                let may_be = self.sieve[(slot >> 6) as usize] >> (slot & 63) & 1 == 1;
                if may_be && at + 1 >= VALUES && self.wanted.contains_key(&hash) {
                    rows.push((episode, hash));
                }
            }
        }
        if !rows.is_empty() {
            self.seen.lock().unwrap_or_else(PoisonError::into_inner).extend(rows);
        }
    }

    /// The episodes, by number, among whose rows that were read there are rows of a known one.
    pub fn seen(&self) -> BTreeSet<usize> {
        let rows = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        let mut counts: HashMap<(usize, usize), usize> = HashMap::new();
        for (read, mark) in rows.iter() {
            for known in &self.wanted[mark] {
                *counts.entry((*read, *known)).or_default() += 1;
            }
        }
        counts
            .into_iter()
            .filter(|&((_, known), count)| count >= self.enough[known])
            .map(|((read, _), _)| read)
            .collect()
    }
}

/// A source that may be watched while it is read.
pub struct Watched<'a> {
    inner: &'a dyn Source,
    watch: Option<&'a Watch>,
}

impl<'a> Watched<'a> {
    /// Watches the reads of a source, if there are marks to search for.
    pub fn new(inner: &'a dyn Source, watch: Option<&'a Watch>) -> Self {
        Self { inner, watch }
    }
}

impl Source for Watched<'_> {
    fn columns(&self) -> &[Column] {
        self.inner.columns()
    }

    fn episodes(&self) -> &[Episode] {
        self.inner.episodes()
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        let Some(watch) = self.watch else { return self.inner.read(episode, rows, halo) };
        // Rows are read in pieces that may be shorter than a mark: one that ends in this piece may begin before it.
        let wider = Halo { before: halo.before.max(VALUES - 1), ..halo };
        let mut block = self.inner.read(episode, rows, wider)?;
        watch.look(episode, &block);
        let more = block.before.saturating_sub(halo.before);
        let kept = block.time.len() - more;
        block.before -= more;
        block.time = block.time.slice(more, kept);
        block.columns.iter_mut().for_each(|column| *column = column.slice(more, kept));
        Ok(block)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mark, MemorySource};

    fn log(name: &str, rows: Range<usize>, value: impl Fn(usize) -> f64) -> MemorySource {
        let mut source = MemorySource::new(vec![Column::float("u"), Column::float("x")]);
        source.push_uniform(
            name,
            0.01,
            vec![rows.clone().map(|row| (row / 50) as f64).collect(), rows.map(value).collect()],
        );
        source
    }

    fn noise(row: usize) -> f64 {
        (mix(row as u64) >> 11) as f64
    }

    fn known(source: &MemorySource) -> Known {
        let marks = source.episodes().iter().map(|episode| episode.marks.iter().map(|mark| mark.hash).collect());
        Known { fields: ["x".to_owned()].into(), episodes: marks.collect() }
    }

    /// Returns true if rows that are read in pieces of `piece` are recognised.
    fn recognised(known: &Known, source: &MemorySource, piece: usize) -> bool {
        let watch = Watch::new(known, source.columns()).unwrap();
        let watched = Watched::new(source, Some(&watch));
        let rows = source.episodes()[0].rows;
        for first in (0..rows).step_by(piece) {
            let (rows, halo) = (first..(first + piece).min(rows), Halo { before: 3, after: 2 });
            let block = watched.read(0, rows.clone(), halo).unwrap();
            let plain = source.read(0, rows, halo).unwrap();
            assert_eq!((block.before, block.rows, block.after), (plain.before, plain.rows, plain.after));
            assert_eq!((block.time, block.columns), (plain.time, plain.columns));
        }
        watch.seen() == [0].into()
    }

    #[test]
    fn overlapping_logs_are_recognised() {
        let whole = log("whole", 0..4000, noise);
        let known = known(&whole);
        assert_eq!(whole.episodes()[0].marks.iter().map(|mark| &*mark.field).collect::<BTreeSet<_>>(), ["x"].into());
        for part in [0..4000, 0..3200, 2500..4000, 900..2100, 1000..1040, 0..32] {
            let holds = Mark::places(4000).iter().any(|place| part.start <= place.start && place.end <= part.end);
            for piece in [1, 10, 256, 4000] {
                assert_eq!(
                    recognised(&known, &log("part", part.clone(), noise), piece),
                    holds,
                    "{part:?} in pieces of {piece}"
                );
            }
        }
        assert!(recognised(&known, &log("longer", 0..9000, noise), 512));
        assert!(!recognised(&known, &log("other", 4000..8000, noise), 512));
        assert!(!recognised(&known, &log("same inputs, other states", 0..4000, |row| noise(row) + 1.0), 512));
    }

    #[test]
    fn rest_is_no_mark() {
        let resting = log("rest", 0..4000, |row| (row % 4) as f64);
        assert!(resting.episodes()[0].marks.is_empty());
        assert!(Watch::new(&known(&resting), resting.columns()).is_none());
        let empty = log("nan", 0..4000, |_| f64::NAN);
        assert!(empty.episodes()[0].marks.is_empty());
    }

    #[test]
    fn short_logs_are_marked_as_a_whole() {
        let short = log("short", 0..40, noise);
        assert_eq!(short.episodes()[0].marks.len(), 2);
        assert!(!recognised(&known(&short), &log("again", 5..39, noise), 40));
        assert!(recognised(&known(&short), &log("longer", 0..100, noise), 100));
        assert!(log("shorter", 0..9, noise).episodes()[0].marks.is_empty());
    }
}

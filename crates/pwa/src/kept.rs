//! Rows of the survey that stay in memory: all of them, or a sample by a hash of (episode, row).
//!
//! The sample does not depend on files, threads or order, and a smaller one is part of a larger one.

use std::ops::Range;

use fleetfoot_data::{EpisodeId, mix};
use fleetfoot_stats::Fold;

/// Some columns of the rows that were kept, in the order of the chunks.
#[derive(Debug, Default)]
pub(crate) struct Kept {
    pub(crate) columns: Vec<Vec<f64>>,
    /// Place in cross-validation: runs of rows.
    folds: Vec<(Fold, usize)>,
}

impl Kept {
    /// No rows yet, of so many columns.
    pub(crate) fn new(columns: usize) -> Self {
        Self { columns: vec![Vec::new(); columns], folds: Vec::new() }
    }

    /// Rows that were kept.
    pub(crate) fn rows(&self) -> u64 {
        self.folds.iter().map(|&(_, rows)| rows as u64).sum()
    }

    /// Appends the rows of a chunk.
    pub(crate) fn append(&mut self, fold: Fold, part: Vec<Vec<f64>>) {
        self.folds.push((fold, part.first().map_or(0, Vec::len)));
        for (all, part) in self.columns.iter_mut().zip(part) {
            all.extend(part);
        }
    }

    /// Rows that train the model tested on `held`, as runs; all without it.
    pub(crate) fn training_runs(&self, held: Option<u16>) -> Vec<Range<usize>> {
        let mut runs: Vec<Range<usize>> = Vec::new();
        let mut at = 0;
        for &(fold, rows) in &self.folds {
            if held.is_none_or(|held| fold.trains(held)) && rows > 0 {
                match runs.last_mut() {
                    Some(last) if last.end == at => last.end += rows,
                    _ => runs.push(at..at + rows),
                }
            }
            at += rows;
        }
        runs
    }
}

/// Share of a tile's rows that is kept.
pub(crate) enum Share {
    None,
    All,
    /// Those whose hash is below this.
    Below(u64),
}

impl Share {
    /// A share of all rows; 1 and more are all.
    pub(crate) fn new(share: f64) -> Self {
        match share {
            share if share >= 1.0 => Self::All,
            share if share > 0.0 => Self::Below((share * 2f64.powi(64)) as u64),
            _ => Self::None,
        }
    }

    /// Appends the kept rows of some columns; `index` is each row's number in its block, which begins at row `first` of the episode.
    pub(crate) fn keep(
        &self,
        kept: &mut [Vec<f64>],
        columns: &[&[f64]],
        (episode, first, index): (EpisodeId, usize, &[usize]),
    ) {
        match self {
            Self::None => {}
            Self::All => kept.iter_mut().zip(columns).for_each(|(kept, column)| kept.extend_from_slice(column)),
            Self::Below(limit) => {
                let hit = |row: &usize| address(episode, (first + index[*row]) as u64) < *limit;
                let chosen: Vec<usize> = (0..index.len()).filter(hit).collect();
                for (kept, column) in kept.iter_mut().zip(columns) {
                    kept.extend(chosen.iter().map(|&row| column[row]));
                }
            }
        }
    }
}

/// A hash of (episode, row), uniform over 64 bits.
fn address(episode: EpisodeId, row: u64) -> u64 {
    let folded = (episode.0 as u64) ^ ((episode.0 >> 64) as u64);
    mix(mix(folded).wrapping_add(row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_even() {
        let rows = 100_000;
        let chosen = (0..rows).filter(|&row| address(EpisodeId(12345), row) < u64::MAX / 10).count();
        assert!((9_500..10_500).contains(&chosen), "{chosen}");
    }
}

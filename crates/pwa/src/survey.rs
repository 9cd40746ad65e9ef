//! The first pass: moments of the partition columns for every fold, the labels there are, and the rows that k-means will cluster.
//!
//! While the partition columns of all rows fit the memory budget, all are kept and the clustering is exact. Beyond it, rows are kept by a hash of
//! (episode, row): a sample that does not depend on files, threads or order.

use std::collections::{BTreeMap, BTreeSet};

use faer::MatRef;
use fleetfoot_data::{EpisodeId, Progress, Source, mix};
use fleetfoot_library::DesignRows;
use fleetfoot_stats::{Chunk, Fold, Gram, Moments, reduce};

use crate::{Error, Specification, rows::Rows};

/// Different values that a label column may have.
const LABEL_LIMIT: usize = 1_000;

/// Bytes of a kept row: it is held twice for a while, as read and standardised for one fold.
pub(crate) fn kept_bytes(partition_columns: usize, labels: usize) -> usize {
    16 * (partition_columns + labels)
}

/// What the first pass found.
pub(crate) struct Survey {
    /// Moments of the partition columns by place in cross-validation.
    moments: BTreeMap<Fold, Moments>,
    /// Different values of each label column, ascending.
    pub(crate) labels: Vec<Vec<f64>>,
    /// Partition columns of the kept rows.
    pub(crate) kept: Vec<Vec<f64>>,
    /// Labels of the kept rows.
    pub(crate) kept_labels: Vec<Vec<f64>>,
    /// Place in cross-validation of the kept rows: runs of rows.
    pub(crate) kept_folds: Vec<(Fold, usize)>,
    /// Moments of targets, then states, over all rows.
    pub(crate) scales: Gram,
    /// Rows with all values.
    pub(crate) complete: u64,
    /// Rows that lack neighbours at the border of their episode.
    pub(crate) at_border: u64,
    /// Rows with a missing value.
    pub(crate) incomplete: u64,
}

#[derive(Default)]
struct Part {
    moments: Option<Moments>,
    scales: Option<Gram>,
    labels: Vec<BTreeSet<u64>>,
    kept: Vec<Vec<f64>>,
    kept_labels: Vec<Vec<f64>>,
    complete: u64,
    at_border: u64,
    incomplete: u64,
    scratch: DesignRows,
}

impl Survey {
    /// Reads all rows once.
    pub(crate) fn scan(
        rows: &Rows,
        source: &dyn Source,
        chunks: &[Chunk],
        partitions: &[Specification],
        memory: usize,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let clusters = partitions.iter().any(|p| p.clusters().is_some());
        let bytes = kept_bytes(rows.partition, rows.labels.len());
        let share = if clusters { memory as f64 / (source.rows().max(1) * bytes.max(1)) as f64 } else { 0.0 };
        let mut survey = Self {
            moments: BTreeMap::new(),
            labels: Vec::new(),
            kept: vec![Vec::new(); rows.partition],
            kept_labels: vec![Vec::new(); rows.labels.len()],
            kept_folds: Vec::new(),
            scales: Gram::new(rows.targets + rows.states),
            complete: 0,
            at_border: 0,
            incomplete: 0,
        };
        let mut labels = vec![BTreeSet::new(); rows.labels.len()];
        reduce(
            source,
            chunks,
            rows.halo(),
            progress,
            Part::default,
            |part, chunk, block, tile| {
                let episode = &source.episodes()[chunk.episode];
                let mut scratch = std::mem::take(&mut part.scratch);
                part.add(
                    rows,
                    &rows.evaluate(block, &episode.name, tile, &mut scratch)?,
                    episode.id,
                    block.first,
                    share,
                );
                part.scratch = scratch;
                part.labels.iter().zip(&rows.labels).try_for_each(|(seen, column)| limit_labels(column, seen))
            },
            |chunk, part| {
                survey.complete += part.complete;
                survey.at_border += part.at_border;
                survey.incomplete += part.incomplete;
                for ((column, all), seen) in rows.labels.iter().zip(&mut labels).zip(part.labels) {
                    all.extend(seen);
                    limit_labels(column, all)?;
                }
                if let Some(scales) = part.scales {
                    survey.scales.merge(&scales);
                }
                if let Some(moments) = part.moments {
                    survey.moments.entry(chunk.fold).or_insert_with(|| Moments::new(rows.partition)).merge(&moments);
                }
                survey.kept_folds.push((chunk.fold, part.kept.first().map_or(0, Vec::len)));
                append(&mut survey.kept, part.kept);
                append(&mut survey.kept_labels, part.kept_labels);
                Ok::<_, Error>(())
            },
        )?;
        survey.labels = labels
            .into_iter()
            .map(|values| {
                let mut values: Vec<f64> = values.into_iter().map(f64::from_bits).collect();
                values.sort_by(f64::total_cmp);
                values
            })
            .collect();
        Ok(survey)
    }

    /// Moments of the rows that train the model tested on `held` (all rows without it).
    pub(crate) fn training_moments(&self, held: Option<u16>) -> Option<Moments> {
        let mut selected =
            self.moments.iter().filter(|(fold, _)| held.is_none_or(|held| fold.trains(held))).map(|(_, m)| m);
        let mut total = selected.next()?.clone();
        selected.for_each(|moments| total.merge(moments));
        Some(total)
    }

    /// Rows that were kept.
    pub(crate) fn kept_rows(&self) -> u64 {
        self.kept_folds.iter().map(|&(_, rows)| rows as u64).sum()
    }

    /// Kept rows that train the model tested on `held`, as runs.
    pub(crate) fn training_runs(&self, held: Option<u16>) -> Vec<std::ops::Range<usize>> {
        let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
        let mut at = 0;
        for &(fold, rows) in &self.kept_folds {
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

impl Part {
    fn add(&mut self, rows: &Rows, tile: &crate::rows::Tile<'_>, episode: EpisodeId, first: usize, share: f64) {
        self.complete += tile.len() as u64;
        self.at_border += tile.values.at_border;
        self.incomplete += tile.values.incomplete;
        self.labels.resize_with(rows.labels.len(), BTreeSet::new);
        self.kept.resize_with(rows.partition, Vec::new);
        self.kept_labels.resize_with(rows.labels.len(), Vec::new);
        if tile.len() == 0 {
            return;
        }
        let width = rows.targets + rows.states;
        let scales = Gram::of_rows(MatRef::from_column_major_slice(tile.scales(), tile.len(), width), tile.weights());
        self.scales.get_or_insert_with(|| Gram::new(width)).merge(&scales);
        let columns = tile.partition_columns();
        self.moments.get_or_insert_with(|| Moments::new(rows.partition)).merge(&Moments::of_columns(&columns));
        for (label, seen) in self.labels.iter_mut().enumerate() {
            let mut last = None;
            for &value in tile.label(label) {
                if last != Some(value) {
                    seen.insert((value + 0.0).to_bits());
                    last = Some(value);
                }
            }
        }
        if share >= 1.0 {
            for (kept, column) in self.kept.iter_mut().zip(&columns) {
                kept.extend_from_slice(column);
            }
            for (label, kept) in self.kept_labels.iter_mut().enumerate() {
                kept.extend_from_slice(tile.label(label));
            }
        } else if share > 0.0 {
            let limit = (share * 2f64.powi(64)) as u64;
            let chosen: Vec<usize> = (0..tile.len())
                .filter(|&row| address(episode, (first + tile.values.index[row]) as u64) < limit)
                .collect();
            for (kept, column) in self.kept.iter_mut().zip(&columns) {
                kept.extend(chosen.iter().map(|&row| column[row]));
            }
            for (label, kept) in self.kept_labels.iter_mut().enumerate() {
                kept.extend(chosen.iter().map(|&row| tile.label(label)[row]));
            }
        }
    }
}

fn append(all: &mut [Vec<f64>], parts: Vec<Vec<f64>>) {
    for (all, part) in all.iter_mut().zip(parts) {
        all.extend(part);
    }
}

fn limit_labels(column: &str, seen: &BTreeSet<u64>) -> Result<(), Error> {
    if seen.len() > LABEL_LIMIT {
        return Err(Error::TooManyLabels { column: column.to_owned(), limit: LABEL_LIMIT });
    }
    Ok(())
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

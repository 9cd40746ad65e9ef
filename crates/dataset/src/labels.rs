//! Labels of episodes as columns: each label of a recipe's `[[episodes]]` becomes a category column, one value an
//! episode.

use std::{collections::BTreeSet, ops::Range};

use fleetfoot_data::{Block, Column, ColumnKind, Episode, Error, Halo, ScalarBuffer, Source};

/// A source with a column for every label of its episodes.
pub(crate) struct Labelled<S> {
    inner: S,
    columns: Vec<Column>,
    /// For each label, its code in each episode; NaN where the episode has none.
    codes: Vec<Vec<f64>>,
}

impl<S: Source> Labelled<S> {
    pub(crate) fn new(inner: S, labels: &[String]) -> Self {
        let mut columns = inner.columns().to_vec();
        let mut codes = Vec::new();
        for label in labels {
            let names: BTreeSet<&String> =
                inner.episodes().iter().filter_map(|episode| episode.labels.get(label)).collect();
            let names: Vec<String> = names.into_iter().cloned().collect();
            let code = |episode: &Episode| {
                let name = episode.labels.get(label)?;
                names.binary_search(name).ok().map(|code| code as f64)
            };
            codes.push(inner.episodes().iter().map(|episode| code(episode).unwrap_or(f64::NAN)).collect());
            columns.push(Column { name: label.clone(), unit: None, kind: ColumnKind::Category(names) });
        }
        Self { inner, columns, codes }
    }

    pub(crate) fn inner(&self) -> &S {
        &self.inner
    }
}

impl<S: Source> Source for Labelled<S> {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn episodes(&self) -> &[Episode] {
        self.inner.episodes()
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        let mut block = self.inner.read(episode, rows, halo)?;
        let length = block.time.len();
        block.columns.extend(self.codes.iter().map(|codes| ScalarBuffer::from(vec![codes[episode]; length])));
        Ok(block)
    }
}

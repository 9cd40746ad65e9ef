//! A source with filters as further columns.
//!
//! The value at a row is that of the recursion over all rows of its episode before it, whatever was read: a recursion goes on from states that
//! are kept at fixed rows (`level::SEGMENT_ROWS`), and whoever needs a state first computes those before it.

mod error;
mod kernel;
mod level;

use std::ops::Range;

use fleetfoot_data::{Block, Column, Episode, Error, Halo, Source};

pub use error::FilterError;
use level::Level;

use crate::{Expr, Filter, view::Inner};

/// A source's columns, and behind them the outputs of filters, each named by its definition ([`Filter`]).
///
/// Filters start anew in every episode. A missing input makes missing rows; a lag starts again behind them. The same bits for any way of reading and
/// any number of threads: every value is a function of the episode's rows alone.
///
/// Cost: lags are computed along with the rows that are read, from the last kept state on (8,192 rows at most before what is asked for), and the
/// first time once more in front of it, for the states: a scan costs at most one further reading of the rows for every level of filters inside
/// filters. Delays read as many rows more as the delay is long. Memory: the rows that are read, and the states, two numbers a lag and 8,192 rows.
pub struct Filtered<'a> {
    /// Filters of filters in the order of their making; none: nothing to add.
    levels: Vec<Level>,
    inner: Inner<'a>,
}

impl<'a> Filtered<'a> {
    /// Adds these filters, and those in their inputs, to a source. One that the source has as a column is not computed again.
    ///
    /// # Errors
    /// A constant that still has names in it or is out of its range (a lag's is positive, a delay's is not negative, both finite); a column that
    /// does not exist.
    pub fn new(source: &'a dyn Source, filters: &[Filter]) -> Result<Self, FilterError> {
        Self::through(Inner::Borrowed(source), filters)
    }

    /// [`Filtered::new`] of a source that is kept.
    ///
    /// # Errors
    /// As [`Filtered::new`].
    pub fn over(source: Box<dyn Source + 'a>, filters: &[Filter]) -> Result<Self, FilterError> {
        Self::through(Inner::Owned(source), filters)
    }

    fn through(inner: Inner<'a>, filters: &[Filter]) -> Result<Self, FilterError> {
        let source = inner.source();
        let mut ordered: Vec<Vec<Filter>> = Vec::new();
        for filter in filters {
            order(filter, source, &mut ordered);
        }
        let mut columns = source.columns().to_vec();
        let mut levels: Vec<Level> = Vec::with_capacity(ordered.len());
        for filters in ordered {
            let level = Level::new(columns, &filters, source.episodes().len())?;
            columns = level.columns().to_vec();
            levels.push(level);
        }
        Ok(Self { levels, inner })
    }

    /// Adds the filters that expressions read.
    ///
    /// # Errors
    /// As [`Filtered::new`].
    pub fn of(source: &'a dyn Source, expressions: &[Expr]) -> Result<Self, FilterError> {
        let mut filters: Vec<Filter> = Vec::new();
        for filter in expressions.iter().flat_map(Expr::filters) {
            if !filters.contains(&filter) {
                filters.push(filter);
            }
        }
        Self::new(source, &filters)
    }

    /// Reads from the first `levels` levels.
    fn read_level(&self, levels: usize, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        match levels.checked_sub(1) {
            None => self.inner.source().read(episode, rows, halo),
            Some(below) => {
                let read = |rows: Range<usize>, halo| self.read_level(below, episode, rows, halo);
                self.levels[below].read(&self.inner.source().episodes()[episode], episode, rows, halo, &read)
            }
        }
    }
}

impl Source for Filtered<'_> {
    fn columns(&self) -> &[Column] {
        self.levels.last().map_or(self.inner.source().columns(), Level::columns)
    }

    fn episodes(&self) -> &[Episode] {
        self.inner.source().episodes()
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, Error> {
        self.inner.source().episodes()[episode].check(&rows)?;
        self.read_level(self.levels.len(), episode, rows, halo)
    }
}

/// Puts a filter behind those that its input reads; the level that it stands on, from 1, or 0 for a column of the source.
fn order(filter: &Filter, source: &dyn Source, ordered: &mut Vec<Vec<Filter>>) -> usize {
    if source.column_index(&filter.to_string()).is_some() {
        return 0;
    }
    let beneath = filter.input.filters().iter().map(|inner| order(inner, source, ordered)).max();
    let level = beneath.unwrap_or(0);
    if ordered.len() == level {
        ordered.push(Vec::new());
    }
    if !ordered[level].contains(filter) {
        ordered[level].push(filter.clone());
    }
    level + 1
}

#[cfg(test)]
mod tests;

//! The rows of a tile, and the windows of the weak form around them.

use std::ops::Range;

use fleetfoot_data::{Block, Episode};
use fleetfoot_library::DesignRows;

use super::{
    SystemError,
    columns::{Columns, REGRESSION, rates},
    weak::{Weak, Window, sum, unwrapped},
};

/// The windows whose middles are rows of a tile.
#[derive(Default)]
pub(super) struct WindowRows {
    /// The complete rows of the tile and of the rows that its windows reach.
    pub(super) rows: DesignRows,
    /// Those of the tile itself, among them.
    pub(super) of_tile: Range<usize>,
    /// Regressors, then targets, of the complete windows, column-major.
    pub(super) values: Vec<f64>,
    /// Weights of the complete windows, where rows have weights: the least of their rows'.
    pub(super) weights: Vec<f64>,
    /// Windows that an episode's border cuts.
    pub(super) at_border: u64,
    /// Windows in which a row lacks a value.
    pub(super) incomplete: u64,
    /// Of every complete window the place of its first row among the complete rows.
    first: Vec<usize>,
    /// The same in the block.
    begins: Vec<usize>,
    window: Window,
    unwrapped: Vec<f64>,
}

impl WindowRows {
    /// Complete windows.
    pub(super) fn count(&self) -> usize {
        self.first.len()
    }

    /// Evaluates the windows whose middles are rows of a tile (core rows of the block).
    pub(super) fn evaluate(
        &mut self,
        (columns, weak): (&Columns, &Weak),
        block: &Block,
        episode: &Episode,
        tile: Range<usize>,
    ) -> Result<(), SystemError> {
        let wide = widened(block, weak.reach);
        let moved = block.first - wide.first;
        let (from, to) = (tile.start + moved, tile.end + moved);
        let around = from.saturating_sub(weak.reach)..(to + weak.reach).min(wide.rows);
        columns.rows.evaluate(&wide, episode, around, &mut self.rows)?;
        let place = |row: usize| self.rows.index.partition_point(|&index| index < row);
        self.of_tile = place(from)..place(to);
        self.find((columns, weak), &wide, from..to);
        self.integrate((columns, weak), &wide);
        Ok(())
    }

    /// The windows with these middles, and whether all of their rows are there.
    fn find(&mut self, (columns, weak): (&Columns, &Weak), wide: &Block, middles: Range<usize>) {
        let halo = columns.rows.halo();
        let least = halo.before.saturating_sub(wide.before) + weak.reach;
        let end = (wide.rows + wide.after).saturating_sub(halo.after).min(wide.rows).saturating_sub(weak.reach);
        (self.at_border, self.incomplete) = (0, 0);
        self.first.clear();
        self.begins.clear();
        // Counted from the start of the episode, so that blocks do not matter.
        let skip = (wide.first + middles.start).next_multiple_of(weak.stride()) - wide.first;
        for middle in (skip..middles.end).step_by(weak.stride()) {
            if middle < least || middle >= end {
                self.at_border += 1;
                continue;
            }
            let index = &self.rows.index;
            let first = index.partition_point(|&index| index < middle - weak.reach);
            if index.get(first) == Some(&(middle - weak.reach))
                && index.get(first + 2 * weak.reach) == Some(&(middle + weak.reach))
            {
                self.first.push(first);
                self.begins.push(wide.before + middle - weak.reach);
            } else {
                self.incomplete += 1;
            }
        }
    }

    /// Means and rates over the windows.
    fn integrate(&mut self, (columns, weak): (&Columns, &Weak), wide: &Block) {
        let (n, d) = (self.first.len(), columns.dimension());
        let tile = columns.rows.tile(&self.rows);
        let (regression, weights) = (tile.columns(REGRESSION), tile.weights());
        let rated: Vec<_> = weak.rates().zip(rates(&tile)).collect();
        self.values.clear();
        self.values.resize(n * d, 0.0);
        self.weights.clear();
        for (at, (&first, &begin)) in self.first.iter().zip(&self.begins).enumerate() {
            let range = first..first + weak.rows();
            self.window.set(&wide.time[begin..begin + weak.rows()], weak.order());
            for (j, column) in regression.iter().enumerate() {
                self.values[j * n + at] = sum(&self.window.mean, &column[range.clone()]);
            }
            for ((target, rate), column) in &rated {
                let values = &column[range.clone()];
                let change = if rate.angle {
                    unwrapped(values, &mut self.unwrapped);
                    sum(&self.window.rate, &self.unwrapped)
                } else {
                    sum(&self.window.rate, values)
                };
                self.values[(columns.regressors + target) * n + at] += change;
            }
            if let Some(weights) = weights {
                self.weights.push(weights[range].iter().fold(f64::INFINITY, |least, &weight| least.min(weight)));
            }
        }
    }

    /// The regressors and targets of the complete windows.
    pub(super) fn outputs(&self, columns: &Columns) -> Vec<&[f64]> {
        let rows = self.count();
        (0..columns.dimension()).map(|column| &self.values[column * rows..(column + 1) * rows]).collect()
    }

    /// The region of every complete window by those of its rows: windows over a border of regions have none.
    pub(super) fn regions(&self, weak: &Weak, regions: &[u32]) -> Vec<u32> {
        let one = |&first: &usize| {
            let labels = &regions[first..first + weak.rows()];
            if labels.iter().all(|&region| region == labels[0]) { labels[0] } else { u32::MAX }
        };
        self.first.iter().map(one).collect()
    }
}

/// The block with up to `reach` rows of its halo on either side among its core.
fn widened(block: &Block, reach: usize) -> Block {
    let (before, after) = (reach.min(block.before), reach.min(block.after));
    Block {
        first: block.first - before,
        before: block.before - before,
        rows: before + block.rows + after,
        after: block.after - after,
        ..block.clone()
    }
}

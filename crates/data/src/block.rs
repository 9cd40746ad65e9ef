//! Blocks: consecutive rows of one episode in memory, with the neighbours that lags and differences need.

use arrow_buffer::ScalarBuffer;

/// Neighbouring rows that a read brings along on either side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Halo {
    /// Rows before the range.
    pub before: usize,
    /// Rows after the range.
    pub after: usize,
}

/// Consecutive rows of one episode: `before + rows + after` values per column.
///
/// At the borders of an episode `before` and `after` are smaller than the requested halo.
#[derive(Debug, Clone)]
pub struct Block {
    /// Index, in its episode, of the first row of the core (the requested rows).
    pub first: usize,
    /// Halo rows in front of the core.
    pub before: usize,
    /// Rows of the core.
    pub rows: usize,
    /// Halo rows behind the core.
    pub after: usize,
    /// The episode's first stamp, nanoseconds.
    pub start: i64,
    /// Stamps of all rows, halo included, nanoseconds.
    pub time: ScalarBuffer<i64>,
    /// Values of all rows, halo included; one buffer a column, in the source's order.
    pub columns: Vec<ScalarBuffer<f64>>,
}

impl Block {
    /// All values of a column, halo included.
    pub fn column(&self, column: usize) -> &[f64] {
        &self.columns[column]
    }

    /// The core values of a column.
    pub fn core(&self, column: usize) -> &[f64] {
        &self.columns[column][self.before..self.before + self.rows]
    }

    /// Core stamps, nanoseconds.
    pub fn stamps(&self) -> &[i64] {
        &self.time[self.before..self.before + self.rows]
    }

    /// Seconds since the start of the episode for all rows, halo included.
    pub fn seconds(&self) -> Vec<f64> {
        self.time.iter().map(|&stamp| (stamp - self.start) as f64 * 1e-9).collect()
    }
}

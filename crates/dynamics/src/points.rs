//! Values of a model's columns at points, in place of a recording.

use fleetfoot_library::Leaf;

/// The values of a model's columns at points that do not depend on each other. Each point has as many earlier rows as
/// the model reads.
#[derive(Debug, Clone, Default)]
pub struct Points {
    count: usize,
    columns: usize,
    history: usize,
    ahead: usize,
    /// Rows, the oldest first, x columns x points.
    values: Vec<f64>,
    /// Seconds since the start of the episode: rows x points.
    seconds: Vec<f64>,
    /// Columns that move while time passes within a row.
    ramps: Vec<Ramp>,
    /// Seconds that have passed since the ramps began.
    passed: f64,
}

/// A column of the present row that moves in straight lines, one a point.
#[derive(Debug, Clone)]
pub(crate) struct Ramp {
    /// The column.
    pub(crate) column: usize,
    /// Values where the lines begin.
    pub(crate) begin: Vec<f64>,
    /// Change per second.
    pub(crate) rate: Vec<f64>,
}

impl Points {
    /// Zeros: `columns` values at each of `count` points, and at `history` rows before each.
    pub fn new(count: usize, columns: usize, history: usize) -> Self {
        Self::reaching(count, columns, history, 0)
    }

    /// The same, and at `ahead` rows behind each.
    pub(crate) fn reaching(count: usize, columns: usize, history: usize, ahead: usize) -> Self {
        let rows = history + 1 + ahead;
        let (values, seconds) = (vec![0.0; rows * columns * count], vec![0.0; rows * count]);
        Self { count, columns, history, ahead, values, seconds, ramps: Vec::new(), passed: 0.0 }
    }

    /// Number of points.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Rows before each point.
    pub fn history(&self) -> usize {
        self.history
    }

    fn start(&self, column: usize, lag: usize) -> usize {
        ((self.history - lag) * self.columns + column) * self.count
    }

    /// A column `lag` rows before the points (at most [`Self::history`]), one value a point.
    pub fn column(&self, column: usize, lag: usize) -> &[f64] {
        let start = self.start(column, lag);
        &self.values[start..start + self.count]
    }

    /// The same, to be written.
    pub fn column_mut(&mut self, column: usize, lag: usize) -> &mut [f64] {
        let start = self.start(column, lag);
        &mut self.values[start..start + self.count]
    }

    /// A column `rows` rows after the points (at most as many as the model looks ahead), to be written.
    pub fn ahead_mut(&mut self, column: usize, rows: usize) -> &mut [f64] {
        debug_assert!(rows <= self.ahead);
        let start = ((self.history + rows) * self.columns + column) * self.count;
        &mut self.values[start..start + self.count]
    }

    /// Values of a leaf of an expression: a column or the time, at the points, rows before them or rows after them.
    pub(crate) fn leaf(&self, leaf: Leaf) -> &[f64] {
        let row = (self.history as i64 - i64::from(leaf.lag())) as usize;
        match leaf {
            Leaf::Column { column, .. } => &self.values[(row * self.columns + column) * self.count..][..self.count],
            Leaf::Time { .. } => &self.seconds[row * self.count..][..self.count],
        }
    }

    /// Seconds since the start of the episode `lag` rows before the points, one value a point.
    pub fn seconds(&self, lag: usize) -> &[f64] {
        let start = (self.history - lag) * self.count;
        &self.seconds[start..start + self.count]
    }

    /// The same, to be written.
    pub fn seconds_mut(&mut self, lag: usize) -> &mut [f64] {
        let start = (self.history - lag) * self.count;
        &mut self.seconds[start..start + self.count]
    }

    /// Moves all times by these seconds, and the present row along its ramps.
    pub(crate) fn wait(&mut self, seconds: f64) {
        self.seconds.iter_mut().for_each(|time| *time += seconds);
        self.passed += seconds;
        (0..self.count).for_each(|point| self.ramp_to(point, self.passed));
    }

    /// Lets columns of the present row move from here on, those of before no longer.
    pub(crate) fn begin_ramps(&mut self, ramps: Vec<Ramp>) {
        (self.ramps, self.passed) = (ramps, 0.0);
        (0..self.count).for_each(|point| self.ramp_to(point, 0.0));
    }

    /// True if a column moves along a ramp within a row.
    pub(crate) fn has_ramps(&self) -> bool {
        !self.ramps.is_empty()
    }

    /// Puts the present row of a point this many seconds behind the begin of its ramps, which is at `begin` seconds of the episode.
    pub(crate) fn set_elapsed(&mut self, point: usize, begin: f64, elapsed: f64) {
        self.seconds_mut(0)[point] = begin + elapsed;
        self.ramp_to(point, elapsed);
    }

    fn ramp_to(&mut self, point: usize, elapsed: f64) {
        for ramp in 0..self.ramps.len() {
            let Ramp { column, begin, rate } = &self.ramps[ramp];
            let (column, value) = (*column, rate[point].mul_add(elapsed, begin[point]));
            self.column_mut(column, 0)[point] = value;
        }
    }

    /// One row passes: the present values become those of one row ago. The present row keeps its values until they are
    /// written.
    pub fn pass(&mut self) {
        if self.history > 0 {
            self.values.copy_within(self.columns * self.count.., 0);
            self.seconds.copy_within(self.count.., 0);
        }
    }
}

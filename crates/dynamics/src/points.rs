//! Values at points: what a model reads when they are at hand instead of in a recording.

/// The values of a model's columns at points that do not depend on each other, each with as many earlier rows as the model looks back.
#[derive(Debug, Clone, Default)]
pub struct Points {
    count: usize,
    columns: usize,
    history: usize,
    /// Rows, the oldest first, x columns x points.
    values: Vec<f64>,
    /// Seconds since the start of the episode: rows x points.
    seconds: Vec<f64>,
}

impl Points {
    /// Zeros: `columns` values at each of `count` points, and at `history` rows before each.
    pub fn new(count: usize, columns: usize, history: usize) -> Self {
        let rows = history + 1;
        Self { count, columns, history, values: vec![0.0; rows * columns * count], seconds: vec![0.0; rows * count] }
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

    /// Moves all times by these seconds.
    pub(crate) fn wait(&mut self, seconds: f64) {
        self.seconds.iter_mut().for_each(|time| *time += seconds);
    }

    /// One row passes: what was present is one row ago. The present row keeps its values until they are written.
    pub fn pass(&mut self) {
        if self.history > 0 {
            self.values.copy_within(self.columns * self.count.., 0);
            self.seconds.copy_within(self.count.., 0);
        }
    }
}

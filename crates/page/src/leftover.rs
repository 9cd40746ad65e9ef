//! Residuals of a target: over time, and over columns.

use fleetfoot_report::Bins;
use fleetfoot_stats::Autocorrelation;

use crate::coverage::Coverage;

/// Rows between errors that are compared: close ones all, far ones ever wider apart, so that fast and slow robots are seen alike.
pub(crate) const LAGS: [usize; 17] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 512];
/// Bins of a column, columns that errors are held against, and those that are drawn of them.
const BINS: usize = 24;
const COLUMNS: usize = 24;
const ROWS: u64 = 10;

/// Residuals of one target, in standard deviations of the target.
#[derive(Clone)]
pub(crate) struct Leftover {
    pub(crate) time: Autocorrelation,
    /// Columns, and errors in bins of each.
    pub(crate) over: Vec<(usize, Bins)>,
}

impl Leftover {
    pub(crate) fn new(columns: &[Coverage]) -> Self {
        let those = columns.iter().enumerate().filter(|(_, column)| column.explains).take(COLUMNS);
        Self { time: Autocorrelation::new(&LAGS), over: those.map(|(column, _)| (column, Bins::new(BINS))).collect() }
    }

    /// Takes errors of consecutive rows, and the values of the columns there.
    pub(crate) fn take<'a>(
        &mut self,
        errors: &[f64],
        sigma: f64,
        columns: &[Coverage],
        values: &impl Fn(usize) -> &'a [f64],
    ) {
        errors.iter().for_each(|error| self.time.push(error / sigma));
        for (column, bins) in &mut self.over {
            for (&error, &value) in errors.iter().zip(values(columns[*column].place)) {
                bins.add(value, error / sigma);
            }
        }
    }

    /// Merges the residuals of the rows behind these; `goes_on`: true if they follow in the same episode.
    pub(crate) fn append(&mut self, other: &Self, goes_on: bool) {
        if !goes_on {
            self.time.interrupt();
        }
        self.time.append(&other.time);
        self.over.iter_mut().zip(&other.over).for_each(|((_, errors), (_, other))| errors.merge(other));
    }

    /// Columns by how much of the errors' variance goes with them, the largest first: places among those that errors are held against, with the share.
    pub(crate) fn by_share(&self) -> Vec<(usize, f64)> {
        let known = |(place, (_, bins)): (usize, &(usize, Bins))| {
            let rows: u64 = bins.counts().iter().sum();
            let share = bins.explained();
            (rows >= ROWS * bins.counts().len() as u64 && share.is_finite()).then_some((place, share))
        };
        let mut order: Vec<(usize, f64)> = self.over.iter().enumerate().filter_map(known).collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        order
    }
}

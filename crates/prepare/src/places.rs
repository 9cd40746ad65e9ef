//! Places along a log.

use serde::Serialize;

/// Rows, counted and placed.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Places {
    /// Number of rows.
    pub rows: usize,
    /// Length of the longest run of consecutive rows among them.
    pub longest: usize,
    /// From which to which second of the episode, runs of rows each.
    pub spans: Vec<[f64; 2]>,
}

impl Places {
    /// Returns true if there are no rows.
    pub(crate) fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// Rows in order, placed by their times.
    pub(crate) fn of(rows: &[usize], times: &[f64]) -> Self {
        let mut spans: Vec<[f64; 2]> = Vec::new();
        let (mut run, mut longest) = (0, 0);
        for (at, &row) in rows.iter().enumerate() {
            match spans.last_mut() {
                Some(last) if rows[at - 1] + 1 == row => {
                    last[1] = times[row];
                    run += 1;
                }
                _ => {
                    spans.push([times[row]; 2]);
                    run = 1;
                }
            }
            longest = longest.max(run);
        }
        Self { rows: rows.len(), longest, spans }
    }
}

//! Places along a log.

use serde::Serialize;

/// Rows, counted and placed.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Places {
    /// How many.
    pub rows: usize,
    /// From which to which second of the episode, runs of rows each.
    pub spans: Vec<[f64; 2]>,
}

impl Places {
    /// Rows in order, placed by their times.
    pub(super) fn of(rows: &[usize], times: &[f64]) -> Self {
        let mut spans: Vec<[f64; 2]> = Vec::new();
        for (at, &row) in rows.iter().enumerate() {
            match spans.last_mut() {
                Some(last) if rows[at - 1] + 1 == row => last[1] = times[row],
                _ => spans.push([times[row]; 2]),
            }
        }
        Self { rows: rows.len(), spans }
    }
}

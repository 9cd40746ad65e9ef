//! Evenly spaced stamps.

/// Stamps `start + round(k * 1e9 / hz)`, nanoseconds: each is rounded by itself, so that nothing adds up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    pub start: i64,
    pub hz: f64,
    pub rows: usize,
}

impl Grid {
    /// All grid stamps from `start` to `end`, at `hz` rows a second (positive, at most 1e6).
    pub(super) fn new(start: i64, end: i64, hz: f64) -> Self {
        if end < start {
            return Self { start, hz, rows: 0 };
        }
        let mut grid = Self { start, hz, rows: 0 };
        // The quotient may be off by an ulp, which decides about the last stamp.
        let estimate = (end.abs_diff(start) as f64 * hz / 1e9) as usize;
        let mut last = estimate.saturating_add(1);
        while last > 0 && grid.stamp(last) > end {
            last -= 1;
        }
        grid.rows = last.saturating_add(1);
        grid
    }

    /// The stamp of a row.
    pub(super) fn stamp(&self, row: usize) -> i64 {
        self.start.saturating_add((row as f64 * 1e9 / self.hz).round() as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_do_not_drift_and_reach_the_end() {
        let start = 1_700_000_000_123_456_789;
        let grid = Grid::new(start, start + 3_000_000_000, 3.0);
        assert_eq!(grid.rows, 10);
        assert_eq!(grid.stamp(1), start + 333_333_333);
        assert_eq!(grid.stamp(2), start + 666_666_667);
        assert_eq!(grid.stamp(9), start + 3_000_000_000);
        assert_eq!(Grid::new(5, 4, 10.0).rows, 0);
        assert_eq!(Grid::new(5, 5, 10.0).rows, 1);
        assert_eq!(Grid::new(0, 999_999, 1000.0).rows, 1);
        assert_eq!(Grid::new(0, 1_000_000, 1000.0).rows, 2);
        for (hz, seconds) in [(1000.0, 86_400), (99.7, 12_345), (0.3, 1000), (1e6, 7)] {
            let end = start + seconds * 1_000_000_000;
            let grid = Grid::new(start, end, hz);
            assert!(grid.stamp(grid.rows - 1) <= end && grid.stamp(grid.rows) > end, "{hz}");
        }
    }
}

//! Columns as they come, and how they become coordinates.

use std::ops::Range;

use super::KMeansError;

/// Columns with their centres and scales, checked.
pub(super) struct Frame<'a> {
    pub(super) columns: &'a [&'a [f64]],
    centre: &'a [f64],
    scale: &'a [f64],
    pub(super) rows: usize,
}

impl<'a> Frame<'a> {
    pub(super) fn new(
        dimensions: usize,
        columns: &'a [&'a [f64]],
        centre: &'a [f64],
        scale: &'a [f64],
    ) -> Result<Self, KMeansError> {
        if dimensions == 0 {
            return Err(KMeansError::NoColumns);
        }
        for (what, length) in [("columns", columns.len()), ("centres", centre.len()), ("scales", scale.len())] {
            if length != dimensions {
                return Err(KMeansError::Shape { what, expected: dimensions, actual: length });
            }
        }
        let rows = columns[0].len();
        if let Some(other) = columns.iter().find(|column| column.len() != rows) {
            return Err(KMeansError::Shape { what: "rows in every column", expected: rows, actual: other.len() });
        }
        let bad = |j: &usize| !(centre[*j].is_finite() && scale[*j].is_finite() && scale[*j] > 0.0);
        if let Some(column) = (0..dimensions).find(bad) {
            return Err(KMeansError::Scale { column, centre: centre[column], scale: scale[column] });
        }
        Ok(Self { columns, centre, scale, rows })
    }

    /// Calls `take(row, column, place, z)` for all standardised values of a range of rows; the place is that in a row-major matrix of the range.
    #[inline(always)]
    pub(super) fn each(&self, range: Range<usize>, mut take: impl FnMut(usize, usize, usize, f64)) {
        /// Rows whose places fit the first cache.
        const BLOCK: usize = 128;
        let d = self.columns.len();
        for from in range.clone().step_by(BLOCK) {
            let block = from..(from + BLOCK).min(range.end);
            for (j, column) in self.columns.iter().enumerate() {
                let (centre, scale) = (self.centre[j], self.scale[j]);
                for (row, value) in block.clone().zip(&column[block.clone()]) {
                    take(row, j, (row - range.start) * d + j, (value - centre) / scale);
                }
            }
        }
    }
}

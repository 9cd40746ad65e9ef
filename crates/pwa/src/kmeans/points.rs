//! The rows to cluster: standardised, in memory, in chunks of a fixed grid.

use std::ops::Range;

use fleetfoot_data::{Silent, parallel_map};

use super::KMeansError;

/// Rows of one chunk. The grid is fixed by row numbers alone, so that whatever is summed chunk by chunk has the same bits
/// however the rows arrived.
pub(super) const CHUNK: usize = 4096;

/// Values beyond this are refused: their squares could overflow.
const LARGEST: f64 = 1e100;

/// `n` rows of `d` standardised columns, `z = (value - centre) / scale`, row-major.
///
/// Rows are appended block by block from columns; the memory is `8 n d` bytes and at most one chunk of 4,096 rows more.
/// The content depends on the rows and their order only, not on how they were split into blocks.
#[derive(Debug, Clone)]
pub struct Points {
    dimensions: usize,
    chunks: Vec<Chunk>,
    rows: usize,
    largest: f64,
}

#[derive(Debug, Clone)]
struct Chunk {
    values: Vec<f64>,
    /// Sums over the chunk of the deviations from its first row (d values), then of their squares.
    moments: Vec<f64>,
}

impl Points {
    /// No rows yet, of `dimensions` columns.
    pub fn new(dimensions: usize) -> Self {
        Self { dimensions, chunks: Vec::new(), rows: 0, largest: 0.0 }
    }

    /// All rows of `columns` (d slices of length n) at once.
    ///
    /// # Errors
    /// As [`Points::append`].
    pub fn from_columns(columns: &[&[f64]], centre: &[f64], scale: &[f64]) -> Result<Self, KMeansError> {
        let mut points = Self::new(columns.len());
        points.append(columns, centre, scale)?;
        Ok(points)
    }

    /// Appends the rows of a block: d slices of one length, with one centre and one scale each.
    ///
    /// # Errors
    /// A wrong number of columns, centres or scales, columns of different lengths, a scale that is not positive, a value that is not finite or
    /// that is beyond 1e100 when standardised. Nothing is appended then.
    pub fn append(&mut self, columns: &[&[f64]], centre: &[f64], scale: &[f64]) -> Result<(), KMeansError> {
        let (d, rows) = (self.dimensions, self.rows);
        let frame = Frame::new(d, columns, centre, scale)?;
        let length = self.chunks.last().map_or(0, |last| last.values.len());
        let room = if rows.is_multiple_of(CHUNK) { 0 } else { CHUNK - rows % CHUNK }.min(frame.rows);
        let pieces = (frame.rows - room).div_ceil(CHUNK);
        let outcome = (|| {
            let mut largest = 0.0;
            if room > 0
                && let Some(last) = self.chunks.last_mut()
            {
                largest = frame.standardise(0..room, rows, &mut last.values)?;
            }
            let tail = parallel_map(pieces, &Silent, |piece| {
                let from = room + piece * CHUNK;
                let range = from..(from + CHUNK).min(frame.rows);
                let mut chunk = Chunk { values: Vec::with_capacity(CHUNK * d), moments: vec![0.0; 2 * d] };
                let largest = frame.standardise(range, rows, &mut chunk.values)?;
                chunk.accumulate(0);
                Ok::<_, KMeansError>((chunk, largest))
            })?;
            Ok::<_, KMeansError>((tail, largest))
        })();
        if let Some(last) = self.chunks.last_mut() {
            match &outcome {
                Ok(_) => last.accumulate(length / d),
                Err(_) => last.values.truncate(length),
            }
        }
        let (tail, largest) = outcome?;
        self.largest = tail.iter().fold(self.largest.max(largest), |largest, (_, other)| largest.max(*other));
        self.chunks.extend(tail.into_iter().map(|(chunk, _)| chunk));
        self.rows += frame.rows;
        Ok(())
    }

    /// Rows, n.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Columns, d.
    pub fn dimensions(&self) -> usize {
        self.dimensions
    }

    /// The coordinates of a row (d values).
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, row: usize) -> &[f64] {
        let at = row % CHUNK * self.dimensions;
        &self.chunks[row / CHUNK].values[at..at + self.dimensions]
    }

    /// The largest magnitude of a coordinate.
    pub(super) fn largest(&self) -> f64 {
        self.largest
    }

    pub(super) fn chunks(&self) -> usize {
        self.chunks.len()
    }

    /// The rows of a chunk, row-major: `CHUNK` of them, fewer in the last.
    pub(super) fn chunk(&self, chunk: usize) -> &[f64] {
        &self.chunks[chunk].values
    }

    /// Mean over the columns of their population variances.
    pub(super) fn mean_variance(&self) -> f64 {
        let d = self.dimensions;
        let mut total = 0.0;
        for j in 0..d {
            // Chan, Golub, LeVeque: chunks merge by the exact shift formula.
            let (mut count, mut mean, mut squares) = (0.0, 0.0, 0.0);
            for chunk in &self.chunks {
                let rows = (chunk.values.len() / d) as f64;
                let deviation = chunk.moments[j] / rows;
                let within = (chunk.moments[d + j] - deviation * chunk.moments[j]).max(0.0);
                let shift = chunk.values[j] + deviation - mean;
                squares += within + shift * shift * (count * rows / (count + rows));
                count += rows;
                mean += shift * (rows / count);
            }
            total += squares / count.max(1.0);
        }
        total / d.max(1) as f64
    }
}

impl Chunk {
    /// Adds the rows from `from` on to the moments, one by one: the order is that of the rows, however they were appended.
    fn accumulate(&mut self, from: usize) {
        let d = self.moments.len() / 2;
        let (sums, squares) = self.moments.split_at_mut(d);
        let reference = &self.values[..d.min(self.values.len())];
        for row in self.values[from * d..].chunks_exact(d) {
            for j in 0..d {
                let deviation = row[j] - reference[j];
                sums[j] += deviation;
                squares[j] += deviation * deviation;
            }
        }
    }
}

/// Columns with their centres and scales, checked.
pub(super) struct Frame<'a> {
    columns: &'a [&'a [f64]],
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
        for (what, found) in [("columns", columns.len()), ("centres", centre.len()), ("scales", scale.len())] {
            if found != dimensions {
                return Err(KMeansError::Shape { what, expected: dimensions, found });
            }
        }
        let rows = columns[0].len();
        if let Some(other) = columns.iter().find(|column| column.len() != rows) {
            return Err(KMeansError::Shape { what: "rows in every column", expected: rows, found: other.len() });
        }
        let bad = |j: &usize| !(centre[*j].is_finite() && scale[*j].is_finite() && scale[*j] > 0.0);
        if let Some(column) = (0..dimensions).find(bad) {
            return Err(KMeansError::Scale { column, centre: centre[column], scale: scale[column] });
        }
        Ok(Self { columns, centre, scale, rows })
    }

    /// Appends the standardised rows of a range to `values`, row-major; the largest magnitude among them.
    /// `before` counts the rows in front of the block, for messages.
    fn standardise(&self, range: Range<usize>, before: usize, values: &mut Vec<f64>) -> Result<f64, KMeansError> {
        let (d, length) = (self.columns.len(), values.len());
        values.resize(length + range.len() * d, 0.0);
        let out = &mut values[length..];
        self.fill(range.clone(), out);
        // NaN is the larger of any two here.
        let largest = out.iter().fold(0.0, |largest: f64, x| if x.abs() <= largest { largest } else { x.abs() });
        if out.iter().all(|x| x.abs() <= LARGEST) {
            return Ok(largest);
        }
        let at = out.iter().position(|x| !(x.abs() <= LARGEST)).unwrap_or_default();
        let (row, column) = (range.start + at / d, at % d);
        Err(KMeansError::Value { row: before + row, column, value: self.columns[column][row] })
    }

    /// Writes the standardised rows of a range, row-major.
    pub(super) fn fill(&self, range: Range<usize>, out: &mut [f64]) {
        let d = self.columns.len();
        for (j, column) in self.columns.iter().enumerate() {
            let (centre, scale) = (self.centre[j], self.scale[j]);
            for (x, out) in column[range.clone()].iter().zip(out[j..].iter_mut().step_by(d)) {
                *out = (x - centre) / scale;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn blocks_do_not_show(n in 1usize..10_000, cuts in prop::collection::vec(0usize..10_000, 0..5)) {
            let x: Vec<f64> = (0..n).map(|i| (i as f64 * 0.37).sin() * 5.0 + 100.0).collect();
            let y: Vec<f64> = (0..n).map(|i| (i as f64 * 0.11).cos()).collect();
            let (centre, scale) = ([99.0, 0.0], [3.0, 0.5]);
            let whole = Points::from_columns(&[&x, &y], &centre, &scale).unwrap();
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(n)).chain([0, n]).collect();
            cuts.sort_unstable();
            let mut parts = Points::new(2);
            for pair in cuts.windows(2) {
                parts.append(&[&x[pair[0]..pair[1]], &y[pair[0]..pair[1]]], &centre, &scale).unwrap();
            }
            prop_assert_eq!(parts.rows(), n);
            prop_assert_eq!(whole.largest(), parts.largest());
            prop_assert_eq!(whole.mean_variance().to_bits(), parts.mean_variance().to_bits());
            for row in 0..n {
                prop_assert_eq!(whole.row(row), parts.row(row));
                prop_assert_eq!(whole.row(row), &[(x[row] - 99.0) / 3.0, y[row] / 0.5]);
            }
            let variance = |values: &[f64]| {
                let mean = values.iter().sum::<f64>() / n as f64;
                values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n as f64
            };
            let expected = (variance(&x) / 9.0 + variance(&y) / 0.25) / 2.0;
            prop_assert!((whole.mean_variance() - expected).abs() <= 1e-12 * (1.0 + expected));
        }
    }

    #[test]
    fn bad_input_is_refused_and_leaves_no_trace() {
        let mut points = Points::new(2);
        points.append(&[&[1.0, 2.0], &[3.0, 4.0]], &[0.0; 2], &[1.0; 2]).unwrap();
        let error = points.append(&[&[1.0, 2.0], &[3.0, f64::NAN]], &[0.0; 2], &[1.0; 2]).unwrap_err();
        assert!(matches!(error, KMeansError::Value { row: 3, column: 1, .. }), "{error}");
        let long = vec![1.0; 3 * CHUNK];
        let mut infinite = long.clone();
        infinite[2 * CHUNK + 5] = f64::INFINITY;
        assert!(points.append(&[&long, &infinite], &[0.0; 2], &[1.0; 2]).is_err());
        assert!(points.append(&[&[1.0], &[1e101]], &[0.0; 2], &[1.0; 2]).is_err());
        assert!(points.append(&[&[1.0]], &[0.0; 2], &[1.0; 2]).is_err());
        assert!(points.append(&[&[1.0], &[1.0, 2.0]], &[0.0; 2], &[1.0; 2]).is_err());
        assert!(points.append(&[&[1.0], &[1.0]], &[0.0; 2], &[1.0, 0.0]).is_err());
        assert!(Points::new(0).append(&[], &[], &[]).is_err());
        assert_eq!(points.rows(), 2);
        assert_eq!(points.row(1), [2.0, 4.0]);
        points.append(&[&[5.0], &[6.0]], &[0.0; 2], &[1.0; 2]).unwrap();
        assert_eq!(points.row(2), [5.0, 6.0]);
        assert_eq!(points.largest(), 6.0);
    }
}

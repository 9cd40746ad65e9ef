//! The rows to cluster: standardised, in memory, in chunks of a fixed grid.

use std::ops::Range;

use fleetfoot_data::{Cancelled, Progress, Silent, parallel_map};

use super::{KMeansError, frame::Frame};

/// Rows of one chunk. The grid is fixed by row numbers alone, so that whatever is summed chunk by chunk has the same bits
/// however the rows arrived.
pub(super) const CHUNK: usize = 4096;

/// Values beyond this are refused: they have no place in `f32`, where most of the work is done.
pub(super) const LARGEST: f64 = 1e30;

/// The bits of an `f64` mantissa that an `f32` does not have.
const LOW: u64 = (1 << 29) - 1;

/// `n` rows of `d` standardised columns, `z = (value - centre) / scale`.
///
/// Rows are appended block by block from columns; the memory is `8 n d` bytes and at most one chunk of 4,096 rows more.
/// The content depends on the rows and their order only, not on how they were split into blocks.
///
/// Each coordinate is kept exactly, in two parts: the `f32` towards zero from it, and the rest of its mantissa. Most of
/// k-means needs the first part only, and memory traffic limits its speed. Coordinates below `f32::MIN_POSITIVE`
/// (1.2e-38) are taken as zero.
#[derive(Debug, Clone)]
pub struct Points {
    dimensions: usize,
    chunks: Vec<Chunk>,
    rows: usize,
    largest: f64,
    weights: Option<Vec<f64>>,
}

#[derive(Debug, Clone)]
struct Chunk {
    /// Row-major, from `first` on, where a cache line begins: a row that fits a line then takes one.
    high: Vec<f32>,
    first: usize,
    low: Vec<u32>,
}

/// The rows of one chunk.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChunkRows<'a> {
    dimensions: usize,
    /// Coordinates rounded towards zero, row-major.
    pub(super) high: &'a [f32],
    /// Remainders of the rounding.
    pub(super) low: &'a [u32],
    /// Weights, where there are any.
    pub(super) weights: Option<&'a [f64]>,
}

impl Points {
    /// No rows yet, of `dimensions` columns.
    pub fn new(dimensions: usize) -> Self {
        Self { dimensions, chunks: Vec::new(), rows: 0, largest: 0.0, weights: None }
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
    /// A wrong number of columns, centres or scales; columns of different lengths; a scale that is not positive. A
    /// value that is not finite or that is beyond 1e30 when standardised. Nothing is appended then.
    pub fn append(&mut self, columns: &[&[f64]], centre: &[f64], scale: &[f64]) -> Result<(), KMeansError> {
        if self.weights.is_some() {
            return Err(KMeansError::Shape {
                what: "rows, as many as weights,",
                expected: self.rows,
                actual: self.rows + 1,
            });
        }
        let frame = Frame::new(self.dimensions, columns, centre, scale)?;
        let room = if self.rows.is_multiple_of(CHUNK) { 0 } else { CHUNK - self.rows % CHUNK }.min(frame.rows);
        let length = self.chunks.last().map_or(0, |last| last.low.len());
        let outcome = self.append_checked(&frame, room);
        if outcome.is_err()
            && let Some(last) = self.chunks.last_mut()
        {
            last.truncate(length);
        }
        let (tail, largest) = outcome?;
        self.chunks.extend(tail);
        self.largest = self.largest.max(largest);
        self.rows += frame.rows;
        Ok(())
    }

    /// Fills the last chunk with `room` rows and makes new ones of the rest; the largest magnitude.
    fn append_checked(&mut self, frame: &Frame<'_>, room: usize) -> Result<(Vec<Chunk>, f64), KMeansError> {
        let (d, before) = (self.dimensions, self.rows);
        let mut largest: f64 = 0.0;
        if room > 0
            && let Some(last) = self.chunks.last_mut()
        {
            largest = last.append(frame, 0..room, before)?;
        }
        let pieces = parallel_map((frame.rows - room).div_ceil(CHUNK), &Silent, |piece| {
            let from = room + piece * CHUNK;
            let mut chunk = Chunk::new(d);
            let largest = chunk.append(frame, from..(from + CHUNK).min(frame.rows), before)?;
            Ok::<_, KMeansError>((chunk, largest))
        })?;
        let (chunks, maxima): (Vec<Chunk>, Vec<f64>) = pieces.into_iter().unzip();
        Ok((chunks, maxima.into_iter().fold(largest, f64::max)))
    }

    /// Appends the rows of another, which begin a chunk: this one's chunks are full.
    pub(super) fn join(&mut self, other: Self) {
        debug_assert!(self.rows.is_multiple_of(CHUNK) && self.weights.is_none() && other.weights.is_none());
        self.rows += other.rows;
        self.largest = self.largest.max(other.largest);
        self.chunks.extend(other.chunks);
    }

    /// Gives each row a weight: it then counts as that many equal rows. A row of weight zero has a label and moves nothing.
    ///
    /// No rows can be appended after it.
    ///
    /// # Errors
    /// Another number of weights than of rows; a weight that is negative, not finite or beyond 1e30; no weight above zero.
    pub fn weigh(&mut self, weights: Vec<f64>) -> Result<(), KMeansError> {
        if weights.len() != self.rows {
            return Err(KMeansError::Shape { what: "weights", expected: self.rows, actual: weights.len() });
        }
        if let Some(row) = weights.iter().position(|weight| !(0.0..=LARGEST).contains(weight)) {
            return Err(KMeansError::Weight { row, value: weights[row] });
        }
        if weights.iter().all(|&weight| weight == 0.0) {
            return Err(KMeansError::NoWeight);
        }
        self.weights = Some(weights);
        Ok(())
    }

    /// Weights of the rows, where there are any.
    pub(super) fn weights(&self) -> Option<&[f64]> {
        self.weights.as_deref()
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
    pub fn row(&self, row: usize) -> Vec<f64> {
        let mut out = vec![0.0; self.dimensions];
        self.chunk(row / CHUNK).copy(row % CHUNK, &mut out);
        out
    }

    /// The largest magnitude of a coordinate.
    pub(super) fn largest(&self) -> f64 {
        self.largest
    }

    pub(super) fn chunks(&self) -> usize {
        self.chunks.len()
    }

    /// The rows of a chunk: `CHUNK` of them, fewer in the last.
    pub(super) fn chunk(&self, chunk: usize) -> ChunkRows<'_> {
        let Chunk { high, first, low } = &self.chunks[chunk];
        let first_row = chunk * CHUNK;
        let rows = low.len() / self.dimensions;
        let weights = self.weights.as_ref().map(|weights| &weights[first_row..first_row + rows]);
        ChunkRows { dimensions: self.dimensions, high: &high[*first..], low, weights }
    }

    /// Mean over the columns of their population variances.
    pub(super) fn mean_variance(&self, progress: &dyn Progress) -> Result<f64, Cancelled> {
        let d = self.dimensions;
        let parts = parallel_map(self.chunks(), &Silent, |chunk| {
            if progress.cancelled() { Err(Cancelled) } else { Ok(self.chunk(chunk).moments()) }
        })?;
        // Chan, Golub, LeVeque: chunks merge by the exact shift formula.
        let (mut count, mut mean, mut squares) = (0.0, vec![0.0; d], 0.0);
        for (chunk, (deviations, within)) in parts.into_iter().enumerate() {
            let rows = self.chunk(chunk).rows() as f64;
            squares += within;
            for j in 0..d {
                let shift = deviations[j] - mean[j];
                squares += shift * shift * (count * rows / (count + rows));
                mean[j] += shift * (rows / (count + rows));
            }
            count += rows;
        }
        Ok(squares / (count * d as f64).max(1.0))
    }
}

impl Chunk {
    fn new(d: usize) -> Self {
        const LINE: usize = 16;
        // Room for all rows of a chunk at once, so that the values never move off their cache lines.
        let mut high: Vec<f32> = Vec::with_capacity(CHUNK * d + LINE);
        let first = high.as_ptr().align_offset(LINE * size_of::<f32>()).min(LINE);
        high.resize(first, 0.0);
        Self { high, first, low: Vec::with_capacity(CHUNK * d) }
    }

    fn truncate(&mut self, length: usize) {
        self.high.truncate(self.first + length);
        self.low.truncate(length);
    }

    /// Appends standardised rows; the largest magnitude among them. `before` counts the rows in front of the block, for messages.
    fn append(&mut self, frame: &Frame<'_>, range: Range<usize>, before: usize) -> Result<f64, KMeansError> {
        let (d, length) = (frame.columns.len(), self.low.len());
        let end = length + range.len() * d;
        self.high.resize(self.first + end, 0.0);
        self.low.resize(end, 0);
        let (high, low) = (&mut self.high[self.first + length..], &mut self.low[length..]);
        let mut largest: f64 = 0.0;
        let mut bad = None;
        frame.each(range, |row, column, at, z| {
            // NaN does not fit.
            let fits = z.abs() <= LARGEST;
            if !fits {
                bad = bad.or(Some((row, column)));
            }
            largest = largest.max(z.abs());
            (high[at], low[at]) = split(z);
        });
        match bad {
            None => Ok(largest),
            Some((row, column)) => {
                Err(KMeansError::Value { row: before + row, column, value: frame.columns[column][row] })
            }
        }
    }
}

/// The `f32` towards zero from a value, and the rest of its mantissa.
#[inline(always)]
fn split(z: f64) -> (f32, u32) {
    if z.abs() < f64::from(f32::MIN_POSITIVE) {
        return (0.0, 0);
    }
    let bits = z.to_bits();
    (f64::from_bits(bits & !LOW) as f32, (bits & LOW) as u32)
}

impl<'a> ChunkRows<'a> {
    pub(super) fn rows(&self) -> usize {
        self.low.len() / self.dimensions
    }

    /// Writes the coordinates of a row to `out`.
    #[inline(always)]
    pub(super) fn copy(&self, row: usize, out: &mut [f64]) {
        let range = row * self.dimensions..(row + 1) * self.dimensions;
        for ((high, low), out) in self.high[range.clone()].iter().zip(&self.low[range]).zip(out) {
            *out = f64::from_bits(f64::from(*high).to_bits() | u64::from(*low));
        }
    }

    /// The weight of a row, 1 where there are none.
    #[inline(always)]
    pub(super) fn weight(&self, row: usize) -> f64 {
        self.weights.map_or(1.0, |weights| weights[row])
    }

    /// Means of the columns, and the sum of all squared deviations from them.
    fn moments(&self) -> (Vec<f64>, f64) {
        let d = self.dimensions;
        let mut reference = vec![0.0; d];
        self.copy(0, &mut reference);
        let (mut row, mut sums, mut squares) = (vec![0.0; d], vec![0.0; d], vec![0.0; d]);
        for i in 0..self.rows() {
            self.copy(i, &mut row);
            for j in 0..d {
                let deviation = row[j] - reference[j];
                sums[j] += deviation;
                squares[j] += deviation * deviation;
            }
        }
        let rows = self.rows() as f64;
        let within = (0..d).map(|j| (squares[j] - sums[j] * sums[j] / rows).max(0.0)).sum();
        ((0..d).map(|j| reference[j] + sums[j] / rows).collect(), within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn results_do_not_depend_on_blocks(n in 1usize..10_000, cuts in prop::collection::vec(0usize..10_000, 0..5)) {
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
            prop_assert_eq!(whole.mean_variance(&Silent).unwrap().to_bits(), parts.mean_variance(&Silent).unwrap().to_bits());
            for row in 0..n {
                prop_assert_eq!(whole.row(row), parts.row(row));
                prop_assert_eq!(whole.row(row), [(x[row] - 99.0) / 3.0, y[row] / 0.5]);
            }
            let variance = |values: &[f64]| {
                let mean = values.iter().sum::<f64>() / n as f64;
                values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n as f64
            };
            let expected = (variance(&x) / 9.0 + variance(&y) / 0.25) / 2.0;
            prop_assert!((whole.mean_variance(&Silent).unwrap() - expected).abs() <= 1e-12 * (1.0 + expected));
        }
    }

    #[test]
    fn bad_input_is_refused_and_changes_no_state() {
        let mut points = Points::new(2);
        points.append(&[&[1.0, 2.0], &[3.0, 4.0]], &[0.0; 2], &[1.0; 2]).unwrap();
        let error = points.append(&[&[1.0, 2.0], &[3.0, f64::NAN]], &[0.0; 2], &[1.0; 2]).unwrap_err();
        assert!(matches!(error, KMeansError::Value { row: 3, column: 1, .. }), "{error}");
        let long = vec![1.0; 3 * CHUNK];
        let mut infinite = long.clone();
        infinite[2 * CHUNK + 5] = f64::INFINITY;
        assert!(points.append(&[&long, &infinite], &[0.0; 2], &[1.0; 2]).is_err());
        assert!(points.append(&[&[1.0], &[1e31]], &[0.0; 2], &[1.0; 2]).is_err());
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

    #[test]
    fn both_parts_together_are_the_value() {
        for z in [
            0.0,
            1.0,
            -1.0 / 3.0,
            1e30,
            -9.87654321e-37,
            f64::from(f32::MIN_POSITIVE),
            std::f64::consts::PI,
            16777217.0,
        ] {
            let points = Points::from_columns(&[&[z]], &[0.0], &[1.0]).unwrap();
            assert_eq!(points.row(0)[0].to_bits(), z.to_bits());
            assert!(f64::from(points.chunk(0).high[0]).abs() <= z.abs());
        }
        assert_eq!(Points::from_columns(&[&[1e-39]], &[0.0], &[1.0]).unwrap().row(0), [0.0]);
    }
}

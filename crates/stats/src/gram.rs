//! Gram matrices: centred second moments that can be merged.

use std::ops::Range;

use faer::MatRef;
use fleetfoot_data::{checkpoint, packed, packed_row};

use crate::tile::{Columns, TILE, Tile};

/// Centred second moments of weighted rows z = (x, y): regressors first, then targets, d = p + q columns.
///
/// The constant is implied: `rows`, `weight` and `mean` are its column. A row of weight w counts as if its squared error stood w
/// times in the objective; `rows` counts the rows of positive weight.
#[derive(Debug, Clone, PartialEq)]
pub struct Gram {
    /// Rows of positive weight.
    pub rows: u64,
    /// Sum of the weights, W.
    pub weight: f64,
    /// Weighted mean of every column (d).
    pub mean: Vec<f64>,
    /// `sum w (z - mean)(z - mean)'`, lower triangle packed by rows: (i, j), j <= i, at `i (i + 1) / 2 + j`.
    pub scatter: Vec<f64>,
}

impl Gram {
    /// The Gram matrix of no rows.
    pub fn new(dimension: usize) -> Self {
        Self { rows: 0, weight: 0.0, mean: vec![0.0; dimension], scatter: vec![0.0; packed_row(dimension)] }
    }

    /// From plain moments about `centre` (d): the sum of the weights, `sum w (z - centre)` (d), and `sum w (z - centre)(z - centre)'` (packed).
    ///
    /// Digits are lost as far as `centre` lies from the mean in units of the deviation; a column that varies by less than `1e-7` of that distance counts as
    /// constant.
    ///
    /// # Panics
    /// When the lengths disagree.
    pub fn from_moments(rows: u64, weight: f64, centre: &[f64], first: &[f64], second: &[f64]) -> Self {
        let d = centre.len();
        assert_eq!((first.len(), second.len()), (d, packed_row(d)), "moments of the same columns");
        let mut gram = Self::new(d);
        if weight > 0.0 {
            (gram.rows, gram.weight) = (rows, weight);
            let shift: Vec<f64> = first.iter().map(|sum| sum / weight).collect();
            gram.mean = centre.iter().zip(&shift).map(|(centre, shift)| centre + shift).collect();
            for i in 0..d {
                for j in 0..=i {
                    gram.scatter[packed_row(i) + j] = second[packed_row(i) + j] - weight * shift[i] * shift[j];
                }
                gram.scatter[packed_row(i) + i] = gram.scatter[packed_row(i) + i].max(0.0);
            }
            // The remainder of a constant column after the shift is rounding, and no direction of its own.
            for i in 0..d {
                if gram.scatter[packed_row(i) + i] <= ROUNDING * second[packed_row(i) + i] {
                    (0..d).for_each(|j| gram.scatter[packed_row(i.max(j)) + i.min(j)] = 0.0);
                }
            }
        }
        gram
    }

    /// Number of columns d.
    pub fn dimension(&self) -> usize {
        self.mean.len()
    }

    /// The centred second moment of two columns.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.scatter[packed(i, j)]
    }

    /// The statistic of the rows of `z` (n x d; fastest column-major) with weights (n; finite, not negative; `None`: all 1).
    ///
    /// Tiles of a fixed number of rows are centred on their own mean (two passes in cache) and merged in order, so the result
    /// depends on the rows and on nothing else. Rows of weight 0 leave no trace, whatever they hold.
    ///
    /// # Panics
    /// When `weights` has another length than `z` has rows.
    pub fn of_rows(z: MatRef<'_, f64>, weights: Option<&[f64]>) -> Self {
        if let Some(weights) = weights {
            assert_eq!(weights.len(), z.nrows(), "one weight a row");
        }
        let mut gram = Self::new(z.ncols());
        let used = |row: &u32| weights.is_none_or(|weights| weights[*row as usize] > 0.0);
        let order: Vec<u32> = (0..z.nrows() as u32).filter(used).collect();
        let columns: Option<Vec<&[f64]>> =
            (0..z.ncols()).map(|j| Some(z.col(j).try_as_col_major()?.as_slice())).collect();
        match columns {
            Some(columns) if order.len() == z.nrows() => {
                gram.add_rows(&mut Tile::new(z.ncols()), &Columns { columns, weights }, 0..z.nrows());
            }
            _ => {
                let sorted = Sorted::new(z, weights, &order);
                gram.add_rows(&mut Tile::new(z.ncols()), &sorted.columns(), 0..order.len());
            }
        }
        gram
    }

    /// The statistic of rows that are given column by column (d slices of n values): as [`Gram::of_rows`], and with its bits, without a matrix around
    /// them.
    ///
    /// # Panics
    /// When the lengths disagree.
    pub fn of_columns(columns: &[&[f64]], weights: Option<&[f64]>) -> Self {
        let n = columns.first().map_or(0, |column| column.len());
        let lengths = columns.iter().map(|column| column.len()).chain(weights.map(<[f64]>::len));
        assert!(lengths.into_iter().all(|length| length == n), "columns of one length");
        let used = |row: &u32| weights.is_none_or(|weights| weights[*row as usize] > 0.0);
        let mut gram = Self::new(columns.len());
        let mut tile = Tile::new(columns.len());
        if weights.is_none_or(|weights| weights.iter().all(|&weight| weight > 0.0)) {
            gram.add_rows(&mut tile, &Columns { columns: columns.to_vec(), weights }, 0..n);
            return gram;
        }
        let order: Vec<u32> = (0..n as u32).filter(used).collect();
        let pick = |column: &[f64]| order.iter().map(|&row| column[row as usize]).collect::<Vec<f64>>();
        let values: Vec<Vec<f64>> = columns.iter().map(|column| pick(column)).collect();
        let weights = weights.map(pick);
        let columns = values.iter().map(Vec::as_slice).collect();
        gram.add_rows(&mut tile, &Columns { columns, weights: weights.as_deref() }, 0..order.len());
        gram
    }

    /// The statistics of the rows of each region: `regions[row] < count` names the region of a row, `u32::MAX` means that the row is
    /// not used. Regions without rows are left out; the others come in ascending order.
    ///
    /// The rows of a region keep their order, so each answer has the bits of [`Gram::of_rows`] on the region's rows.
    ///
    /// # Panics
    /// When the lengths disagree, or a region is neither below `count` nor `u32::MAX`.
    pub fn by_region(z: MatRef<'_, f64>, weights: Option<&[f64]>, regions: &[u32], count: usize) -> Vec<(u32, Self)> {
        assert_eq!(regions.len(), z.nrows(), "one region a row");
        if let Some(weights) = weights {
            assert_eq!(weights.len(), z.nrows(), "one weight a row");
        }
        let used = |row: usize| regions[row] != u32::MAX && weights.is_none_or(|weights| weights[row] > 0.0);
        // Counting sort: `next[r]` is where the next row of region r goes.
        let mut next = vec![0_usize; count + 1];
        for (row, &region) in regions.iter().enumerate() {
            if used(row) {
                next[region as usize + 1] += 1;
            }
        }
        for region in 0..count {
            next[region + 1] += next[region];
        }
        let starts = next.clone();
        let mut order = vec![0_u32; starts[count]];
        for (row, &region) in regions.iter().enumerate() {
            if used(row) {
                order[next[region as usize]] = row as u32;
                next[region as usize] += 1;
            }
        }
        let sorted = Sorted::new(z, weights, &order);
        let design = sorted.columns();
        let mut tile = Tile::new(z.ncols());
        let mut grams = Vec::new();
        for region in (0..count).filter(|&region| starts[region] < starts[region + 1]) {
            let mut gram = Self::new(z.ncols());
            gram.add_rows(&mut tile, &design, starts[region]..starts[region + 1]);
            grams.push((region as u32, gram));
        }
        grams
    }

    /// Adds rows tile by tile: each is centred and multiplied, then merged.
    fn add_rows(&mut self, tile: &mut Tile, design: &Columns<'_>, rows: Range<usize>) {
        for first in rows.clone().step_by(TILE) {
            checkpoint();
            let part = first..(first + TILE).min(rows.end);
            tile.multiply(design, part.clone());
            // The tile was centred on a rounded mean; what remained is moved from the products to the mean.
            let (weight, remainder) = (tile.weight, &tile.remainder);
            let moved = |i: usize, j: usize| tile.product(i, j) - weight * remainder[i] * remainder[j];
            // Rounding may leave a square below zero where nothing varies.
            let scatter = |i: usize, j: usize| if i == j && moved(i, j) < 0.0 { 0.0 } else { moved(i, j) };
            let mean = |i: usize| tile.centre[i] + remainder[i];
            self.add(part.len() as u64, weight, mean, scatter);
        }
    }

    /// Adds the rows behind `other`, by the exact shift formula (Chan, Golub, LeVeque 1979): with `delta` the difference of the means
    /// and W1, W2 the weights, the scatter of all rows is `S1 + S2 + W1 W2 / (W1 + W2) delta delta'`.
    ///
    /// The order of merges changes the last bits only.
    ///
    /// # Panics
    /// When the dimensions differ.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.dimension(), other.dimension(), "statistics of the same columns");
        self.add(other.rows, other.weight, |i| other.mean[i], |i, j| other.scatter[packed_row(i) + j]);
    }

    #[inline(always)]
    fn add(&mut self, rows: u64, weight: f64, mean: impl Fn(usize) -> f64, scatter: impl Fn(usize, usize) -> f64) {
        self.rows += rows;
        if weight <= 0.0 {
            return;
        }
        let first = self.weight == 0.0;
        let total = self.weight + weight;
        let factor = self.weight / total * weight;
        let delta: Vec<f64> = (0..self.dimension()).map(|i| mean(i) - self.mean[i]).collect();
        let mut at = 0;
        for i in 0..self.dimension() {
            let scaled = factor * delta[i];
            for (j, sum) in self.scatter[at..=at + i].iter_mut().enumerate() {
                // On the first rows the merge is a copy, bit for bit.
                *sum = if first { scatter(i, j) } else { *sum + scatter(i, j) + scaled * delta[j] };
            }
            at += i + 1;
            self.mean[i] = if first { mean(i) } else { self.mean[i] + weight / total * delta[i] };
        }
        self.weight = total;
    }

    /// The statistic of some of the columns, in the order given: a principal submatrix.
    ///
    /// # Panics
    /// When a column does not exist.
    pub fn select(&self, columns: &[usize]) -> Self {
        let mut selected = Self::new(columns.len());
        selected.rows = self.rows;
        selected.weight = self.weight;
        for (i, &column) in columns.iter().enumerate() {
            selected.mean[i] = self.mean[column];
            for (j, &other) in columns[..=i].iter().enumerate() {
                selected.scatter[packed(i, j)] = self.get(column, other);
            }
        }
        selected
    }

    /// Returns true if the column has one value in all rows, up to rounding: its standard deviation is less than 1e-13
    /// of its mean. A column without rows counts as constant.
    ///
    /// # Panics
    /// When the column does not exist.
    pub fn is_constant(&self, column: usize) -> bool {
        self.weight <= 0.0 || self.get(column, column) / self.weight <= (1e-13 * self.mean[column]).powi(2)
    }

    /// Covariance of some columns (divisor: the weight), packed lower triangle.
    ///
    /// # Panics
    /// When a column does not exist.
    pub fn covariance(&self, columns: Range<usize>) -> Vec<f64> {
        let first = columns.start;
        columns.flat_map(|i| (first..=i).map(move |j| self.get(i, j) / self.weight)).collect()
    }
}

/// Share of a sum of squares about a foreign centre that is rounding.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Some rows of a design in another order.
struct Sorted {
    rows: usize,
    values: Vec<f64>,
    weights: Option<Vec<f64>>,
}

impl Sorted {
    /// Column by column, because a column stays in cache, where one region's rows of all columns would not.
    fn new(z: MatRef<'_, f64>, weights: Option<&[f64]>, order: &[u32]) -> Self {
        let mut values = Vec::with_capacity(order.len() * z.ncols());
        for j in 0..z.ncols() {
            match z.col(j).try_as_col_major() {
                Some(column) => {
                    let column = column.as_slice();
                    values.extend(order.iter().map(|&row| column[row as usize]));
                }
                None => values.extend(order.iter().map(|&row| z[(row as usize, j)])),
            }
        }
        let weights = weights.map(|weights| order.iter().map(|&row| weights[row as usize]).collect());
        Self { rows: order.len(), values, weights }
    }

    fn columns(&self) -> Columns<'_> {
        let columns = match self.rows {
            0 => Vec::new(),
            rows => self.values.chunks_exact(rows).collect(),
        };
        Columns { columns, weights: self.weights.as_deref() }
    }
}

//! Gram matrix of rows that arrive one by one.

use faer::MatRef;

use crate::Gram;

/// Rows that are held before they are added.
const ROWS: usize = 1024;

/// Gathers rows into a [`Gram`], in memory that does not grow with them.
#[derive(Debug, Clone)]
pub struct RowGram {
    gram: Gram,
    /// Column-major, [`ROWS`] a column.
    buffer: Vec<f64>,
    held: usize,
}

impl RowGram {
    /// For rows of `dimension` numbers.
    pub fn new(dimension: usize) -> Self {
        Self { gram: Gram::new(dimension), buffer: vec![0.0; dimension * ROWS], held: 0 }
    }

    /// Adds a row of weight one.
    ///
    /// # Panics
    /// When the row has another length.
    pub fn push(&mut self, row: &[f64]) {
        assert_eq!(row.len(), self.gram.dimension(), "numbers of a row");
        for (column, &value) in self.buffer.chunks_exact_mut(ROWS).zip(row) {
            column[self.held] = value;
        }
        self.held += 1;
        if self.held == ROWS {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if self.held > 0 && self.gram.dimension() > 0 {
            let rows = MatRef::from_column_major_slice(&self.buffer, ROWS, self.gram.dimension());
            self.gram.merge(&Gram::of_rows(rows.subrows(0, self.held), None));
        }
        self.held = 0;
    }

    /// The statistic of all rows.
    pub fn finish(mut self) -> Gram {
        self.flush();
        self.gram
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    #[test]
    fn row_gram_matches_all_rows() {
        for n in [0, 1, ROWS - 1, ROWS, 3 * ROWS + 17] {
            let rows = Mat::from_fn(n, 3, |i, j| ((i * (j + 1)) as f64 * 0.7).sin() + 100.0 * j as f64);
            let mut stream = RowGram::new(3);
            (0..n).for_each(|i| stream.push(&[rows[(i, 0)], rows[(i, 1)], rows[(i, 2)]]));
            let (got, expected) = (stream.finish(), Gram::of_rows(rows.as_ref(), None));
            assert_eq!(got.rows, n as u64);
            for (got, expected) in got.scatter.iter().zip(&expected.scatter) {
                assert!((got - expected).abs() < 1e-10 * n.max(1) as f64, "{got} {expected}");
            }
        }
    }
}

//! Mean, variance and range of columns, mergeable.

/// Count, means, sums of squared deviations and ranges of columns; NaN values are the caller's to leave out.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// Rows.
    pub rows: u64,
    /// Mean of each column.
    pub mean: Vec<f64>,
    /// Sum of squared deviations from the mean, of each column.
    pub squares: Vec<f64>,
    /// Smallest value of each column.
    pub min: Vec<f64>,
    /// Largest value of each column.
    pub max: Vec<f64>,
}

impl Moments {
    /// No rows of `columns` columns.
    pub fn new(columns: usize) -> Self {
        Self {
            rows: 0,
            mean: vec![0.0; columns],
            squares: vec![0.0; columns],
            min: vec![f64::INFINITY; columns],
            max: vec![f64::NEG_INFINITY; columns],
        }
    }

    /// The moments of these columns (slices of one length), in two passes over each.
    pub fn of_columns(columns: &[&[f64]]) -> Self {
        let rows = columns.first().map_or(0, |column| column.len());
        let mut moments = Self::new(columns.len());
        if rows == 0 {
            return moments;
        }
        moments.rows = rows as u64;
        for (j, column) in columns.iter().enumerate() {
            let mean = column.iter().sum::<f64>() / rows as f64;
            // The second term removes what the rounding of the mean has left.
            let (squares, rest) =
                column.iter().fold((0.0, 0.0), |(s, r), v| (s + (v - mean) * (v - mean), r + (v - mean)));
            moments.mean[j] = mean + rest / rows as f64;
            moments.squares[j] = (squares - rest * rest / rows as f64).max(0.0);
            moments.min[j] = column.iter().copied().fold(f64::INFINITY, f64::min);
            moments.max[j] = column.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        }
        moments
    }

    /// Adds the rows of `other` (Chan's formula).
    pub fn merge(&mut self, other: &Self) {
        if other.rows == 0 {
            return;
        }
        let (a, b) = (self.rows as f64, other.rows as f64);
        let total = a + b;
        for j in 0..self.mean.len() {
            let shift = other.mean[j] - self.mean[j];
            self.mean[j] += shift * (b / total);
            self.squares[j] += other.squares[j] + shift * shift * (a * b / total);
            self.min[j] = self.min[j].min(other.min[j]);
            self.max[j] = self.max[j].max(other.max[j]);
        }
        self.rows += other.rows;
    }

    /// Population standard deviation (divisor: rows) of a column.
    pub fn deviation(&self, column: usize) -> f64 {
        if self.rows == 0 { 0.0 } else { (self.squares[column] / self.rows as f64).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merging_equals_computing_at_once() {
        let x: Vec<f64> = (0..1000).map(|i| 1e6 + (f64::from(i) * 0.7).sin()).collect();
        let whole = Moments::of_columns(&[&x]);
        let mut parts = Moments::new(1);
        for part in x.chunks(77) {
            parts.merge(&Moments::of_columns(&[part]));
        }
        assert_eq!(parts.rows, whole.rows);
        assert!((parts.mean[0] - whole.mean[0]).abs() < 1e-9);
        assert!((parts.deviation(0) - whole.deviation(0)).abs() < 1e-10);
        assert_eq!((parts.min[0], parts.max[0]), (whole.min[0], whole.max[0]));
    }
}

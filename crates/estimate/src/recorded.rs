//! Recorded values at the rows of a grid.

/// An episode at the rows of its grid.
pub(crate) struct Recorded {
    pub(crate) episode: usize,
    /// Rows of the episode (r).
    pub(crate) rows: Vec<usize>,
    /// Nanoseconds (r).
    pub(crate) stamps: Vec<i64>,
    /// Since the episode's start (r).
    pub(crate) seconds: Vec<f64>,
    /// States and free inputs (r x columns): angles without jumps, missing values interpolated between their
    /// neighbours.
    pub(crate) values: Vec<f64>,
    /// True at every recorded value (r x columns).
    pub(crate) there: Vec<bool>,
    /// Replayed columns (r x replayed).
    pub(crate) replayed: Vec<f64>,
    /// True at rows of which all values were recorded (r).
    pub(crate) whole: Vec<bool>,
}

impl Recorded {
    /// Columns that are followed.
    pub(crate) fn width(&self) -> usize {
        self.values.len() / self.rows.len()
    }

    /// Weights of the trapezoid rule, over the mean step (r).
    pub(crate) fn weights(&self) -> Vec<f64> {
        let rows = self.seconds.len();
        let mean = (self.seconds[rows - 1] - self.seconds[0]) / (rows - 1) as f64;
        let step = |k: usize| self.seconds[k + 1] - self.seconds[k];
        let weight =
            |k: usize| 0.5 * (if k > 0 { step(k - 1) } else { 0.0 } + if k + 1 < rows { step(k) } else { 0.0 }) / mean;
        (0..rows).map(weight).collect()
    }

    pub(crate) fn survey(&self) -> Survey {
        let width = self.width();
        let mut columns =
            vec![Seen { count: 0.0, mean: 0.0, squares: 0.0, range: [f64::INFINITY, f64::NEG_INFINITY] }; width];
        for (at, &value) in self.values.iter().enumerate().filter(|(at, _)| self.there[*at]) {
            columns[at % width].add(value);
        }
        Survey { columns }
    }
}

/// Facts about every column of the recordings.
pub(crate) struct Survey {
    columns: Vec<Seen>,
}

#[derive(Clone, Copy)]
struct Seen {
    count: f64,
    mean: f64,
    /// Sum of squares of the deviations from the mean.
    squares: f64,
    range: [f64; 2],
}

impl Seen {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let before = value - self.mean;
        self.mean += before / self.count;
        self.squares += before * (value - self.mean);
        self.range = [self.range[0].min(value), self.range[1].max(value)];
    }

    /// Chan's formula.
    fn merge(&mut self, other: &Self) {
        let (count, apart) = (self.count + other.count, other.mean - self.mean);
        self.squares += other.squares + apart * apart * self.count * other.count / count;
        self.mean += apart * other.count / count;
        self.count = count;
        self.range = [self.range[0].min(other.range[0]), self.range[1].max(other.range[1])];
    }

    /// The standard deviation; of a constant column, its size.
    fn spread(&self) -> f64 {
        let deviation = (self.squares / self.count).sqrt();
        let size = if self.mean == 0.0 { 1.0 } else { self.mean.abs() };
        if deviation > 1e-9 * size { deviation } else { size }
    }
}

impl Survey {
    pub(crate) fn pooled(surveys: impl Iterator<Item = Self>) -> Self {
        let mut pooled: Option<Self> = None;
        for survey in surveys {
            match &mut pooled {
                None => pooled = Some(survey),
                Some(pooled) => pooled.columns.iter_mut().zip(&survey.columns).for_each(|(sum, seen)| sum.merge(seen)),
            }
        }
        pooled.unwrap_or(Self { columns: Vec::new() })
    }

    pub(crate) fn spreads(&self) -> Vec<f64> {
        self.columns.iter().map(Seen::spread).collect()
    }

    /// The ranges, widened on both sides by a share of them; of a constant column, of its size.
    pub(crate) fn ranges(&self, widen: f64) -> Vec<[f64; 2]> {
        let widened = |seen: &Seen| {
            let [low, high] = seen.range;
            let by = (widen * (high - low)).max(1e-6 * seen.spread());
            [low - by, high + by]
        };
        self.columns.iter().map(widened).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surveys_of_parts_match_whole() {
        let values: Vec<f64> = (0..40).map(|k| f64::from(k * k % 17) + 1e6).collect();
        let of = |values: &[f64]| {
            let mut seen = Seen { count: 0.0, mean: 0.0, squares: 0.0, range: [f64::INFINITY, f64::NEG_INFINITY] };
            values.iter().for_each(|&value| seen.add(value));
            Survey { columns: vec![seen] }
        };
        let parts = Survey::pooled([of(&values[..7]), of(&values[7..])].into_iter());
        let whole = of(&values);
        assert!((parts.spreads()[0] / whole.spreads()[0] - 1.0).abs() < 1e-12);
        assert_eq!(parts.ranges(0.5), [[1e6 - 8.0, 1e6 + 24.0]]);
    }
}

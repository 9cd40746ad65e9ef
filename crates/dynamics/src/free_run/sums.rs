//! Error sums of an output along free runs, and the scores that follow.

/// The score of one output over all runs.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FreeRunScore {
    /// The output: a state that the model advances.
    pub name: String,
    /// Its errors.
    pub errors: OutputErrors,
}

/// Errors of one output, in the output's unit or without one. A run that ended early makes those of the model infinite:
/// the rows that it did not reach have no prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct OutputErrors {
    /// Measured rows behind the starts.
    pub rows: u64,
    /// Those of them that were not reached.
    pub lost: u64,
    /// Root relative squared error `|y - yhat| / |y - mean(y)|` (2-norms over the rows, the mean that of these rows).
    /// NaN for a constant output, which has no deviation.
    pub rrse: f64,
    /// `100 (1 - rrse)`, percent: the FIT of system identification.
    pub fit: f64,
    /// Root mean squared error, the output's unit.
    pub rmse: f64,
    /// Standard deviation of the measured output over these rows (divisor: rows), its unit: rrse is `rmse / deviation`.
    pub deviation: f64,
    /// `rmse / (max y - min y)`; of a constant output as `rrse`.
    pub nrmse: f64,
    /// Largest absolute error, the output's unit.
    pub largest: f64,
    /// RRSE of persistence: the value at the start of the run for ever.
    pub persistence: f64,
    /// RRSE of the null model, which gives the mean of training; `None` where the model does not know it.
    pub null: Option<f64>,
}

/// Share of an output's size that is rounding.
const ROUNDING: f64 = 1e-13;

/// Mergeable sums over rows, in order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OutputSum {
    rows: u64,
    lost: u64,
    mean: f64,
    /// Squares of y about its mean.
    scatter: f64,
    square: f64,
    largest: f64,
    persistence: f64,
    null: Option<f64>,
    low: f64,
    high: f64,
}

impl Default for OutputSum {
    fn default() -> Self {
        Self {
            rows: 0,
            lost: 0,
            mean: 0.0,
            scatter: 0.0,
            square: 0.0,
            largest: 0.0,
            persistence: 0.0,
            null: Some(0.0),
            low: f64::INFINITY,
            high: f64::NEG_INFINITY,
        }
    }
}

impl OutputSum {
    /// Adds a measured row: its value, the model's error (NaN: not reached), persistence's, and the null model's where there is one.
    pub(crate) fn push(&mut self, y: f64, error: f64, persistence: f64, null: Option<f64>) {
        self.rows += 1;
        // Welford's update: the offset of y does not enter the squares.
        let deviation = y - self.mean;
        self.mean += deviation / self.rows as f64;
        self.scatter = deviation.mul_add(y - self.mean, self.scatter);
        (self.low, self.high) = (self.low.min(y), self.high.max(y));
        self.persistence = persistence.mul_add(persistence, self.persistence);
        self.null = self.null.zip(null).map(|(sum, null)| null.mul_add(null, sum));
        if error.is_finite() {
            self.square = error.mul_add(error, self.square);
            self.largest = self.largest.max(error.abs());
        } else {
            self.lost += 1;
        }
    }

    /// Adds the rows behind `other` (Chan's formula).
    pub(crate) fn merge(&mut self, other: &Self) {
        if other.rows == 0 {
            return;
        }
        let (a, b) = (self.rows as f64, other.rows as f64);
        let shift = other.mean - self.mean;
        self.scatter += other.scatter + shift * shift * (a * b / (a + b));
        self.mean += shift * (b / (a + b));
        self.rows += other.rows;
        self.lost += other.lost;
        self.square += other.square;
        self.largest = self.largest.max(other.largest);
        self.persistence += other.persistence;
        self.null = self.null.zip(other.null).map(|(a, b)| a + b);
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
    }

    pub(crate) fn errors(&self) -> OutputErrors {
        let size = self.low.abs().max(self.high.abs());
        let constant = self.high - self.low <= ROUNDING * size;
        let relative = |square: f64| match constant || self.rows == 0 {
            true => f64::NAN,
            false => (square / self.scatter).sqrt(),
        };
        let whole = |value: f64| if self.lost == 0 { value } else { f64::INFINITY };
        let rrse = whole(relative(self.square));
        let rmse = whole((self.square / self.rows as f64).sqrt());
        OutputErrors {
            rows: self.rows,
            lost: self.lost,
            rrse,
            fit: 100.0 * (1.0 - rrse),
            rmse,
            deviation: (self.scatter / self.rows as f64).sqrt(),
            nrmse: if constant { rrse } else { rmse / (self.high - self.low) },
            largest: whole(self.largest),
            persistence: relative(self.persistence),
            null: self.null.map(relative),
        }
    }
}

//! Sums of prediction errors: absolute scores, from a second pass over the rows.

/// Sums over rows of the errors `e = y - prediction` of one target, mergeable in order.
///
/// A row of weight w counts w times. Rows whose target or prediction is not finite are counted and left out of the sums: a model
/// that diverged must not look good, nor make the score of the others unreadable.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ErrorSum {
    /// Rows of positive weight with a finite error.
    pub rows: u64,
    /// Rows of positive weight whose error is not finite.
    pub lost: u64,
    /// Sum of the weights, W.
    pub weight: f64,
    /// `sum w e`.
    pub error: f64,
    /// `sum w |e|`.
    pub absolute: f64,
    /// `sum w e^2`.
    pub square: f64,
    /// Largest |e| of a row of positive weight.
    pub largest: f64,
    /// `sum w (y - reference)`: the reference is the mean that the null model predicts, from the training rows.
    pub deviation: f64,
    /// `sum w |y - reference|`.
    pub absolute_deviation: f64,
    /// `sum w (y - reference)^2`.
    pub square_deviation: f64,
}

impl ErrorSum {
    /// Adds a row.
    pub fn push(&mut self, y: f64, prediction: f64, reference: f64, weight: f64) {
        if weight <= 0.0 {
            return;
        }
        let (error, deviation) = (y - prediction, y - reference);
        if !error.is_finite() {
            self.lost += 1;
            return;
        }
        self.rows += 1;
        self.weight += weight;
        self.error += weight * error;
        self.absolute += weight * error.abs();
        self.square += weight * error * error;
        self.largest = self.largest.max(error.abs());
        self.deviation += weight * deviation;
        self.absolute_deviation += weight * deviation.abs();
        self.square_deviation += weight * deviation * deviation;
    }

    /// Adds the rows behind `other`.
    pub fn merge(&mut self, other: &Self) {
        self.rows += other.rows;
        self.lost += other.lost;
        self.weight += other.weight;
        self.error += other.error;
        self.absolute += other.absolute;
        self.square += other.square;
        self.largest = self.largest.max(other.largest);
        self.deviation += other.deviation;
        self.absolute_deviation += other.absolute_deviation;
        self.square_deviation += other.square_deviation;
    }

    /// Mean absolute error; NaN without rows.
    pub fn mean_absolute(&self) -> f64 {
        self.absolute / self.weight
    }

    /// Root of the mean squared error; NaN without rows.
    pub fn root_mean_square(&self) -> f64 {
        (self.square / self.weight).sqrt()
    }

    /// Mean error; NaN without rows.
    pub fn bias(&self) -> f64 {
        self.error / self.weight
    }

    /// Standard deviation of y over these rows (divisor: the weight); NaN without rows.
    pub fn deviation_of_target(&self) -> f64 {
        (self.centred_square() / self.weight).sqrt()
    }

    /// Mean absolute error over the null model's, which predicts the reference. When y is the reference everywhere: 0 for a model without error, else 1, as
    /// in [`Self::r_squared`]; what is up to `resolution` is no error. NaN without rows.
    pub fn relative_absolute(&self, resolution: f64) -> f64 {
        let null = if self.weight > 0.0 { self.absolute_deviation } else { f64::NAN };
        1.0 - explained_share(self.absolute, null, self.weight * resolution)
    }

    /// `1 - sum w e^2 / sum w (y - mean)^2`, the mean being that of y over these rows. A root mean square up to `resolution`, the rounding of y, is none: when y is
    /// constant, a model without error has 1, any other 0 (the convention of scikit-learn). NaN without rows.
    pub fn r_squared(&self, resolution: f64) -> f64 {
        explained_share(self.square, self.centred_square(), self.weight * resolution * resolution)
    }

    /// Squares of y about its own mean: small cancellation as long as the reference is near the mean.
    fn centred_square(&self) -> f64 {
        if self.weight <= 0.0 {
            return f64::NAN;
        }
        let square = self.square_deviation - self.deviation * self.deviation / self.weight;
        // Of a constant y far from the reference, rounding is left: equal summands err in one direction, so that it grows with the rows.
        let rounding = (16.0 + 0.5 * self.rows as f64) * f64::EPSILON * self.square_deviation;
        if square > rounding { square } else { 0.0 }
    }
}

/// `1 - error / total`, the share of the total that a model explains; a sum up to `rounding` is none. Where there is nothing to explain, a model without error
/// has 1 and any other 0, as in scikit-learn. NaN for sums that are not numbers.
pub fn explained_share(error: f64, total: f64, rounding: f64) -> f64 {
    match total > rounding {
        true => 1.0 - error / total,
        false if error.is_nan() || total.is_nan() => f64::NAN,
        false => f64::from(u8::from(error <= rounding)),
    }
}

/// Error sums of several targets.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorSums {
    /// One a target.
    pub targets: Vec<ErrorSum>,
}

impl ErrorSums {
    /// The sums of no rows.
    pub fn new(targets: usize) -> Self {
        Self { targets: vec![ErrorSum::default(); targets] }
    }

    /// Adds rows of one target: values, predictions and weights have the same length (`None`: all weights 1).
    ///
    /// The rows are summed by themselves and then added, so the rounding of a long sum stays that of its blocks.
    ///
    /// # Panics
    /// When the lengths disagree or the target does not exist.
    pub fn push(&mut self, target: usize, y: &[f64], prediction: &[f64], reference: f64, weights: Option<&[f64]>) {
        assert_eq!(y.len(), prediction.len(), "one prediction a row");
        if let Some(weights) = weights {
            assert_eq!(y.len(), weights.len(), "one weight a row");
        }
        let mut sum = ErrorSum::default();
        for (row, (&y, &prediction)) in y.iter().zip(prediction).enumerate() {
            sum.push(y, prediction, reference, weights.map_or(1.0, |weights| weights[row]));
        }
        self.targets[target].merge(&sum);
    }

    /// Adds the rows behind `other`. The order of merges changes the last bits only.
    ///
    /// # Panics
    /// When the numbers of targets differ.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.targets.len(), other.targets.len(), "sums of the same targets");
        self.targets.iter_mut().zip(&other.targets).for_each(|(sum, other)| sum.merge(other));
    }
}

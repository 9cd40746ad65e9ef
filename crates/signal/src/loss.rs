//! Losses of residuals, for those that exceed their deviations.

use crate::{SignalError, error::check};

/// The loss of a residual, in units of its deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Squares up to so many deviations, straight lines beyond (Huber, "Robust estimation of a location parameter", Annals of Mathematical Statistics 35, 1964).
    Huber(f64),
    /// Minus twice the logarithm of Student's density with so many degrees of freedom, 0 where nothing is left over (Lange, Little, Taylor, "Robust statistical modeling using the t distribution", JASA 84, 1989): a
    /// residual counts the less the greater it is, and deviations are those of the bulk.
    Student(f64),
}

impl Default for Loss {
    fn default() -> Self {
        Self::Huber(4.0)
    }
}

impl Loss {
    /// Loss of a residual of `count` numbers with this sum of squares, and the weight of its square.
    pub(crate) fn of(self, square: f64, count: f64) -> (f64, f64) {
        match self {
            Self::Huber(threshold) => {
                let size = square.sqrt();
                if size <= threshold { (square, 1.0) } else { (threshold * (2.0 * size - threshold), threshold / size) }
            }
            Self::Student(freedom) => {
                let all = freedom + count;
                (all * (square / freedom).ln_1p(), all / (freedom + square))
            }
        }
    }

    pub(crate) fn check(self) -> Result<(), SignalError> {
        match self {
            Self::Huber(at) => {
                check(at > 0.0 && at.is_finite(), "the threshold of Huber's loss", at, "it must be positive and finite")
            }
            Self::Student(freedom) => check(
                freedom > 0.0 && freedom.is_finite(),
                "the freedom of Student's loss",
                freedom,
                "it must be positive and finite",
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weight is the slope of the cost with respect to the square: what makes reweighted least squares go down to the least cost.
    #[test]
    fn weights_are_slopes() {
        for loss in [Loss::Huber(2.0), Loss::Student(3.0), Loss::Student(50.0)] {
            for square in [0.5, 3.9, 4.1, 100.0] {
                let h = 1e-5 * square;
                let slope = (loss.of(square + h, 3.0).0 - loss.of(square - h, 3.0).0) / (2.0 * h);
                assert!((slope - loss.of(square, 3.0).1).abs() < 1e-7, "{loss:?} {square}");
            }
        }
        assert!(Loss::Student(0.0).check().is_err() && Loss::Huber(f64::NAN).check().is_err());
    }
}

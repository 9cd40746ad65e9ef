//! What is right of the equations that were found, when the true ones are known.

use std::fmt;

/// Share of an equation's largest coefficient below which another is rounding and no term: where the data are exact, a term that a regression with a
/// ridge kept is refitted to that.
const ROUNDING: f64 = 1e-12;

/// Which candidates are terms of an equation.
pub(crate) fn terms(coefficients: &[f64]) -> Vec<bool> {
    let largest = coefficients.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    coefficients.iter().map(|value| value.abs() > ROUNDING * largest).collect()
}

/// Equations beside the true ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Verdict {
    /// True terms that were not found, over all equations.
    pub(crate) missing: usize,
    /// Terms that are not true.
    pub(crate) extra: usize,
    /// Norm of the coefficients' errors over that of the true coefficients, all equations together.
    pub(crate) error: f64,
}

impl Verdict {
    /// Coefficients (equation by equation) beside the true ones.
    pub(crate) fn new(estimate: &[Vec<f64>], truth: &[Vec<f64>]) -> Self {
        let pairs = || estimate.iter().flatten().zip(truth.iter().flatten());
        let has = |equations: &[Vec<f64>]| equations.iter().flat_map(|equation| terms(equation)).collect::<Vec<bool>>();
        let (has, should) = (has(estimate), has(truth));
        let count = |has: &[bool], not: &[bool]| has.iter().zip(not).filter(|(has, not)| **has && !**not).count();
        let square = |sum: f64, value: f64| sum + value * value;
        Self {
            missing: count(&should, &has),
            extra: count(&has, &should),
            error: (pairs().map(|(estimate, truth)| estimate - truth).fold(0.0, square)
                / pairs().map(|(_, truth)| *truth).fold(0.0, square))
            .sqrt(),
        }
    }

    /// Terms that are wrong, either way.
    pub(crate) fn wrong(&self) -> usize {
        self.missing + self.extra
    }

    /// Whether the structure is the true one.
    pub(crate) fn is_right(&self) -> bool {
        self.wrong() == 0
    }

    /// Fewer wrong terms; with as many, the smaller error.
    pub(crate) fn is_better_than(&self, other: &Self) -> bool {
        let key = |verdict: &Self| (verdict.wrong(), verdict.error);
        key(self) < key(other)
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.missing > 0 {
            write!(f, "-{} ", self.missing)?;
        }
        if self.extra > 0 {
            write!(f, "+{} ", self.extra)?;
        }
        write!(f, "{:.0e}", self.error)
    }
}

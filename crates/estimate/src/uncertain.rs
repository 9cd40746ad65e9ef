//! A number with its standard error, as it is printed.

use std::fmt::{self, Display, Formatter};

/// A value and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertain {
    /// The value.
    pub value: f64,
    /// Its standard error, not negative.
    pub error: f64,
}

impl Display for Uncertain {
    /// Two significant digits of the error, and the value to the same place: `0.07160 +- 0.00091`,
    /// `(1.0285 +- 0.0031)e-5`. All digits of both without a finite, positive error.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { value, error } = *self;
        if !(value.is_finite() && error.is_finite() && error > 0.0) {
            return write!(f, "{value} +- {error}");
        }
        let (_, last) = rounded(error, 1);
        let places = last - 1;
        let top = if value == 0.0 { last } else { exponent(value).max(last) };
        if (-4..6).contains(&top) && places <= 0 {
            let digits = (-places) as usize;
            return write!(f, "{value:.digits$} +- {error:.digits$}");
        }
        let (unit, digits) = (10_f64.powi(top), (top - places) as usize);
        write!(f, "({:.digits$} +- {:.digits$})e{top}", value / unit, error / unit)
    }
}

/// The decimal exponent of a number that is not 0.
fn exponent(value: f64) -> i32 {
    rounded(value, 15).1
}

/// A number that is not 0, to so many digits behind the first: its digits, and its decimal exponent after rounding.
fn rounded(value: f64, digits: usize) -> (String, i32) {
    let text = format!("{:.digits$e}", value.abs());
    match text.split_once('e') {
        Some((mantissa, exponent)) => (mantissa.to_owned(), exponent.parse().unwrap_or(0)),
        None => (text, 0),
    }
}

#[cfg(test)]
mod tests {
    use super::Uncertain;

    #[test]
    fn values_are_rounded_to_their_errors() {
        for (value, error, text) in [
            (0.0716, 0.000912, "0.07160 +- 0.00091"),
            (0.0716, 0.000996, "0.0716 +- 0.0010"),
            (-12.3456, 0.5, "-12.35 +- 0.50"),
            (1.0285e-5, 3.14e-8, "(1.0285 +- 0.0031)e-5"),
            (2.0, 31.0, "2 +- 31"),
            (0.0, 0.01, "0.000 +- 0.010"),
            (123456.0, 789.0, "(1.2346 +- 0.0079)e5"),
            (1e9, 1e3, "(1.0000000 +- 0.0000010)e9"),
            (3.0, 0.0, "3 +- 0"),
            (3.0, f64::INFINITY, "3 +- inf"),
        ] {
            assert_eq!(Uncertain { value, error }.to_string(), text);
        }
    }
}

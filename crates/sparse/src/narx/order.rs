//! How far back a NARX model looks, and its degree.

use std::fmt;

/// Lags and degree of a NARX model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NarxOrder {
    /// Past values of every output, ny: `y(k-1)` to `y(k-ny)`.
    pub outputs: usize,
    /// Past values of every input, nu: `u(k-1)` to `u(k-nu)`.
    pub inputs: usize,
    /// Total degree of the polynomial; 1 for a sum of given functions.
    pub degree: usize,
    /// Whether inputs act at once: `u(k)` stands beside its past.
    pub direct: bool,
}

impl NarxOrder {
    /// The least order that holds both.
    pub fn union(self, other: Self) -> Self {
        Self {
            outputs: self.outputs.max(other.outputs),
            inputs: self.inputs.max(other.inputs),
            degree: self.degree.max(other.degree),
            direct: self.direct || other.direct,
        }
    }

    /// Whether every term of `self` is one of `other`.
    pub fn is_within(self, other: Self) -> bool {
        self.union(other) == other
    }
}

impl fmt::Display for NarxOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direct = if self.direct { " direct" } else { "" };
        write!(f, "ny {} nu {} degree {}{direct}", self.outputs, self.inputs, self.degree)
    }
}

//! Lags and degree of a NARX model.

use std::fmt;

/// Lags and degree of a NARX model.
///
/// ```
/// use fleetfoot_sparse::narx::NarxOrder;
///
/// // Every fifth of eleven rows: y(k-1), y(k-6), ... y(k-51).
/// let order = NarxOrder { outputs: 11, inputs: 0, degree: 1, direct: false, every: 5 };
/// assert_eq!((order.reach(), order.to_string().as_str()), (51, "ny 11 nu 0 every 5 degree 1"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NarxOrder {
    /// Past values of every output, ny: `y(k-1)` to `y(k-ny)`, or as many that are further apart.
    pub outputs: usize,
    /// Past values of every input, nu: `u(k-1)` to `u(k-nu)`, or as many that are further apart.
    pub inputs: usize,
    /// Total degree of the polynomial; 1 for a sum of given functions.
    pub degree: usize,
    /// True if inputs act at once: `u(k)` stands beside its past.
    pub direct: bool,
    /// Rows between two past values, 1 or more: `y(k-1)`, `y(k-1-every)`, `y(k-1-2*every)` and so on.
    pub every: usize,
}

impl NarxOrder {
    /// The least order that holds both, whose past values are equally far apart.
    pub fn union(self, other: Self) -> Self {
        Self {
            every: if self.is_spread() { self.every } else { other.every },
            outputs: self.outputs.max(other.outputs),
            inputs: self.inputs.max(other.inputs),
            degree: self.degree.max(other.degree),
            direct: self.direct || other.direct,
        }
    }

    /// Returns true if every term of `self` is one of `other`.
    pub fn is_within(self, other: Self) -> bool {
        self.union(other) == other
    }

    /// Returns true if some variable has two past values or more, so that their spacing matters.
    fn is_spread(self) -> bool {
        self.outputs.max(self.inputs) > 1
    }

    /// Number of rows from the earliest of `lags` past values to row k.
    pub fn back(self, lags: usize) -> usize {
        if lags == 0 { 0 } else { 1 + (lags - 1) * self.every }
    }

    /// Number of rows from the earliest of all past values to row k.
    pub fn reach(self) -> usize {
        self.back(self.outputs.max(self.inputs))
    }
}

impl fmt::Display for NarxOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direct = if self.direct { " direct" } else { "" };
        let every = if self.every > 1 { format!(" every {}", self.every) } else { String::new() };
        write!(f, "ny {} nu {}{every} degree {}{direct}", self.outputs, self.inputs, self.degree)
    }
}

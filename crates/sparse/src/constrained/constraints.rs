//! Constraints on coefficients: bounds, linear equalities and inequalities.

use super::ConstrainedError;

/// A linear form of the coefficients and a number: `sum_j c_j theta_j` against `bound`.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearConstraint {
    /// Name in messages: `T >= 0 at 250 kt`.
    pub name: String,
    /// Coefficients `(j, c_j)`, in the units of theta; an index may repeat.
    pub coefficients: Vec<(usize, f64)>,
    /// The number.
    pub bound: f64,
}

/// Constraints on the coefficients theta (p) of a structured regression, in raw units.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Constraints {
    /// Least and greatest value of every coefficient (p; empty: free); infinite ends are open, equal ends fix it.
    pub bounds: Vec<[f64; 2]>,
    /// Forms that equal their bound.
    pub equalities: Vec<LinearConstraint>,
    /// Forms that are at least their bound.
    pub inequalities: Vec<LinearConstraint>,
    /// Names of the coefficients in messages (p; empty: by number).
    pub names: Vec<String>,
}

/// One side of one constraint: `sum c_j theta_j >= bound`, or equal to it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Side {
    pub(super) name: String,
    pub(super) coefficients: Vec<(usize, f64)>,
    pub(super) bound: f64,
    pub(super) equality: bool,
}

impl Constraints {
    /// All of them as sides, checked against the number of coefficients.
    pub(super) fn sides(&self, p: usize) -> Result<Vec<Side>, ConstrainedError> {
        for (what, length) in [("the bounds", self.bounds.len()), ("the names of the coefficients", self.names.len())] {
            if length != 0 && length != p {
                return Err(crate::SparseError::Length { what, actual: length, expected: p }.into());
            }
        }
        let mut sides = Vec::new();
        for (j, &[low, high]) in self.bounds.iter().enumerate() {
            let name = self.names.get(j).cloned().unwrap_or_else(|| format!("coefficient {j}"));
            // NaN bounds nothing and is never meant.
            if !(low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY) {
                return Err(ConstrainedError::Bounds { name, low, high });
            }
            let mut side = |name: String, factor: f64, bound: f64, equality: bool| {
                sides.push(Side { name, coefficients: vec![(j, factor)], bound, equality });
            };
            if low == high {
                side(format!("{name} = {low}"), 1.0, low, true);
                continue;
            }
            if low.is_finite() {
                side(format!("{name} >= {low}"), 1.0, low, false);
            }
            if high.is_finite() {
                side(format!("{name} <= {high}"), -1.0, -high, false);
            }
        }
        let linear = self.equalities.iter().map(|row| (row, true));
        for (row, equality) in linear.chain(self.inequalities.iter().map(|row| (row, false))) {
            if !(row.bound.is_finite() && row.coefficients.iter().all(|(_, value)| value.is_finite())) {
                return Err(ConstrainedError::NotFinite { name: row.name.clone() });
            }
            if let Some(&(coefficient, _)) = row.coefficients.iter().find(|(j, _)| *j >= p) {
                return Err(ConstrainedError::NoSuchCoefficient {
                    name: row.name.clone(),
                    coefficient,
                    coefficients: p,
                });
            }
            let (name, coefficients) = (row.name.clone(), row.coefficients.clone());
            sides.push(Side { name, coefficients, bound: row.bound, equality });
        }
        Ok(sides)
    }
}

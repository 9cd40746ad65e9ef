//! The constrained problem in correlation form.
//!
//! With delta_j = theta_j / unit_j, over the k columns that take part: minimise `1/2 |z - A delta|^2 + sum_j limit_j |delta_j|` where `c_i'delta >= d_i`
//! (or equal), A with unit columns (the ridge as rows below), c_i of unit length. Huge and tiny units take part in nothing here.

use faer::Mat;
use fleetfoot_stats::{Svd, svd};

use super::{ConstrainedError, constraints::Side};
use crate::{
    Sign, Strength,
    kernel::norm,
    penalty::Weights,
    quadratic::{Form, Quadratic},
};

/// One constraint in correlation form.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Its index among the sides.
    pub(super) side: usize,
    /// c (k), of unit length.
    pub(super) coefficients: Vec<f64>,
    /// d.
    pub(super) bound: f64,
    pub(super) equality: bool,
    /// Divisor of the raw row.
    pub(super) length: f64,
}

impl Row {
    /// `c'delta - d`: not negative where the constraint holds.
    pub(super) fn slack(&self, delta: &[f64]) -> f64 {
        product(&self.coefficients, delta) - self.bound
    }
}

/// The problem of this module's documentation.
#[derive(Debug, Clone)]
pub(super) struct Scaled {
    /// The coefficient of every column (k).
    pub(super) columns: Vec<usize>,
    pub(super) a: Mat<f64>,
    pub(super) z: Vec<f64>,
    /// Rows of A that are data; the ridge follows.
    pub(super) data: usize,
    /// Squared length of the unit target that no row has.
    pub(super) beyond: f64,
    /// l1 weight of every column (k).
    pub(super) limit: Vec<f64>,
    /// theta_j / delta_j (k).
    pub(super) unit: Vec<f64>,
    pub(super) rows: Vec<Row>,
    /// Square of the target's deviation: objectives here times this are raw.
    pub(super) square: f64,
    /// A = U diag(s) V'.
    pub(super) svd: Svd,
    /// Singular values that are not rounding.
    pub(super) rank: usize,
}

/// `a'b`.
pub(super) fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Singular values of `columns` unit columns below this share of the largest are rounding.
pub(super) fn rank_level(columns: usize) -> f64 {
    16.0 * f64::EPSILON * ((columns + 1) as f64).sqrt()
}

impl Scaled {
    /// The problem restricted to the columns of `support`. A side that no column takes part in either holds or is a contradiction by itself.
    pub(super) fn new(
        problem: &Quadratic,
        scale: &[f64],
        weights: &Weights,
        strength: Strength,
        support: Option<&[usize]>,
        sides: &[Side],
    ) -> Result<Self, ConstrainedError> {
        let Form::Root { a, z, beyond } = &problem.form else {
            return Err(ConstrainedError::NotSquareRoot);
        };
        let p = problem.columns();
        let wanted = |j: usize| support.is_none_or(|support| support.contains(&j));
        let columns: Vec<usize> = (0..p).filter(|&j| weights.used(j) && wanted(j)).collect();
        let k = columns.len();
        let m = a.rows();
        let below = if strength.l2 > 0.0 { k } else { 0 };
        let matrix = Mat::from_fn(m + below, k, |i, c| match i.checked_sub(m) {
            None => a.column(columns[c])[i],
            Some(row) if row == c => (strength.l2 * weights.rho[columns[c]]).sqrt(),
            Some(_) => 0.0,
        });
        let mut target = z[..m].to_vec();
        target.resize(m + below, 0.0);
        let limit = columns.iter().map(|&j| strength.l1 / weights.tau * weights.omega[j]).collect();
        let unit: Vec<f64> = columns.iter().map(|&j| problem.raw(j, 1.0) / scale[j]).collect();
        let svd = svd(matrix.as_ref()).ok_or(ConstrainedError::Program { reason: "no singular values".to_owned() })?;
        let least = svd.s.first().map_or(0.0, |largest| largest * rank_level(k));
        let rank = svd.s.iter().filter(|&&s| s > least).count();
        let mut scaled = Self {
            rows: Vec::new(),
            a: matrix,
            z: target,
            data: m,
            beyond: *beyond,
            limit,
            unit,
            square: weights.tau * weights.tau,
            svd,
            rank,
            columns,
        };
        scaled.add_signs(&weights.signs, sides.len());
        for (side, given) in sides.iter().enumerate() {
            scaled.add(side, given)?;
        }
        Ok(scaled)
    }

    /// Signs of the penalty are bounds at 0; they are numbered after all sides.
    fn add_signs(&mut self, signs: &[Sign], sides: usize) {
        for (c, &j) in self.columns.iter().enumerate() {
            let factor = match signs[j] {
                Sign::Free => continue,
                Sign::NonNegative => 1.0,
                Sign::NonPositive => -1.0,
            };
            let mut coefficients = vec![0.0; self.columns.len()];
            coefficients[c] = factor;
            self.rows.push(Row { side: sides + j, coefficients, bound: 0.0, equality: false, length: self.unit[c] });
        }
    }

    fn add(&mut self, index: usize, side: &Side) -> Result<(), ConstrainedError> {
        let mut coefficients = vec![0.0; self.columns.len()];
        for &(j, value) in &side.coefficients {
            if let Ok(c) = self.columns.binary_search(&j) {
                coefficients[c] += value * self.unit[c];
            }
        }
        let length = norm(coefficients.iter().copied());
        if !length.is_finite() || !(side.bound / length.max(f64::MIN_POSITIVE)).is_finite() && length > 0.0 {
            return Err(ConstrainedError::NotFinite { name: side.name.clone() });
        }
        if length == 0.0 {
            let holds = if side.equality { side.bound == 0.0 } else { side.bound <= 0.0 };
            let contradiction = ConstrainedError::Infeasible { constraints: vec![side.name.clone()] };
            return if holds { Ok(()) } else { Err(contradiction) };
        }
        coefficients.iter_mut().for_each(|value| *value /= length);
        let bound = side.bound / length;
        self.rows.push(Row { side: index, coefficients, bound, equality: side.equality, length });
        Ok(())
    }

    /// `z - A delta`.
    pub(super) fn residual(&self, delta: &[f64]) -> Vec<f64> {
        let mut left = self.z.clone();
        for (c, &value) in delta.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            left.iter_mut().zip(self.a.col_as_slice(c)).for_each(|(left, a)| *left -= a * value);
        }
        left
    }

    /// `A'residual + C'multipliers`: at the minimum, the subgradient of the penalty.
    pub(super) fn forces(&self, residual: &[f64], multipliers: &[f64]) -> Vec<f64> {
        let mut forces: Vec<f64> = (0..self.columns.len()).map(|c| product(self.a.col_as_slice(c), residual)).collect();
        for (row, &multiplier) in self.rows.iter().zip(multipliers).filter(|(_, multiplier)| **multiplier != 0.0) {
            forces.iter_mut().zip(&row.coefficients).for_each(|(force, c)| *force += multiplier * c);
        }
        forces
    }
}

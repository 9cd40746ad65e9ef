//! Penalised columns, strengths of their penalties, and allowed signs.

use crate::{Quadratic, SparseError};

/// Allowed values of a coefficient.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sign {
    /// Any.
    #[default]
    Free,
    /// Zero or more.
    NonNegative,
    /// Zero or less.
    NonPositive,
}

impl Sign {
    /// The directions in which a coefficient may leave zero.
    pub(crate) fn sides(self) -> &'static [f64] {
        match self {
            Self::Free => &[1.0, -1.0],
            Self::NonNegative => &[1.0],
            Self::NonPositive => &[-1.0],
        }
    }

    /// Returns true if a coefficient may have this value.
    pub fn allows(self, value: f64) -> bool {
        match self {
            Self::Free => true,
            Self::NonNegative => value >= 0.0,
            Self::NonPositive => value <= 0.0,
        }
    }
}

/// The shape of the penalty: `sum_j w_j |u_j b_j|` and `1/2 sum_j w_j (u_j b_j)^2`, and the allowed signs.
///
/// The intercept is never penalised.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Penalty {
    /// True if coefficients are penalised in units of their column's deviation: u_j = [`Quadratic::deviation`]. False:
    /// u_j = 1.
    pub standardise: bool,
    /// Penalty factors w (p; empty: all 1); 0: no penalty; infinity: the column is left out.
    pub factors: Vec<f64>,
    /// Sign constraints (p; empty: none).
    pub signs: Vec<Sign>,
}

impl Penalty {
    /// The lasso on standardised columns, nothing constrained.
    pub fn standardised() -> Self {
        Self { standardise: true, ..Self::default() }
    }
}

/// The strengths of one fit: `l1 sum_j w_j |u_j b_j| + l2/2 sum_j w_j (u_j b_j)^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strength {
    /// Weight of the absolute values, in the units of the target.
    pub l1: f64,
    /// Weight of the squares.
    pub l2: f64,
}

impl Strength {
    /// The lasso: `lambda` on the absolute values.
    pub fn lasso(lambda: f64) -> Self {
        Self { l1: lambda, l2: 0.0 }
    }

    /// The elastic net `lambda (l1_ratio |.| + (1 - l1_ratio)/2 (.)^2)`.
    pub fn elastic_net(lambda: f64, l1_ratio: f64) -> Self {
        Self { l1: lambda * l1_ratio, l2: lambda * (1.0 - l1_ratio) }
    }

    pub(crate) fn checked(self) -> Result<Self, SparseError> {
        for (name, value) in [("the l1 strength", self.l1), ("the l2 strength", self.l2)] {
            check_strength(name, value)?;
        }
        Ok(self)
    }
}

pub(crate) fn check_strength(name: &'static str, value: f64) -> Result<f64, SparseError> {
    if value >= 0.0 && value.is_finite() { Ok(value) } else { Err(SparseError::Strength { name, value }) }
}

pub(crate) fn check_tolerance(value: f64) -> Result<f64, SparseError> {
    if (1e-15..=1.0).contains(&value) { Ok(value) } else { Err(SparseError::Tolerance { value }) }
}

pub(crate) fn check_ratio(value: f64) -> Result<f64, SparseError> {
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(SparseError::L1Ratio { value }) }
}

/// The penalty in correlation form, checked: with `delta_j = b_j length_j / size` and strengths in units of the target's deviation,
/// `1/2 |z - A delta|^2 + l1 sum omega_j |delta_j| + l2/2 sum rho_j delta_j^2`.
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    /// l1 weights (p): `w u / deviation`; infinite for columns that take no part.
    pub(crate) omega: Vec<f64>,
    /// l2 weights (p): `w (u / deviation)^2`; 0 for columns that take no part.
    pub(crate) rho: Vec<f64>,
    pub(crate) signs: Vec<Sign>,
    /// The target's deviation (1 where it does not vary): what strengths in correlation form are multiplied by.
    pub(crate) tau: f64,
}

impl Weights {
    pub(crate) fn new(problem: &Quadratic, penalty: &Penalty) -> Result<Self, SparseError> {
        let p = problem.columns();
        for (what, length) in [("the penalty factors", penalty.factors.len()), ("the signs", penalty.signs.len())] {
            if length != 0 && length != p {
                return Err(SparseError::Length { what, actual: length, expected: p });
            }
        }
        if let Some(column) = penalty.factors.iter().position(|factor| factor.is_nan() || *factor < 0.0) {
            return Err(SparseError::PenaltyFactor { column, value: penalty.factors[column] });
        }
        let deviation = problem.deviation();
        let mut weights = Self {
            omega: vec![f64::INFINITY; p],
            rho: vec![0.0; p],
            signs: if penalty.signs.is_empty() { vec![Sign::Free; p] } else { penalty.signs.clone() },
            tau: problem.target_length() / problem.weight.sqrt(),
        };
        for j in 0..p {
            let factor = penalty.factors.get(j).copied().unwrap_or(1.0);
            if deviation[j] > 0.0 && factor.is_finite() {
                let unit = if penalty.standardise { 1.0 } else { deviation[j].recip() };
                weights.omega[j] = factor * unit;
                weights.rho[j] = factor * unit * unit;
            }
        }
        Ok(weights)
    }

    /// Returns true if a column takes part.
    pub(crate) fn used(&self, j: usize) -> bool {
        self.omega[j].is_finite()
    }
}

//! Structured regression under constraints: bounds, linear equalities and inequalities of the coefficients, and limits that forms of the
//! latents keep at every row of the data ([`fit_within_limits`]).
//!
//! The objective is that of the crate, over the coefficients theta of an [`Assembled`] problem:
//!
//! ```text
//! minimise    1/(2n) sum_t s_t |y_t - B_t theta|^2 + l1 sum_j w_j |u_j theta_j| + l2/2 sum_j w_j (u_j theta_j)^2
//! subject to  low_j <= theta_j <= high_j,   E theta = e,   C theta >= c,   theta_j = 0 outside the support
//! ```
//!
//! An interior-point method (Clarabel) on the square-root form finds which constraints are active, in coordinates where the quadratic part is the
//! identity; the minimiser with these is then solved for by orthogonal factors. So coefficients are as good as those of a Householder QR, and the
//! certificate is computed from the statistic, without anything that the solver says.

mod constraints;
mod error;
mod limit;
mod limited;
mod polish;
mod program;
mod scaled;
mod survey;
mod verdict;

pub use constraints::{Constraints, LinearConstraint};
pub use error::ConstrainedError;
pub use limit::{Form, Limit, RowLimit};
pub use limited::{Clearance, LimitOptions, LimitedFit, LimitedRegression, fit_within_limits};
pub use verdict::ConstrainedCertificate;

use polish::{Guess, Point, polish};
use program::Outcome;
use scaled::Scaled;
use verdict::judge;

use crate::{SparseError, Strength, penalty::Weights, structured::Assembled};

/// Options of the solver of a constrained fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstrainedOptions {
    /// Upper limit for [`ConstrainedCertificate::kkt`] and [`ConstrainedCertificate::violation`].
    pub tolerance: f64,
    /// Iterations of the interior-point method, at most.
    pub max_iterations: u32,
}

impl Default for ConstrainedOptions {
    fn default() -> Self {
        Self { tolerance: 1e-8, max_iterations: 200 }
    }
}

/// Status of a constrained solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ConstrainedStatus {
    /// The certificate is below the tolerance.
    Solved,
    /// It is not; the coefficients are the best that were found.
    NotConverged,
}

/// A constraint that holds with equality.
#[derive(Debug, Clone, PartialEq)]
pub struct Active {
    /// Its name.
    pub name: String,
    /// The slope of the least objective over its bound (of an upper bound: over minus the bound), raw units: what the constraint costs. 0 for one
    /// that other active constraints imply.
    pub multiplier: f64,
}

/// A minimiser under constraints.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Constrained {
    /// Coefficients (p), raw units.
    pub theta: Vec<f64>,
    /// The objective, in the units of the target's square.
    pub objective: f64,
    /// Weighted residual sum of squares over n.
    pub mse: f64,
    /// Constraints that hold with equality.
    pub active: Vec<Active>,
    /// Distance from the minimum.
    pub certificate: ConstrainedCertificate,
    /// Status: solved if the certificate is below the tolerance.
    pub status: ConstrainedStatus,
}

/// The minimiser of the assembled objective under constraints; `support` (`None`: all) are the coefficients that may differ from 0.
///
/// Factors and signs are those of [`Assembled::penalty`]. Coefficients whose columns are zero in the data, and those with infinite penalty factors, are 0.
///
/// # Errors
/// When a constraint or an option is not valid, the problem is not in square-root form, or the constraints contradict each other.
pub fn constrained(
    assembled: &Assembled,
    constraints: &Constraints,
    strength: Strength,
    support: Option<&[usize]>,
    options: &ConstrainedOptions,
) -> Result<Constrained, ConstrainedError> {
    let strength = strength.checked()?;
    let p = assembled.problem.columns();
    if let Some(&coefficient) = support.and_then(|support| support.iter().find(|&&j| j >= p)) {
        let name = "the support".to_owned();
        return Err(ConstrainedError::NoSuchCoefficient { name, coefficient, coefficients: p });
    }
    if !(options.tolerance >= 1e-15 && options.tolerance < 1.0) {
        return Err(SparseError::Tolerance { value: options.tolerance }.into());
    }
    let sides = constraints.sides(p)?;
    let weights = Weights::new(&assembled.problem, &assembled.penalty)?;
    let scaled = Scaled::new(&assembled.problem, &assembled.scale, &weights, strength, support, &sides)?;
    let name = |side: usize| match sides.get(side) {
        Some(side) => side.name.clone(),
        None => sign_name(constraints, side - sides.len()),
    };
    let best = minimise(&scaled, options, &name)?;
    Ok(finish(&scaled, &best, p, options, &name))
}

fn sign_name(constraints: &Constraints, j: usize) -> String {
    match constraints.names.get(j) {
        Some(name) => format!("the sign of {name}"),
        None => format!("the sign of coefficient {j}"),
    }
}

/// A certificate that is rounding: the active constraints are the right ones, and least squares under them as accurate as they can be. Along weak directions an
/// interior point may have such a certificate by chance while its coefficients are a millionth off.
const ROUNDING: f64 = 1e-12;

/// The interior point, then the active constraints as equalities: whichever has the better certificate, the latter where its own is rounding.
fn minimise(
    scaled: &Scaled,
    options: &ConstrainedOptions,
    name: &dyn Fn(usize) -> String,
) -> Result<Point, ConstrainedError> {
    if scaled.columns.is_empty() {
        return Ok(Point { delta: Vec::new(), multipliers: Vec::new() });
    }
    let (point, active, zero) = match program::solve(scaled, options.max_iterations)? {
        Outcome::Point { delta, multipliers, active, zero } => (Point { delta, multipliers }, active, zero),
        Outcome::Infeasible => {
            let rows = program::contradiction(&scaled.rows, options.max_iterations)?;
            if rows.is_empty() {
                let reason =
                    "the solver reached neither feasible coefficients nor a contradiction between the constraints"
                        .to_owned();
                return Err(ConstrainedError::Program { reason });
            }
            let mut constraints: Vec<String> = Vec::new();
            // A matrix has a row for every direction that was cut.
            for name in rows.iter().map(|&at| name(scaled.rows[at].side)) {
                if !constraints.contains(&name) {
                    constraints.push(name);
                }
            }
            return Err(ConstrainedError::Infeasible { constraints });
        }
    };
    let guess = Guess::new(scaled, &point, &active, &zero);
    let mut interior = point;
    interior.delta.iter_mut().zip(&zero).filter(|(_, zero)| **zero).for_each(|(delta, _)| *delta = 0.0);
    let better =
        |polished: &Point| judge(scaled, polished).0.worst() <= judge(scaled, &interior).0.worst().max(ROUNDING);
    Ok(polish(scaled, guess).filter(better).unwrap_or(interior))
}

fn finish(
    scaled: &Scaled,
    point: &Point,
    p: usize,
    options: &ConstrainedOptions,
    name: &dyn Fn(usize) -> String,
) -> Constrained {
    let (certificate, objective) = judge(scaled, point);
    let mut theta = vec![0.0; p];
    for (c, &j) in scaled.columns.iter().enumerate() {
        theta[j] = point.delta[c] * scaled.unit[c];
    }
    let near = |slack: f64, row: &scaled::Row| slack.abs() <= 10.0 * options.tolerance * row.bound.abs().max(1.0);
    let active = scaled.rows.iter().zip(&point.multipliers).filter(|(row, _)| near(row.slack(&point.delta), row));
    let active = active
        .map(|(row, multiplier)| Active { name: name(row.side), multiplier: multiplier * scaled.square / row.length });
    let left = scaled.residual(&point.delta);
    let rows = left[..scaled.data].iter().map(|left| left * left).sum::<f64>() + scaled.beyond;
    let solved = certificate.worst() <= options.tolerance;
    Constrained {
        theta,
        objective: objective * scaled.square,
        mse: rows * scaled.square,
        active: active.collect(),
        certificate,
        status: if solved { ConstrainedStatus::Solved } else { ConstrainedStatus::NotConverged },
    }
}

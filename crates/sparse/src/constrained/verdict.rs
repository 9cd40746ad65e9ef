//! Distance of a point from the constrained minimum, from the statistic and the constraints alone.
//!
//! Let r = z - A delta and q = A'r + C'mu, with mu not negative for inequalities. A correction v in the range of A with
//! `A'v = e` makes `|q_j + e_j| <= limit_j` exactly. Then r + v and mu are feasible for the dual, and primal minus dual
//! is
//!
//! `sum_j (limit_j |delta_j| - (q_j + e_j) delta_j) + mu'(C delta - d) + 1/2 |v|^2`.
//!
//! Slacks enter with their absolute value, so that rounding below a bound does not make the gap look small.

use super::{
    polish::Point,
    scaled::{Scaled, product},
};

/// Distance of constrained coefficients from the minimum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstrainedCertificate {
    /// The largest violation of the conditions of the minimum (stationarity, signs of multipliers, complementarity), as
    /// a correlation. Columns, target and constraints have unit length in these coefficients.
    pub kkt: f64,
    /// The largest violation of a constraint, in coefficients of unit columns and a unit target. It is relative to the
    /// largest of 1 and the terms of the constraint.
    pub violation: f64,
    /// Bound on objective minus minimum, divided by the objective of zero coefficients.
    pub gap: f64,
}

impl ConstrainedCertificate {
    /// The largest of the conditions.
    pub(super) fn worst(&self) -> f64 {
        self.kkt.max(self.violation)
    }
}

/// The certificate of a point, and its objective in correlation form.
pub(super) fn judge(scaled: &Scaled, point: &Point) -> (ConstrainedCertificate, f64) {
    let Point { delta, multipliers } = point;
    let left = scaled.residual(delta);
    let forces = scaled.forces(&left, multipliers);
    let (mut kkt, mut violation, mut gap) = (0.0_f64, 0.0_f64, 0.0);
    let mut missing = vec![0.0; forces.len()];
    for (c, &force) in forces.iter().enumerate() {
        let limit = scaled.limit[c];
        let nearest = if delta[c] != 0.0 { limit * delta[c].signum() } else { force.clamp(-limit, limit) };
        kkt = kkt.max((force - nearest).abs());
        missing[c] = force.clamp(-limit, limit) - force;
        gap += (limit * delta[c].abs() - (force + missing[c]) * delta[c]).max(0.0);
    }
    for (row, &multiplier) in scaled.rows.iter().zip(multipliers) {
        let slack = row.slack(delta);
        let terms: f64 = row.coefficients.iter().zip(delta).map(|(c, delta)| (c * delta).abs()).sum();
        let broken = if row.equality { slack.abs() } else { (-slack).max(0.0) };
        violation = violation.max(broken / terms.max(1.0));
        if !row.equality {
            kkt = kkt.max(-multiplier).max((multiplier * slack).abs() / terms.max(1.0));
        }
        gap += (multiplier * slack).abs();
    }
    // v = U s^-1 V' e.
    let correction = (0..scaled.rank).map(|i| product(scaled.svd.v.col_as_slice(i), &missing) / scaled.svd.s[i]);
    gap += 0.5 * correction.map(|value| value * value).sum::<f64>();
    let penalty: f64 = delta.iter().zip(&scaled.limit).map(|(delta, limit)| limit * delta.abs()).sum();
    let squares = left.iter().map(|left| left * left).sum::<f64>() + scaled.beyond;
    // Zero coefficients have the objective 1/2 in these units.
    (ConstrainedCertificate { kkt, violation, gap: 2.0 * gap }, 0.5 * squares + penalty)
}

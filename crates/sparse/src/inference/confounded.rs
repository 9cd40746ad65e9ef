//! Coefficients that cannot be told apart, and the variance inflation of each by the others.

use faer::Mat;

use super::{InferenceError, least_squares::SupportFactor};
use crate::structured::Assembled;

/// A combination of coefficients that the rows hardly see: theta may move along `direction` and the fit stays.
#[derive(Debug, Clone, PartialEq)]
pub struct Confounded {
    /// The coefficient whose column the others rebuild.
    pub dependent: usize,
    /// Remainder of its column beyond the others, relative to its length: the sine of the angle between them; at most
    /// the limit.
    pub remainder: f64,
    /// Coefficients that take part, ascending, with the direction in raw units: `sum_j direction_j column_j` is at most
    /// as long as `remainder` implies. In units of the columns' lengths its largest entry is 1.
    pub direction: Vec<(usize, f64)>,
}

/// Coefficients of a support that the rows cannot tell apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Confounding {
    /// Directions, one a dependent column; together with their multiples and sums they are the (near) null space.
    pub directions: Vec<Confounded>,
    /// Coefficients joined by directions, each group ascending, by first member.
    pub groups: Vec<Vec<usize>>,
    /// Coefficients of the support whose columns are zero.
    pub zero: Vec<usize>,
    /// Variance inflation of every coefficient of the support (k): `1/(1 - R^2)` of its column on the other identified ones, about zero as the problem has no
    /// intercept. Infinite for columns that are zero or in a group.
    pub inflation: Vec<f64>,
    /// Estimated condition number of the columns that were kept, at unit length: largest over smallest pivot.
    pub condition: f64,
}

/// Members of a direction below this share of its largest entry, or below the limit, are left out: what they add is no longer than what the limit ignores.
const LEAST_SHARE: f64 = 1e-6;

/// The coefficients of a support that the rows and priors of a problem cannot tell apart at `limit` (1e-6, say): a column is dependent when what it has beyond the
/// columns before it, in the order of a QR with column pivoting, is at most `limit` of its length (Golub and Van Loan 2013, section 5.5.7).
///
/// With a remainder r, errors of relative size e in the rows move coefficients along the direction by e / r: the limit should be the relative error of the rows that
/// one is ready to believe in. A limit of 1e-9 is what least squares in double precision can use.
///
/// # Errors
/// When the support names a coefficient that does not exist, or the limit lies outside (0, 1).
pub fn confounded(assembled: &Assembled, support: &[usize], limit: f64) -> Result<Confounding, InferenceError> {
    if !(limit > 0.0 && limit < 1.0) {
        return Err(InferenceError::Share { name: "the limit", value: limit });
    }
    let is_zero = |&j: &usize| assembled.problem.length.get(j) == Some(&0.0);
    let zero: Vec<usize> = support.iter().copied().filter(is_zero).collect();
    let varied: Vec<usize> = support.iter().copied().filter(|j| !is_zero(j)).collect();
    let factor = SupportFactor::new(assembled, &varied)?;
    let rank = factor.rank(limit);
    let directions: Vec<Confounded> =
        (rank..varied.len()).map(|at| direction(&factor, &varied, (rank, at), limit.max(LEAST_SHARE))).collect();
    let groups = groups(&directions);
    let kept: Vec<usize> = (0..rank).map(|i| varied[factor.order[i]]).collect();
    let support_factor = SupportFactor::new(assembled, &kept)?;
    let among = support_factor.inverse_diagonal();
    let inflation = support.iter().map(|j| {
        let joined = groups.iter().any(|group| group.contains(j));
        kept.iter().position(|i| i == j).filter(|_| !joined).map_or(f64::INFINITY, |place| among[place])
    });
    let pivot = |i: usize| support_factor.r[(i, i)].abs();
    let condition = if rank > 0 { pivot(0) / pivot(rank - 1) } else { 1.0 };
    Ok(Confounding { inflation: inflation.collect(), directions, groups, zero, condition })
}

/// The combination of the kept columns that rebuilds the column at `at` of the order.
fn direction(factor: &SupportFactor, support: &[usize], (rank, at): (usize, usize), least: f64) -> Confounded {
    let mut x: Vec<f64> = (0..rank).map(|i| factor.r[(i, at)]).collect();
    for i in (0..rank).rev() {
        let known: f64 = (i + 1..rank).map(|j| factor.r[(i, j)] * x[j]).sum();
        x[i] = (x[i] - known) / factor.r[(i, i)];
    }
    let left: f64 = (rank..=at).map(|i| factor.r[(i, at)].powi(2)).sum();
    let largest = x.iter().fold(1.0_f64, |most, value| most.max(value.abs()));
    let member = |(i, share): (usize, f64)| {
        let place = factor.order[i];
        (share.abs() > least * largest).then(|| (support[place], share / largest / factor.unit[place]))
    };
    let mut direction: Vec<(usize, f64)> =
        x.iter().map(|value| -value).enumerate().chain([(at, 1.0)]).filter_map(member).collect();
    direction.sort_by_key(|(j, _)| *j);
    Confounded { dependent: support[factor.order[at]], remainder: left.sqrt(), direction }
}

fn groups(directions: &[Confounded]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for direction in directions {
        let mut joined: Vec<usize> = direction.direction.iter().map(|(j, _)| *j).collect();
        let (touched, apart): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|group: &Vec<usize>| group.iter().any(|j| joined.contains(j)));
        joined.extend(touched.into_iter().flatten());
        joined.sort_unstable();
        joined.dedup();
        groups = apart;
        groups.push(joined);
    }
    groups.sort();
    groups
}

impl Confounding {
    /// Directions as a matrix (p x number), raw units.
    pub fn matrix(&self, coefficients: usize) -> Mat<f64> {
        let mut matrix = Mat::zeros(coefficients, self.directions.len());
        for (k, direction) in self.directions.iter().enumerate() {
            direction.direction.iter().for_each(|&(j, value)| matrix[(j, k)] = value);
        }
        matrix
    }
}

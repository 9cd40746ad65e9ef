//! Certificates: how far coefficients are from the minimum, computed from the statistic alone.
//!
//! In correlation form (unit columns, unit target) the problem is `1/2 |r|^2 + sum l_j |d_j| + 1/2 sum ridge_j d_j^2`, r = z - A d. With the
//! ridge as rows below A, g = A'r - ridge d, and s in [0, 1] the largest factor that makes s g feasible for the dual (`|s g_j| <= l_j`, one-sided
//! under a sign constraint), primal minus dual is
//!
//! `1/2 (1 - s)^2 |r|^2 + sum (l_j |d_j| - s g_j d_j)`,
//!
//! a sum of terms that are not negative: nothing cancels (the gap of Kim, Koh, Lustig, Boyd, Gorinevsky 2007, rearranged). Columns without an
//! l1 penalty demand g_j = 0 of the dual, and next to none is as bad for the scaling: there the residual r - v, v = A step, is taken that has the
//! gradients which such columns should have; it adds `1/2 |v|^2 + (1 - s) (r - v)'v`.

use faer::Mat;

use crate::{
    Penalty, Quadratic, SparseError, Strength, cholesky,
    kernel::Slab,
    penalty::{Sign, Weights},
};

/// An l1 penalty, as a correlation, that rounding of the gradient may be above.
const NO_PENALTY: f64 = 1e-6;
/// Distance of two gradients, as correlations, that ill-conditioned columns make by rounding.
const REACHED: f64 = 1e-10;

/// How far coefficients are from the minimum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    /// The largest violation of the Karush-Kuhn-Tucker conditions, as a correlation: violation of column j divided by the deviations of column
    /// j and of the target. Infinite when a sign constraint is broken.
    pub kkt: f64,
    /// Bound on objective minus minimum, divided by the objective of zero coefficients, `1/2` of the target's variance.
    pub gap: f64,
    /// The objective, in units of the target's square.
    pub objective: f64,
}

/// The certificate of coefficients (p, raw units): for any problem, penalty and strengths, whoever computed them.
///
/// # Errors
/// When the penalty is not valid, a strength is negative, or the lengths disagree.
pub fn certificate(
    problem: &Quadratic,
    penalty: &Penalty,
    strength: Strength,
    coefficients: &[f64],
) -> Result<Certificate, SparseError> {
    let strength = strength.checked()?;
    let weights = Weights::new(problem, penalty)?;
    let p = problem.columns();
    if coefficients.len() != p {
        let (what, found) = ("the coefficients", coefficients.len());
        return Err(SparseError::Length { what, found, expected: p });
    }
    if let Some(column) = coefficients.iter().position(|value| !value.is_finite()) {
        return Err(SparseError::ColumnNotFinite { column });
    }
    let size = problem.target_length();
    let delta = Slab::from_fn(p, 1, |j, _| coefficients[j] * (problem.length[j] / size));
    let mut found = certify(problem, &weights, &[strength.l1], strength.l2, &delta);
    // A column that takes no part has no place in correlation form.
    if (0..p).any(|j| coefficients[j] != 0.0 && !weights.used(j)) {
        found[0].0.kkt = f64::INFINITY;
    }
    Ok(found[0].0)
}

/// Certificates and squared residuals (unit target) of coefficients in correlation form, one column a problem, at the l1 strengths `l1` (raw).
pub(crate) fn certify(
    problem: &Quadratic,
    weights: &Weights,
    l1: &[f64],
    l2: f64,
    delta: &Slab,
) -> Vec<(Certificate, f64)> {
    let (correlations, rss) = problem.residual_correlations(delta);
    let certify = |k: usize| {
        let point = Point {
            problem,
            weights,
            l1: l1[k] / weights.tau,
            l2,
            delta: delta.column(k),
            correlations: correlations.column(k),
            rss: rss[k],
        };
        (point.certificate(), rss[k])
    };
    (0..delta.columns()).map(certify).collect()
}

/// Coefficients with all that is known about them, in correlation form.
struct Point<'a> {
    problem: &'a Quadratic,
    weights: &'a Weights,
    l1: f64,
    l2: f64,
    delta: &'a [f64],
    correlations: &'a [f64],
    rss: f64,
}

impl Point<'_> {
    fn limit(&self, j: usize) -> f64 {
        self.l1 * self.weights.omega[j]
    }

    /// g_j: the correlation less the ridge.
    fn gradient(&self, j: usize) -> f64 {
        self.correlations[j] - self.l2 * self.weights.rho[j] * self.delta[j]
    }

    /// The part of g_j that pushes column j from zero to where it is allowed to go.
    fn push(&self, j: usize, gradient: f64) -> f64 {
        match self.weights.signs[j] {
            Sign::Free => gradient.abs(),
            Sign::NonNegative => gradient,
            Sign::NonPositive => -gradient,
        }
    }

    fn violation(&self, j: usize) -> f64 {
        let (delta, gradient) = (self.delta[j], self.gradient(j));
        if !self.weights.signs[j].allows(delta) {
            f64::INFINITY
        } else if delta != 0.0 {
            (gradient - self.limit(j) * delta.signum()).abs()
        } else {
            (self.push(j, gradient) - self.limit(j)).max(0.0)
        }
    }

    fn certificate(&self) -> Certificate {
        let used: Vec<usize> = (0..self.problem.columns()).filter(|&j| self.weights.used(j)).collect();
        let kkt = used.iter().map(|&j| self.violation(j)).fold(0.0, f64::max);
        let penalty = used.iter().map(|&j| {
            let delta = self.delta[j];
            self.limit(j) * delta.abs() + 0.5 * self.l2 * self.weights.rho[j] * delta * delta
        });
        let objective = self.weights.tau.powi(2) * (0.5 * self.rss + penalty.sum::<f64>());
        Certificate { kkt, gap: if kkt.is_finite() { self.best_gap(&used) } else { f64::INFINITY }, objective }
    }

    /// Every dual point bounds the minimum; the second one, which costs a factorisation, where the first is poor.
    fn best_gap(&self, used: &[usize]) -> f64 {
        let scaled = 2.0 * self.gap(used, 0.0);
        if scaled > 1e-12 { scaled.min(2.0 * self.gap(used, NO_PENALTY)) } else { scaled }
    }

    /// The gap at the dual point in which the gradients of columns whose l1 penalty, as a correlation, is at most `least`, are brought to where
    /// they belong.
    fn gap(&self, used: &[usize], least: f64) -> f64 {
        let ridge = |j: usize| self.l2 * self.weights.rho[j];
        let original: Vec<f64> = (0..self.problem.columns()).map(|j| self.gradient(j)).collect();
        let mut gradient = original.clone();
        let mut moved: Vec<usize> = Vec::new();
        // |v|^2 and g'step.
        let (mut length, mut along) = (0.0, 0.0);
        // Columns that the step of the others pushes beyond their bounds take part from then on.
        loop {
            let out = |&j: &usize| self.limit(j) <= least && gradient[j] != self.goal(j, gradient[j]);
            let more: Vec<usize> = used.iter().copied().filter(|j| out(j) && !moved.contains(j)).collect();
            if more.is_empty() {
                break;
            }
            moved.extend(more);
            let mut excess = vec![0.0; original.len()];
            moved.iter().for_each(|&j| excess[j] = original[j] - self.goal(j, original[j]));
            let step = self.project(&moved, &excess);
            let explained = self.explained(&step);
            for &j in used {
                gradient[j] = original[j] - explained[j] - ridge(j) * step[j];
            }
            // What is reached but for rounding is reached. Without a penalty all columns get there; with one, columns that depend on each other may not.
            for &j in &moved {
                let goal = self.goal(j, original[j]);
                if self.limit(j) == 0.0 || (gradient[j] - goal).abs() <= REACHED {
                    gradient[j] = goal;
                }
            }
            length = moved.iter().map(|&j| step[j] * (original[j] - gradient[j])).sum::<f64>().max(0.0);
            along = moved.iter().map(|&j| step[j] * gradient[j]).sum();
        }
        let feasible = |scale: f64, &j: &usize| {
            let (push, limit) = (self.push(j, gradient[j]), self.limit(j));
            if push > limit { scale.min(limit / push) } else { scale }
        };
        let scale = used.iter().fold(1.0, feasible);
        let whole = self.rss + used.iter().map(|&j| ridge(j) * self.delta[j].powi(2)).sum::<f64>();
        let left = (whole - length - 2.0 * along).max(0.0);
        let slack = used.iter().map(|&j| {
            let delta = self.delta[j];
            (self.limit(j) * delta.abs() - scale * gradient[j] * delta).max(0.0)
        });
        0.5 * length + 0.5 * (1.0 - scale).powi(2) * left + (1.0 - scale) * along.max(0.0) + slack.sum::<f64>()
    }

    /// The gradient nearest to `gradient` that belongs to a minimiser with these coefficients.
    fn goal(&self, j: usize, gradient: f64) -> f64 {
        let limit = self.limit(j);
        if self.delta[j] != 0.0 {
            return limit * self.delta[j].signum();
        }
        match self.weights.signs[j] {
            Sign::Free => gradient.clamp(-limit, limit),
            Sign::NonNegative => gradient.min(limit),
            Sign::NonPositive => gradient.max(-limit),
        }
    }

    /// The step of the given columns, the others fixed, that lowers their gradients by `excess`. Entries of the others are zero.
    fn project(&self, columns: &[usize], excess: &[f64]) -> Vec<f64> {
        let p = self.problem.columns();
        let mut products = vec![0.0; Slab::zeros(p, 0).stride()];
        let mut matrix = Mat::zeros(columns.len(), columns.len());
        for (k, &j) in columns.iter().enumerate() {
            self.problem.correlations_of(j, &mut products);
            matrix.col_as_slice_mut(k).iter_mut().zip(columns).for_each(|(entry, &i)| *entry = products[i]);
            matrix[(k, k)] = 1.0 + self.l2 * self.weights.rho[j];
        }
        let wanted: Vec<f64> = columns.iter().map(|&j| excess[j]).collect();
        let found = cholesky::solve(&matrix, &wanted, 8.0 * f64::EPSILON * (p + 1) as f64);
        let mut step = vec![0.0; p];
        columns.iter().zip(&found).for_each(|(&j, value)| step[j] = *value);
        step
    }

    /// Correlations of all columns with `A step`.
    fn explained(&self, step: &[f64]) -> Vec<f64> {
        let p = self.problem.columns();
        let pair = Slab::from_fn(p, 2, |j, k| if k == 0 { 0.0 } else { step[j] });
        let (correlations, _) = self.problem.residual_correlations(&pair);
        (0..p).map(|j| correlations.column(0)[j] - correlations.column(1)[j]).collect()
    }
}

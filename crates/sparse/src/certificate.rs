//! Certificates: distance of coefficients from the minimum, computed from the statistic alone.
//!
//! In correlation form (unit columns, unit target) the problem is `1/2 |r|^2 + sum l_j |d_j| + 1/2 sum ridge_j d_j^2`,
//! r = z - A d. With the ridge as rows below A, g = A'r - ridge d. Let s in [0, 1] be the largest factor that makes s g
//! feasible for the dual (`|s g_j| <= l_j`, one-sided under a sign constraint). Primal minus dual is then
//!
//! `1/2 (1 - s)^2 |r|^2 + sum (l_j |d_j| - s g_j d_j)`,
//!
//! and likewise for any penalty that is a norm, with its dual norm in place of the limits ([`Shape`]). It is a sum of
//! terms that are not negative, so that nothing cancels (the gap of Kim, Koh, Lustig, Boyd, Gorinevsky 2007,
//! rearranged). Columns without an l1 penalty demand g_j = 0 of the dual, and a tiny penalty is as bad for the scaling.
//! For them the residual r - v, v = A step, is taken that has the gradients which such columns should have. It adds
//! `1/2 |v|^2 + (1 - s) (r - v)'v`.

use faer::Mat;
use fleetfoot_data::parallel_pieces;

use crate::{
    Penalty, Quadratic, SparseError, Strength, cholesky,
    kernel::Slab,
    penalty::Weights,
    shape::{Columns, Shape},
};

/// An l1 penalty, as a correlation, that rounding of the gradient may be above.
const NO_PENALTY: f64 = 1e-6;
/// Distance of two gradients, as correlations, that ill-conditioned columns make by rounding.
const REACHED: f64 = 1e-10;

/// Coefficients that one thread certifies at once.
const PIECE: usize = 1 << 13;

/// Distance of coefficients from the minimum.
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
        let (what, count) = ("the coefficients", coefficients.len());
        return Err(SparseError::Length { what, actual: count, expected: p });
    }
    if let Some(column) = coefficients.iter().position(|value| !value.is_finite()) {
        return Err(SparseError::ColumnNotFinite { column });
    }
    let size = problem.target_length();
    let delta = Slab::from_fn(p, 1, |j, _| coefficients[j] * (problem.length[j] / size));
    let shape = Columns { weights: &weights, l1: strength.l1 / weights.tau, l2: strength.l2 };
    let mut certificate = certify(problem, &weights, strength.l2, &[shape], &delta);
    // A column that takes no part has no place in correlation form.
    if (0..p).any(|j| coefficients[j] != 0.0 && !weights.used(j)) {
        certificate[0].0.kkt = f64::INFINITY;
    }
    Ok(certificate[0].0)
}

/// Certificates and squared residuals (unit target) of coefficients in correlation form, one column and one shape of the penalty a problem; `l2` is the weight of
/// the squares.
pub(crate) fn certify<S: Shape>(
    problem: &Quadratic,
    weights: &Weights,
    l2: f64,
    shapes: &[S],
    delta: &Slab,
) -> Vec<(Certificate, f64)> {
    let (correlations, rss) = problem.residual_correlations(delta);
    let certify = |k: usize| {
        let point = Point {
            problem,
            weights,
            shape: &shapes[k],
            l2,
            delta: delta.column(k),
            correlations: correlations.column(k),
            rss: rss[k],
        };
        (point.certificate(), rss[k])
    };
    let mut certificates = vec![None; shapes.len()];
    let at_once = (PIECE / problem.columns().max(1)).max(1);
    parallel_pieces(&mut certificates, at_once, |piece, part| {
        part.iter_mut().zip(piece * at_once..).for_each(|(certificate, k)| *certificate = Some(certify(k)));
    });
    certificates.into_iter().flatten().collect()
}

/// Coefficients with all that is known about them, in correlation form.
struct Point<'a, S> {
    problem: &'a Quadratic,
    weights: &'a Weights,
    shape: &'a S,
    l2: f64,
    delta: &'a [f64],
    correlations: &'a [f64],
    rss: f64,
}

impl<S: Shape> Point<'_, S> {
    /// The correlations less the ridge (p).
    fn gradient(&self) -> Vec<f64> {
        let gradient = |j: usize| self.correlations[j] - self.l2 * self.weights.rho[j] * self.delta[j];
        (0..self.problem.columns()).map(gradient).collect()
    }

    fn certificate(&self) -> Certificate {
        let kkt = self.shape.violation(self.delta, &self.gradient());
        let objective = self.weights.tau.powi(2) * (0.5 * self.rss + self.shape.value(self.delta));
        let used: Vec<usize> = (0..self.problem.columns()).filter(|&j| self.weights.used(j)).collect();
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
        let original = self.gradient();
        let wanted = self.shape.goals(self.delta, &original);
        let mut gradient = original.clone();
        let mut moved: Vec<usize> = Vec::new();
        // |v|^2 and g'step.
        let (mut length, mut along) = (0.0, 0.0);
        // Columns that the step of the others pushes beyond their bounds take part from then on.
        loop {
            let goals = self.shape.goals(self.delta, &gradient);
            let out = |&j: &usize| self.shape.limit(j) <= least && gradient[j] != goals[j];
            let more: Vec<usize> = used.iter().copied().filter(|j| out(j) && !moved.contains(j)).collect();
            if more.is_empty() {
                break;
            }
            moved.extend(more);
            let mut excess = vec![0.0; original.len()];
            moved.iter().for_each(|&j| excess[j] = original[j] - wanted[j]);
            let step = self.project(&moved, &excess);
            let explained = self.explained(&step);
            for &j in used {
                gradient[j] = original[j] - explained[j] - ridge(j) * step[j];
            }
            // A limit that is reached but for rounding is reached. Without a penalty all columns get there; with one, columns that depend on each other may not.
            for &j in &moved {
                if self.shape.limit(j) == 0.0 || (gradient[j] - wanted[j]).abs() <= REACHED {
                    gradient[j] = wanted[j];
                }
            }
            length = moved.iter().map(|&j| step[j] * (original[j] - gradient[j])).sum::<f64>().max(0.0);
            along = moved.iter().map(|&j| step[j] * gradient[j]).sum();
        }
        let scale = self.shape.feasible(&gradient);
        let whole = self.rss + used.iter().map(|&j| ridge(j) * self.delta[j].powi(2)).sum::<f64>();
        let left = (whole - length - 2.0 * along).max(0.0);
        let slack = self.shape.slack(scale, self.delta, &gradient);
        0.5 * length + 0.5 * (1.0 - scale).powi(2) * left + (1.0 - scale) * along.max(0.0) + slack
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
        let solution = cholesky::solve(&matrix, &wanted, 8.0 * f64::EPSILON * (p + 1) as f64);
        let mut step = vec![0.0; p];
        columns.iter().zip(&solution).for_each(|(&j, value)| step[j] = *value);
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

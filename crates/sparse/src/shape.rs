//! Shape of a penalty for the certificate: a set in the space of gradients, whichever columns it joins.

use crate::penalty::{Sign, Weights};

/// A penalty at one strength, in correlation form (p columns).
///
/// The certificate of coefficients under any penalty needs this and nothing else: a new penalty brings a new shape, not a new certificate.
pub(crate) trait Shape: Sync {
    /// The penalty of coefficients.
    fn value(&self, delta: &[f64]) -> f64;

    /// The largest gradient of column j alone that leaves it at zero: 0 where it is not penalised.
    fn limit(&self, j: usize) -> f64;

    /// The gradients (p) nearest to these that belong to a minimiser with these coefficients.
    fn goals(&self, delta: &[f64], gradient: &[f64]) -> Vec<f64>;

    /// The largest violation of the optimality conditions; infinite where a sign constraint is broken.
    fn violation(&self, delta: &[f64], gradient: &[f64]) -> f64;

    /// The largest factor, at most 1, that makes the gradients feasible for the dual.
    fn feasible(&self, gradient: &[f64]) -> f64;

    /// The penalty, without its squares, less `scale gradient'delta`: for feasible gradients a sum of terms that are
    /// not negative.
    fn slack(&self, scale: f64, delta: &[f64], gradient: &[f64]) -> f64;
}

/// `sum l1 omega_j |d_j| + l2/2 sum rho_j d_j^2` under sign constraints: every column stands alone.
pub(crate) struct Columns<'a> {
    pub(crate) weights: &'a Weights,
    /// In units of the target's deviation.
    pub(crate) l1: f64,
    pub(crate) l2: f64,
}

impl Columns<'_> {
    fn used(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        (0..self.weights.omega.len()).filter(|&j| self.weights.used(j))
    }

    /// The part of a gradient that pushes column j from zero to where it is allowed to go.
    fn push(&self, j: usize, gradient: f64) -> f64 {
        match self.weights.signs[j] {
            Sign::Free => gradient.abs(),
            Sign::NonNegative => gradient,
            Sign::NonPositive => -gradient,
        }
    }

    fn goal(&self, j: usize, delta: f64, gradient: f64) -> f64 {
        let limit = self.limit(j);
        if delta != 0.0 {
            return limit * delta.signum();
        }
        match self.weights.signs[j] {
            Sign::Free => gradient.clamp(-limit, limit),
            Sign::NonNegative => gradient.min(limit),
            Sign::NonPositive => gradient.max(-limit),
        }
    }
}

impl Shape for Columns<'_> {
    fn value(&self, delta: &[f64]) -> f64 {
        let value = |j: usize| {
            let delta = delta[j];
            self.limit(j) * delta.abs() + 0.5 * self.l2 * self.weights.rho[j] * delta * delta
        };
        self.used().map(value).sum()
    }

    fn limit(&self, j: usize) -> f64 {
        self.l1 * self.weights.omega[j]
    }

    fn goals(&self, delta: &[f64], gradient: &[f64]) -> Vec<f64> {
        let mut goals = gradient.to_vec();
        self.used().for_each(|j| goals[j] = self.goal(j, delta[j], gradient[j]));
        goals
    }

    fn violation(&self, delta: &[f64], gradient: &[f64]) -> f64 {
        let violation = |j: usize| match self.weights.signs[j].allows(delta[j]) {
            true => (gradient[j] - self.goal(j, delta[j], gradient[j])).abs(),
            false => f64::INFINITY,
        };
        self.used().map(violation).fold(0.0, f64::max)
    }

    fn feasible(&self, gradient: &[f64]) -> f64 {
        self.used().fold(1.0, |scale: f64, j| {
            let (push, limit) = (self.push(j, gradient[j]), self.limit(j));
            if push > limit { scale.min(limit / push) } else { scale }
        })
    }

    fn slack(&self, scale: f64, delta: &[f64], gradient: &[f64]) -> f64 {
        let slack = |j: usize| (self.limit(j) * delta[j].abs() - scale * gradient[j] * delta[j]).max(0.0);
        self.used().map(slack).sum()
    }
}

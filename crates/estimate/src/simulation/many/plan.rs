//! Plan of a trial step: a Krylov subspace, or in a convex set the way to a point of it.

use faer::{Mat, Side, linalg::solvers::Solve};
use fleetfoot_stats::kernel::norm;

use super::{Metric, Near, dot};
use crate::{
    EstimateError,
    products::compressed,
    step::{Region, Step, step},
};

/// Share of the gradient that a subspace may leave.
const LEFT: f64 = 0.1;
/// Number of previous values of the quadratic model; a step in a set may rise to the largest of them (Birgin, Martinez
/// and Raydan, Nonmonotone spectral projected gradient methods on convex sets, 2000).
const REMEMBERED: usize = 4;

/// The steps that may be tried from a point, whatever the radius of trust.
pub(super) enum Plan {
    Free(Subspace),
    Held(Way),
}

impl Plan {
    /// The step within a radius (p), and its prediction by the quadratic model.
    pub(super) fn step(&self, metric: &Metric, tau: f64, radius: f64) -> Result<(Vec<f64>, Step), EstimateError> {
        match self {
            Self::Free(subspace) => {
                let (whole, trial) = subspace.step(tau, radius)?;
                Ok((metric.down(&whole), trial))
            }
            Self::Held(way) => Ok(way.step(radius)),
        }
    }
}

/// An orthonormal basis of a Krylov subspace, in the coordinates `L' s`, and J'J in it.
pub(super) struct Subspace {
    basis: Vec<Vec<f64>>,
    /// `Q' L^-1 J'J L^-T Q`.
    products: Mat<f64>,
    /// Length of the gradient, which is along the first direction.
    length: f64,
}

impl Subspace {
    /// J'J and the prior.
    fn matrix(&self, tau: f64) -> Mat<f64> {
        let m = self.basis.len();
        Mat::from_fn(m, m, |i, j| self.products[(i, j)] + if i == j { tau } else { 0.0 })
    }

    /// The last coordinate of the step without a radius, for a gradient of unit length. Times the remainder of the last
    /// product outside the basis, it is the gradient that the step leaves.
    fn last(&self, tau: f64) -> Option<f64> {
        let first = Mat::from_fn(self.basis.len(), 1, |i, _| if i == 0 { -1.0 } else { 0.0 });
        Some(self.matrix(tau).llt(Side::Lower).ok()?.solve(&first)[(self.basis.len() - 1, 0)])
    }

    /// The step within a radius, in the coordinates `L' s`.
    fn step(&self, tau: f64, radius: f64) -> Result<(Vec<f64>, Step), EstimateError> {
        let m = self.basis.len();
        let slope: Vec<f64> = (0..m).map(|i| if i == 0 { self.length } else { 0.0 }).collect();
        let (jacobian, rhs) = compressed(&self.matrix(tau), &slope).ok_or(EstimateError::Overflow)?;
        let room = vec![[f64::NEG_INFINITY, f64::INFINITY]; m];
        let trial = step(&jacobian, &rhs, &Region { scale: &vec![1.0; m], radius, room: &room })?;
        let mut whole = vec![0.0; self.basis.first().map_or(0, Vec::len)];
        for (share, q) in trial.step.iter().zip(&self.basis) {
            whole.iter_mut().zip(q).for_each(|(value, q)| *value += share * q);
        }
        Ok((whole, trial))
    }
}

/// The way to a point of a convex set; all points on it are of the set.
#[derive(Clone)]
pub(super) struct Way {
    step: Vec<f64>,
    /// `g's` and `s'(J'J + tau H)s`.
    slope: f64,
    curvature: f64,
    /// `|s|_H`.
    length: f64,
}

impl Way {
    /// Half of the quadratic model's rise over a share of the way.
    fn rise(&self, share: f64) -> f64 {
        share * (self.slope + 0.5 * share * self.curvature)
    }

    fn step(&self, radius: f64) -> (Vec<f64>, Step) {
        let share = if self.length > radius { radius / self.length } else { 1.0 };
        let step: Vec<f64> = self.step.iter().map(|value| share * value).collect();
        let predicted = -2.0 * self.rise(share);
        let length = share * self.length;
        (step, Step { step: Vec::new(), length, reach: length, predicted, bounded: share < 1.0, damping: 0.0 })
    }
}

impl Near<'_> {
    /// Plan of a trial step at theta, for half the derivative of F; every direction is a pass.
    pub(super) fn plan(&mut self, gradient: &[f64]) -> Result<Plan, EstimateError> {
        match self.held {
            None => Ok(Plan::Free(self.subspace(gradient)?)),
            Some(_) => Ok(Plan::Held(self.way(gradient)?)),
        }
    }

    fn subspace(&mut self, gradient: &[f64]) -> Result<Subspace, EstimateError> {
        let slope = self.metric.slope(gradient);
        let length = norm(slope.iter().copied());
        let most = self.options().directions.min(slope.len());
        let mut subspace = Subspace { basis: Vec::new(), products: Mat::zeros(0, 0), length };
        let mut next: Vec<f64> = slope.iter().map(|value| value / length).collect();
        while subspace.basis.len() < most {
            let direction = self.metric.down(&next);
            let product = self.rows.along(&self.theta, &direction, self.at.segments)?;
            subspace.basis.push(next);
            let mut left = self.metric.slope(&product.back);
            let (m, old) = (subspace.basis.len(), subspace.products);
            let along: Vec<f64> = subspace.basis.iter().map(|q| dot(q, &left)).collect();
            subspace.products =
                Mat::from_fn(m, m, |i, j| if i.max(j) + 1 == m { along[i.min(j)] } else { old[(i, j)] });
            // Twice is enough for orthogonality to rounding.
            for _ in 0..2 {
                for q in &subspace.basis {
                    let part = dot(q, &left);
                    left.iter_mut().zip(q).for_each(|(left, q)| *left -= part * q);
                }
            }
            let size = norm(left.iter().copied());
            let share = subspace.last(self.tau).map_or(0.0, |last| size * last.abs());
            if share <= LEFT || size == 0.0 || !size.is_finite() {
                break;
            }
            next = left.into_iter().map(|value| value / size).collect();
        }
        Ok(subspace)
    }

    /// The way to the least value of the quadratic model in the set, by spectral projected gradients in the metric H.
    fn way(&mut self, gradient: &[f64]) -> Result<Way, EstimateError> {
        let p = gradient.len();
        let mut at = Way { step: vec![0.0; p], slope: 0.0, curvature: 0.0, length: 0.0 };
        let (mut best, mut values, mut slope) = (at.clone(), vec![0.0], gradient.to_vec());
        let mut spectral = 1.0 / self.tau;
        for _ in 0..self.options().directions {
            let downhill = self.metric.down(&self.metric.slope(&slope));
            let there: Vec<f64> = (0..p).map(|j| self.theta[j] + at.step[j] - spectral * downhill[j]).collect();
            let Some(nearest) = self.nearest(&there) else { break };
            let direction: Vec<f64> = (0..p).map(|j| nearest[j] - self.theta[j] - at.step[j]).collect();
            let along = dot(&slope, &direction);
            if along.is_nan() || along >= 0.0 {
                break;
            }
            let product = self.rows.along(&self.theta, &direction, self.at.segments)?;
            let pull = self.metric.times(&direction);
            let square = dot(&pull, &direction);
            let curvature = product.square + self.tau * square;
            // Between two points of a convex set all are of it.
            let least = (-along / curvature).min(1.0);
            let highest = values.iter().rev().take(REMEMBERED).copied().fold(f64::NEG_INFINITY, f64::max);
            let whole = at.rise(1.0) + along + 0.5 * curvature <= highest;
            let share = if whole && values.len() > 1 { 1.0 } else { least };
            for j in 0..p {
                at.step[j] += share * direction[j];
                slope[j] += share * (product.back[j] + self.tau * pull[j]);
            }
            at.slope = dot(gradient, &at.step);
            at.curvature = dot(&slope, &at.step) - at.slope;
            values.push(at.rise(1.0));
            if at.rise(1.0) < best.rise(1.0) {
                best = at.clone();
            }
            spectral = square / curvature;
        }
        best.length = norm(self.metric.up(&best.step));
        Ok(best)
    }
}

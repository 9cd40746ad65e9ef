//! The primal-dual interior point.
//!
//! With z = D x = z+ - z-, z+ and z- not negative, u the multipliers of D x = z, s+ = lambda - u and s- = lambda + u, the conditions of the least value are
//!
//! ```text
//! w (x - y) + D' u = 0,   D x = z+ - z-,   z+ s+ = 0,   z- s- = 0,   all of z+, z-, s+, s- >= 0
//! ```
//!
//! Newton's method goes for z s = mu with falling mu (Mehrotra's predictor and corrector, "On the implementation of a primal-dual interior point method", SIAM Journal on Optimization 2, 1992). It
//! begins at x = y, u = 0, where the linear conditions hold, and they hold from then on. The duality gap is the sum of all z s.

use super::chain::{Least, Points};

/// Steps after which no smaller gap is to be had.
const MOST: usize = 200;

/// The share of the objective that the gap may be.
const GAP: f64 = 1e-6;

/// The share of the objective at which the iteration ends, so that borders are told from what is not quite zero.
const FINE: f64 = 1e-10;

/// Largest share of the way to the border of the feasible set in a step.
const NEAR: f64 = 0.99;

/// A trend in the units of its points.
pub(super) struct Solution {
    pub(super) x: Vec<f64>,
    z: Vec<f64>,
    u: Vec<f64>,
    lambda: f64,
    pub(super) objective: f64,
    pub(super) gap: f64,
    pub(super) converged: bool,
    pub(super) iterations: usize,
}

impl Solution {
    /// The steps of the k-th derivative that are not zero: where z is larger, in units of the largest, than the multiplier's distance from lambda, in units of it. What all
    /// steps together add to the objective by no more than a ten-millionth of it, is not there.
    pub(super) fn borders(&self) -> impl Iterator<Item = usize> {
        let least = 1e-7 * self.objective / self.lambda;
        let most = self.z.iter().fold(least.max(f64::MIN_POSITIVE), |most, z| most.max(z.abs()));
        let is_border = move |j: &usize| self.z[*j].abs() / most > (self.lambda - self.u[*j].abs()) / self.lambda;
        (0..self.z.len()).filter(is_border)
    }
}

/// Current iterate.
struct Iterate {
    x: Vec<f64>,
    u: Vec<f64>,
    /// z+ and z-.
    up: Vec<f64>,
    down: Vec<f64>,
    /// s+ and s-, kept for themselves: lambda - u has no digits left where they are small.
    above: Vec<f64>,
    below: Vec<f64>,
}

/// A direction.
struct Direction {
    least: Least,
    up: Vec<f64>,
    down: Vec<f64>,
}

impl Points {
    /// The trend of a penalty.
    pub(super) fn solved<const M: usize>(&self, lambda: f64) -> Solution {
        let mut at = Iterate::new::<M>(self, lambda);
        let m = at.u.len() as f64;
        let (mut iterations, mut objective, mut gap) = (0, self.objective(&at, lambda), at.gap());
        // Rounding of values of size one: nothing less is meant by them.
        let least = f64::EPSILON * f64::EPSILON * self.variances.iter().map(|variance| 1.0 / variance).sum::<f64>();
        while gap > FINE * objective + least && iterations < MOST {
            let theta: Vec<f64> = (0..at.u.len()).map(|j| at.up[j] / at.above[j] + at.down[j] / at.below[j]).collect();
            let gains = self.gains::<M>(&theta);
            let direction = |rho: Vec<[f64; 2]>| at.direction(rho, |rho| self.least(&gains, None, rho));
            let mean = gap / (2.0 * m);
            let affine = direction(at.pushes(0.0, None));
            let step = at.longest(&affine).min(1.0);
            let left = at.gap_after(&affine, step) / (2.0 * m);
            let centre = mean * (left / mean).powi(3);
            let corrected = direction(at.pushes(centre, Some(&affine)));
            let step = (NEAR * at.longest(&corrected)).min(1.0);
            at.go(&corrected, step);
            iterations += 1;
            (objective, gap) = (self.objective(&at, lambda), at.gap());
            if step < 1e-10 {
                break;
            }
        }
        let z = at.up.iter().zip(&at.down).map(|(up, down)| up - down).collect();
        let converged = gap <= GAP * objective + least;
        Solution { x: at.x, z, u: at.u, lambda, objective, gap, converged, iterations }
    }

    fn objective(&self, at: &Iterate, lambda: f64) -> f64 {
        let variation: f64 = at.up.iter().zip(&at.down).map(|(up, down)| (up - down).abs()).sum();
        0.5 * self.squares(&at.x) + lambda * variation
    }
}

impl Iterate {
    fn new<const M: usize>(points: &Points, lambda: f64) -> Self {
        let z = points.differences::<M>(&points.values);
        let size = z.iter().map(|z| z.abs()).sum::<f64>() / z.len() as f64;
        // A channel that is a polynomial already.
        let size = size.max(f64::MIN_POSITIVE.sqrt());
        let part = |sign: f64| z.iter().map(|z| (sign * z).max(0.0) + size).collect();
        let slack = vec![lambda; z.len()];
        let (up, down) = (part(1.0), part(-1.0));
        Self { x: points.values.clone(), u: vec![0.0; z.len()], up, down, above: slack.clone(), below: slack }
    }

    fn gap(&self) -> f64 {
        (0..self.u.len()).map(|j| self.up[j] * self.above[j] + self.down[j] * self.below[j]).sum()
    }

    /// Changes of z+ and z- for fixed u: mu / s - z, with the product of the affine changes taken into account.
    fn pushes(&self, centre: f64, affine: Option<&Direction>) -> Vec<[f64; 2]> {
        let push = |j: usize| {
            let [up, down] = affine.map_or([0.0; 2], |direction| {
                let du = direction.least.u[j];
                [-direction.up[j] * du, direction.down[j] * du]
            });
            [(centre - up) / self.above[j] - self.up[j], (centre - down) / self.below[j] - self.down[j]]
        };
        (0..self.u.len()).map(push).collect()
    }

    fn direction(&self, pushes: Vec<[f64; 2]>, least: impl Fn(&[f64]) -> Least) -> Direction {
        let rho: Vec<f64> = pushes.iter().map(|[up, down]| up - down).collect();
        let least = least(&rho);
        let change = |side: usize, z: &[f64], s: &[f64], sign: f64| -> Vec<f64> {
            (0..rho.len()).map(|j| pushes[j][side] + sign * z[j] / s[j] * least.u[j]).collect()
        };
        let (up, down) = (change(0, &self.up, &self.above, 1.0), change(1, &self.down, &self.below, -1.0));
        Direction { least, up, down }
    }

    /// The longest step that leaves all that must not be negative where it may be.
    fn longest(&self, direction: &Direction) -> f64 {
        let within = |value: f64, change: f64| if change < 0.0 { -value / change } else { f64::INFINITY };
        let of = |j: usize| {
            let du = direction.least.u[j];
            let primal = within(self.up[j], direction.up[j]).min(within(self.down[j], direction.down[j]));
            primal.min(within(self.above[j], -du)).min(within(self.below[j], du))
        };
        (0..self.u.len()).map(of).fold(f64::INFINITY, f64::min)
    }

    fn gap_after(&self, direction: &Direction, step: f64) -> f64 {
        let of = |j: usize| {
            let du = step * direction.least.u[j];
            (self.up[j] + step * direction.up[j]) * (self.above[j] - du)
                + (self.down[j] + step * direction.down[j]) * (self.below[j] + du)
        };
        (0..self.u.len()).map(of).sum()
    }

    fn go(&mut self, direction: &Direction, step: f64) {
        let add = |values: &mut [f64], changes: &[f64], step: f64| {
            values.iter_mut().zip(changes).for_each(|(value, change)| *value += step * change);
        };
        add(&mut self.x, &direction.least.x, step);
        add(&mut self.u, &direction.least.u, step);
        add(&mut self.up, &direction.up, step);
        add(&mut self.down, &direction.down, step);
        add(&mut self.above, &direction.least.u, -step);
        add(&mut self.below, &direction.least.u, step);
    }
}

//! The nearest coefficients with which a linear map contracts.
//!
//! Sought is, for a matrix K that is affine in coefficients Y (s x q),
//!
//! ```text
//! min 1/2 |Y - Y0|_F^2    subject to    |K(Y)|_2 <= rho,    K(Y) = K0 + U Y' V
//! ```
//!
//! The constraint says that `F(Y) = [rho I, K; K', rho I]` has no negative eigenvalue, so that the problem is a small semidefinite program. It is solved along
//! its central path: Newton's method minimises `tau f(Y) - log det F(Y)` for growing tau (Nesterov and Nemirovskii 1994; Boyd and Vandenberghe 2004, section 11.6),
//! and every iterate carries a certificate. With the dual point `Lambda = F^-1 / tau` and `c = <Lambda, dF/dY>` the duality gap is
//!
//! ```text
//! f(Y) - g(Lambda) = 1/2 |Y - Y0 - c|_F^2 + 2 n / tau
//! ```
//!
//! whether Newton's method has converged or not, and without cancellation. The inverse of F follows from the singular values of K, so that the distance to the
//! border keeps its digits.

// Matrices are capitals.
#![allow(non_snake_case)]

mod lyapunov;

pub use lyapunov::{lyapunov, spectral_radius};

use faer::{Mat, MatRef, Side, linalg::solvers::Solve};
use fleetfoot_data::checkpoint;

use crate::{Svd, svd};

/// A matrix that is affine in coefficients, and the bound of its largest singular value: `|K0 + U Y' V| <= rho`.
#[derive(Debug, Clone)]
pub struct Contraction {
    /// K0 (n x n): what no coefficient moves.
    pub offset: Mat<f64>,
    /// U (n x q): where the coefficients of a target go.
    pub left: Mat<f64>,
    /// V (s x n): what a coefficient multiplies.
    pub right: Mat<f64>,
    /// rho, positive.
    pub bound: f64,
}

/// The answer, inside of the bound.
#[derive(Debug, Clone)]
pub struct Contracted {
    /// Y (s x q).
    pub values: Mat<f64>,
    /// K (n x n).
    pub matrix: Mat<f64>,
    /// The largest singular value of K.
    pub norm: f64,
    /// `1/2 |Y - Y0|^2`.
    pub distance: f64,
    /// Duality gap: no coefficients within the bound are nearer by more than this.
    pub gap: f64,
    /// The block of the dual point that belongs to K (n x n): by how much less the distance would be if K were elsewhere.
    pub multiplier: Mat<f64>,
}

/// Steps of Newton's method at most; some thirty are usual.
const STEPS: usize = 400;
/// By what the weight of the distance grows from centre to centre.
const GROWTH: f64 = 20.0;

impl Contraction {
    /// K at coefficients Y (s x q).
    pub fn matrix(&self, values: MatRef<'_, f64>) -> Mat<f64> {
        &self.offset + &self.left * (values.transpose() * &self.right)
    }

    /// The coefficients for which K is least in the norm of its entries; `None` where a decomposition fails.
    pub fn least(&self) -> Option<Mat<f64>> {
        let left = pseudo_inverse(self.left.as_ref())?;
        let right = pseudo_inverse(self.right.as_ref())?;
        // U Y' V = -K0 as near as it can be.
        let values = &left * &self.offset * &right;
        Some(Mat::from_fn(values.ncols(), values.nrows(), |b, t| -values[(t, b)]))
    }

    /// The coefficients nearest to `wanted` (s x q) within the bound, from `start` strictly within it, to a relative duality gap of `tolerance`.
    ///
    /// Coefficients within the bound are returned unchanged. `None` if `start` is not strictly within the bound or a
    /// number is not finite. The duality gap states how far the search converged.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn nearest(&self, wanted: MatRef<'_, f64>, start: MatRef<'_, f64>, tolerance: f64) -> Option<Contracted> {
        self.search(wanted, start, tolerance, |at, step, _| at.moved(step))
    }

    /// [`Contraction::nearest`] by Newton steps that are as long as the centre's function falls on, in place of those that are known to be short enough: several times as fast, with the
    /// same certificate.
    ///
    /// # Panics
    /// When the shapes disagree.
    pub fn nearest_by_long_steps(
        &self,
        wanted: MatRef<'_, f64>,
        start: MatRef<'_, f64>,
        tolerance: f64,
    ) -> Option<Contracted> {
        self.search(wanted, start, tolerance, |at, step, tau| at.moved_far(step, tau))
    }

    fn search(
        &self,
        wanted: MatRef<'_, f64>,
        start: MatRef<'_, f64>,
        tolerance: f64,
        moved: impl for<'a> Fn(&Centre<'a>, &Step, f64) -> Option<Centre<'a>>,
    ) -> Option<Contracted> {
        let n = self.offset.nrows() as f64;
        let there = self.matrix(wanted);
        let norm = svd(there.as_ref())?.s.first().copied().unwrap_or(0.0);
        if norm <= self.bound {
            let multiplier = Mat::zeros(there.nrows(), there.nrows());
            return Some(Contracted {
                values: wanted.to_owned(),
                matrix: there,
                norm,
                distance: 0.0,
                gap: 0.0,
                multiplier,
            });
        }
        let mut at = Centre::new(self, wanted, start.to_owned())?;
        // The gap at the first centre is about the distance of the start.
        let mut tau = 2.0 * n / at.distance.max(f64::MIN_POSITIVE);
        // Of the points near a centre the one of least gap, and whether the weight still grows.
        let (mut best, mut grows): (Option<(Centre<'_>, f64, f64)>, bool) = (None, true);
        for _ in 0..STEPS {
            checkpoint();
            let step = at.newton(tau);
            if let Some(step) = step.as_ref().filter(|step| step.decrement < 0.1) {
                let (wanted, gap) = (tolerance * at.distance, at.gap(tau));
                let falls = best.as_ref().is_none_or(|(_, _, least)| gap < *least);
                if falls {
                    best = Some((at.clone(), tau, gap));
                }
                if gap <= wanted || step.decrement < 1e-12 || !(falls || grows) {
                    break;
                }
                // On the path at this weight; what is left of the gap is then Newton's.
                if grows && 4.0 * n / tau > wanted {
                    tau *= GROWTH;
                    continue;
                }
            }
            if let Some(next) = step.and_then(|step| moved(&at, &step, tau)) {
                at = next;
            } else if grows && let Some((before, weight, _)) = best.take() {
                // Rounding bars the way to the centre of this weight, and what is left is to be had at the one before.
                (at, tau, grows) = (before, weight, false);
            } else {
                break;
            }
        }
        let gap = at.gap(tau);
        Some(match best {
            Some((before, weight, least)) if least < gap => before.answer(weight),
            _ => at.answer(tau),
        })
    }
}

/// `A^+` (n x m), directions of rounding left out.
fn pseudo_inverse(a: MatRef<'_, f64>) -> Option<Mat<f64>> {
    let Svd { u, s, v } = svd(a)?;
    let least = s.first().map_or(0.0, |largest| largest * 16.0 * f64::EPSILON * (a.ncols() as f64 + 1.0));
    let rank = s.iter().filter(|&&s| s > least).count();
    let scaled = Mat::from_fn(a.ncols(), rank, |j, k| v[(j, k)] / s[k]);
    Some(&scaled * u.subcols(0, rank).transpose())
}

/// A point within the bound.
#[derive(Clone)]
struct Centre<'a> {
    problem: &'a Contraction,
    wanted: MatRef<'a, f64>,
    values: Mat<f64>,
    matrix: Mat<f64>,
    factors: Svd,
    distance: f64,
}

/// A step of Newton's method.
struct Step {
    /// s x q.
    direction: Mat<f64>,
    /// Newton's decrement: how far the centre is, in its own metric.
    decrement: f64,
}

impl<'a> Centre<'a> {
    fn new(problem: &'a Contraction, wanted: MatRef<'a, f64>, values: Mat<f64>) -> Option<Self> {
        let matrix = problem.matrix(values.as_ref());
        let factors = svd(matrix.as_ref())?;
        let norm = factors.s.first().copied().unwrap_or(0.0);
        let distance = 0.5 * (&values - wanted).squared_norm_l2();
        (norm < problem.bound && distance.is_finite()).then_some(Self {
            problem,
            wanted,
            values,
            matrix,
            factors,
            distance,
        })
    }

    /// Of `F^-1`: the diagonal blocks are `W diag(rho / (rho^2 - sigma^2)) W'` and the same of Z, the other one `-W diag(sigma / (rho^2 - sigma^2)) Z'`,
    /// for `K = W diag(sigma) Z'`.
    fn inverse(&self) -> (Vec<f64>, Vec<f64>) {
        let rho = self.problem.bound;
        self.factors.s.iter().map(|s| (rho / ((rho - s) * (rho + s)), s / ((rho - s) * (rho + s)))).unzip()
    }

    /// `U' W diag(d) Z' V'` (q x s) for the singular vectors of K.
    fn across(&self, d: &[f64]) -> Mat<f64> {
        let (W, Z) = (self.problem.left.transpose() * &self.factors.u, &self.problem.right * &self.factors.v);
        let scaled = Mat::from_fn(W.nrows(), d.len(), |t, k| W[(t, k)] * d[k]);
        &scaled * Z.transpose()
    }

    fn newton(&self, tau: f64) -> Option<Step> {
        let (diagonal, other) = self.inverse();
        let gram = |A: Mat<f64>| {
            let scaled = Mat::from_fn(A.nrows(), A.ncols(), |i, k| A[(i, k)] * diagonal[k]);
            &scaled * A.transpose()
        };
        let of_left = gram(self.problem.left.transpose() * &self.factors.u);
        let of_right = gram(&self.problem.right * &self.factors.v);
        let B = self.across(&other);
        let (s, q) = (self.values.nrows(), self.values.ncols());
        let unit = |i: usize| (i % s, i / s);
        let hessian = Mat::from_fn(s * q, s * q, |i, j| {
            let ((b, t), (c, o)) = (unit(i), unit(j));
            2.0 * (B[(o, b)] * B[(t, c)] + of_right[(b, c)] * of_left[(t, o)]) + if i == j { tau } else { 0.0 }
        });
        let slope = Mat::from_fn(s * q, 1, |i, _| {
            let (b, t) = unit(i);
            -(tau * (self.values[(b, t)] - self.wanted[(b, t)]) + 2.0 * B[(t, b)])
        });
        let newton_step = hessian.llt(Side::Lower).ok()?.solve(&slope);
        let decrement = (0..s * q).map(|i| slope[(i, 0)] * newton_step[(i, 0)]).sum::<f64>();
        let direction = Mat::from_fn(s, q, |b, t| newton_step[(t * s + b, 0)]);
        decrement.is_finite().then(|| Step { direction, decrement: decrement.max(0.0).sqrt() })
    }

    /// The damped step of self-concordant functions, which stays within the bound; shortened where rounding says otherwise.
    fn moved(&self, step: &Step) -> Option<Self> {
        let mut length = if step.decrement > 0.25 { 1.0 / (1.0 + step.decrement) } else { 1.0 };
        for _ in 0..20 {
            let values = &self.values + faer::Scale(length) * &step.direction;
            if let Some(next) = Self::new(self.problem, self.wanted, values) {
                return Some(next);
            }
            length *= 0.5;
        }
        None
    }

    /// The longest of halved steps that lowers the centre's function by a tenth of what its slope promises.
    fn moved_far(&self, step: &Step, tau: f64) -> Option<Self> {
        let rho = self.problem.bound;
        let value =
            |at: &Self| tau * at.distance - at.factors.s.iter().map(|s| ((rho - s) * (rho + s)).ln()).sum::<f64>();
        let (before, promised) = (value(self), step.decrement * step.decrement);
        let mut length = 1.0;
        for _ in 0..40 {
            let values = &self.values + faer::Scale(length) * &step.direction;
            if let Some(next) = Self::new(self.problem, self.wanted, values)
                && value(&next) <= before - 0.1 * length * promised
            {
                return Some(next);
            }
            length *= 0.5;
        }
        self.moved(step)
    }

    fn gap(&self, tau: f64) -> f64 {
        let B = self.across(&self.inverse().1);
        let (s, q) = (self.values.nrows(), self.values.ncols());
        let off = |b: usize, t: usize| self.values[(b, t)] - self.wanted[(b, t)] + 2.0 * B[(t, b)] / tau;
        let square: f64 = (0..q).flat_map(|t| (0..s).map(move |b| (b, t))).map(|(b, t)| off(b, t).powi(2)).sum();
        0.5 * square + 2.0 * self.problem.offset.nrows() as f64 / tau
    }

    fn answer(self, tau: f64) -> Contracted {
        let other = self.inverse().1;
        let scaled = Mat::from_fn(self.matrix.nrows(), other.len(), |i, k| -self.factors.u[(i, k)] * other[k] / tau);
        let multiplier = &scaled * self.factors.v.transpose();
        let (norm, gap) = (self.factors.s.first().copied().unwrap_or(0.0), self.gap(tau));
        Contracted { values: self.values, matrix: self.matrix, norm, distance: self.distance, gap, multiplier }
    }
}

#[cfg(test)]
mod tests;

//! Symmetric matrices of parameters that stay on one side of a bound: inertias, dampings and stiffnesses that are positive definite.
//!
//! Such parameters are a convex set, and the step of Levenberg and Marquardt within it a small semidefinite program: the step s for which
//!
//! ```text
//! |rhs + J s|^2 + mu |D s|^2    is least where    M(theta + s) >= bound
//! ```
//!
//! (as eigenvalues, and with the parameters between their bounds), with the damping mu that the step without the
//! matrices has. It is solved along its central path by Newton's method (Nesterov and Nemirovskii 1994; Boyd and
//! Vandenberghe 2004, section 11.6), so that every step stays strictly within. The logarithm of a Cholesky factor is a
//! parametrisation that is always positive definite. Its border is at infinity, and it never arrives if the rows fit
//! best with a matrix that is not. Here the search ends at the border, and the conditions of the minimum there are
//! reported.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_data::packed;
use fleetfoot_stats::{kernel::norm, svd};

use crate::{
    EstimateError, Parameter,
    evaluation::Evaluation,
    step::{Region, Step},
};

/// A number that is affine in the parameters: `constant + sum_j c_j theta_j`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Affine {
    /// The constant part, without parameters.
    pub constant: f64,
    /// Parameters by number, and their coefficients.
    pub coefficients: Vec<(usize, f64)>,
}

impl Affine {
    /// A parameter itself.
    pub fn parameter(index: usize) -> Self {
        Self { constant: 0.0, coefficients: vec![(index, 1.0)] }
    }

    fn at(&self, theta: &[f64]) -> f64 {
        self.constant + self.coefficients.iter().map(|&(j, c)| c * theta[j]).sum::<f64>()
    }

    fn slope(&self, parameter: usize) -> f64 {
        self.coefficients.iter().filter(|(j, _)| *j == parameter).map(|(_, c)| c).sum()
    }
}

/// A symmetric matrix of parameters whose eigenvalues stay on one side of a bound; of one entry a number.
#[derive(Debug, Clone, PartialEq)]
pub struct MatrixLimit {
    /// Its name in messages: `inertia`.
    pub name: String,
    /// Its lower triangle by rows.
    pub entries: Vec<Affine>,
    /// True if no eigenvalue is below the bound; else none is above it.
    pub at_least: bool,
    /// The bound.
    pub bound: f64,
}

impl MatrixLimit {
    /// Rows and columns.
    pub fn order(&self) -> usize {
        (1..).find(|&order| packed(order - 1, order - 1) + 1 >= self.entries.len()).unwrap_or(1)
    }

    /// The least distance of an eigenvalue from the bound, negative where it is broken.
    pub fn clearance(&self, theta: &[f64]) -> f64 {
        self.eigen(theta).first().map_or(f64::NAN, |(value, _)| *value)
    }

    fn sign(&self) -> f64 {
        if self.at_least { 1.0 } else { -1.0 }
    }

    /// `M - bound`, or the other way round: without negative eigenvalues where the limit is kept.
    fn room(&self, theta: &[f64]) -> Mat<f64> {
        let (n, sign) = (self.order(), self.sign());
        Mat::from_fn(n, n, |i, j| {
            sign * (self.entries[packed(i.max(j), i.min(j))].at(theta) - if i == j { self.bound } else { 0.0 })
        })
    }

    /// Derivative by a parameter.
    fn slope(&self, parameter: usize) -> Mat<f64> {
        let (n, sign) = (self.order(), self.sign());
        Mat::from_fn(n, n, |i, j| sign * self.entries[packed(i.max(j), i.min(j))].slope(parameter))
    }

    /// Eigenvalues of the room, ascending, with their vectors.
    fn eigen(&self, theta: &[f64]) -> Vec<(f64, Vec<f64>)> {
        let room = self.room(theta);
        match room.self_adjoint_eigen(Side::Lower) {
            Ok(decomposition) => (0..room.nrows())
                .map(|k| (decomposition.S()[k], decomposition.U().col(k).iter().copied().collect()))
                .collect(),
            // It refuses what is not finite alone.
            Err(_) => vec![(f64::NAN, vec![0.0; room.nrows()])],
        }
    }

    fn check(&self, parameters: usize) -> Result<(), EstimateError> {
        let n = self.order();
        let triangle = packed(n - 1, n - 1) + 1 == self.entries.len();
        let known = self.entries.iter().flat_map(|entry| &entry.coefficients).all(|(j, _)| *j < parameters);
        if triangle && known && self.bound.is_finite() {
            return Ok(());
        }
        Err(EstimateError::NoMatrix { name: self.name.clone() })
    }
}

/// Parameters and the bounds of their matrices.
#[derive(Debug, Clone, Copy)]
pub struct Bounded<'a> {
    pub(crate) parameters: &'a [Parameter],
    pub(crate) limits: &'a [MatrixLimit],
    /// A point strictly within; the initial values where there is none.
    pub(crate) inside: Option<&'a [f64]>,
}

impl<'a> Bounded<'a> {
    /// Parameters between their own bounds, and matrices of them; the initial values are strictly within.
    pub fn new(parameters: &'a [Parameter], limits: &'a [MatrixLimit]) -> Self {
        Self { parameters, limits, inside: None }
    }
}

impl<'a> From<&'a [Parameter]> for Bounded<'a> {
    fn from(parameters: &'a [Parameter]) -> Self {
        Self::new(parameters, &[])
    }
}

impl<'a> From<&'a Vec<Parameter>> for Bounded<'a> {
    fn from(parameters: &'a Vec<Parameter>) -> Self {
        Self::new(parameters, &[])
    }
}

impl<'a, const N: usize> From<&'a [Parameter; N]> for Bounded<'a> {
    fn from(parameters: &'a [Parameter; N]) -> Self {
        Self::new(parameters, &[])
    }
}

/// An eigenvalue of the room below this share of the matrix is at its bound.
const AT_BOUND: f64 = 1e-6;
/// A multiplier below this share of the slopes is rounding.
const PUSHES: f64 = 1e-8;
/// Growth of the weight of the squares from centre to centre.
const GROWTH: f64 = 20.0;
/// Steps of Newton's method at most; some fifty are usual.
const STEPS: usize = 400;
/// Gap of a step that is left, as a share of the cost.
const GAP: f64 = 1e-13;

/// Limits, checked, with a point strictly within all of them.
#[derive(Debug, Clone)]
pub(crate) struct Limits {
    limits: Vec<MatrixLimit>,
    bounds: Vec<[f64; 2]>,
    inside: Vec<f64>,
}

impl Limits {
    /// `None` without limits. `more`: the bounds of further unknowns behind the parameters.
    pub(crate) fn new(of: &Bounded<'_>, more: &[[f64; 2]]) -> Result<Option<Self>, EstimateError> {
        if of.limits.is_empty() {
            return Ok(None);
        }
        of.limits.iter().try_for_each(|limit| limit.check(of.parameters.len()))?;
        let bounds: Vec<[f64; 2]> =
            of.parameters.iter().map(|parameter| parameter.bounds).chain(more.iter().copied()).collect();
        let initial = of.parameters.iter().map(|parameter| parameter.initial);
        let start: Vec<f64> = match of.inside {
            Some(inside) => inside.to_vec(),
            None => initial.chain(more.iter().map(|[low, high]| 0.5 * (low + high))).collect(),
        };
        // A little off the bounds of the parameters themselves.
        let off = |(&value, &[low, high]): (&f64, &[f64; 2])| {
            if low == high {
                return low;
            }
            let width = if (high - low).is_finite() { high - low } else { value.abs().max(1.0) };
            value.max(low + 1e-6 * width).min(high - 1e-6 * width)
        };
        let inside: Vec<f64> = start.iter().zip(&bounds).map(off).collect();
        for limit in of.limits {
            let clearance = limit.clearance(&inside);
            if clearance.is_nan() || clearance <= 0.0 {
                return Err(EstimateError::Outside { name: limit.name.clone(), beyond: -clearance });
            }
        }
        Ok(Some(Self { limits: of.limits.to_vec(), bounds, inside }))
    }

    /// Returns true if all are kept strictly.
    pub(crate) fn kept(&self, theta: &[f64]) -> bool {
        self.limits.iter().all(|limit| limit.clearance(theta) > 0.0)
    }

    /// The nearest point to one beyond, on the way from within, that keeps a hundredth of the way for itself.
    pub(crate) fn pulled(&self, theta: &[f64]) -> Vec<f64> {
        let on_the_way = |share: f64| -> Vec<f64> {
            self.inside.iter().zip(theta).map(|(inside, theta)| inside + share * (theta - inside)).collect()
        };
        if self.kept(theta) {
            return theta.to_vec();
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.kept(&on_the_way(middle)) { low = middle } else { high = middle }
        }
        on_the_way(0.99 * low)
    }

    /// The step from theta within the limits, with the damping of the free one.
    pub(crate) fn step(&self, at: &Evaluation, theta: &[f64], region: &Region<'_>, free_step: &Step) -> Step {
        let program = Program::new(self, at, theta, region, free_step.damping);
        let step = program.solve(at.cost, free_step);
        let mut moved = vec![0.0; at.rhs.len()];
        for (j, &s) in step.iter().enumerate().filter(|(_, s)| **s != 0.0) {
            moved.iter_mut().zip(at.jacobian.col_as_slice(j)).for_each(|(moved, a)| *moved += a * s);
        }
        let predicted = -moved.iter().zip(&at.rhs).map(|(moved, rhs)| moved * (2.0 * rhs + moved)).sum::<f64>();
        let length = norm(step.iter().zip(region.scale).map(|(s, d)| s * d));
        Step { step, length, predicted, ..*free_step }
    }

    /// Effect of the active limits at theta on slopes (half the derivatives of the cost), in units of `lengths`, over
    /// the free parameters. Returns the remaining slopes, and the directions (by parameter) in which nothing may move.
    pub(crate) fn pushed(
        &self,
        theta: &[f64],
        slopes: &[f64],
        lengths: &[f64],
        free: &[usize],
    ) -> (Vec<f64>, Vec<Vec<f64>>) {
        let wanted: Vec<f64> = free.iter().map(|&j| slopes[j] / lengths[j]).collect();
        let mut held: Vec<(Mat<f64>, Vec<Mat<f64>>)> = Vec::new();
        for limit in &self.limits {
            let eigen = limit.eigen(theta);
            let size = eigen.iter().map(|(value, _)| value.abs()).fold(limit.bound.abs(), f64::max);
            let near: Vec<&Vec<f64>> =
                eigen.iter().filter(|(value, _)| *value <= AT_BOUND * size).map(|(_, vector)| vector).collect();
            if near.is_empty() {
                continue;
            }
            let V = Mat::from_fn(limit.order(), near.len(), |i, k| near[k][i]);
            let across = free.iter().map(|&j| V.transpose() * limit.slope(j) * &V).collect();
            held.push((V, across));
        }
        // Symmetric multipliers of least squares: sum_l <X_l, V' M_j V> = slope_j.
        let columns: Vec<(usize, usize, usize)> = held
            .iter()
            .enumerate()
            .flat_map(|(l, (V, _))| (0..V.ncols()).flat_map(move |a| (0..=a).map(move |b| (l, a, b))))
            .collect();
        let twice = |a: usize, b: usize| if a == b { 1.0 } else { 2.0 };
        let system = Mat::from_fn(free.len(), columns.len(), |k, c| {
            let (l, a, b) = columns[c];
            twice(a, b) * held[l].1[k][(a, b)] / lengths[free[k]]
        });
        let Some(factors) = svd(system.as_ref()).filter(|_| !columns.is_empty()) else {
            return (wanted, Vec::new());
        };
        let least = factors.s.first().map_or(0.0, |largest| largest * 1e-10);
        let mut multipliers = vec![0.0; columns.len()];
        for i in (0..factors.s.len()).filter(|&i| factors.s[i] > least) {
            let along: f64 = factors.u.col_as_slice(i).iter().zip(&wanted).map(|(u, w)| u * w).sum();
            multipliers.iter_mut().zip(factors.v.col_as_slice(i)).for_each(|(x, v)| *x += along / factors.s[i] * v);
        }
        let size = norm(wanted.iter().copied());
        let (mut left, mut directions) = (wanted, Vec::new());
        for (l, (V, across)) in held.iter().enumerate() {
            let k = V.ncols();
            let entry = |a: usize, b: usize| {
                columns.iter().position(|column| *column == (l, a.max(b), a.min(b))).map_or(0.0, |c| multipliers[c])
            };
            let X = Mat::from_fn(k, k, entry);
            let Ok(eigen) = X.self_adjoint_eigen(Side::Lower) else { continue };
            // A bound pushes; it does not pull.
            let strength = |i: usize| eigen.S()[i].max(0.0);
            let kept = Mat::from_fn(k, k, |a, b| {
                (0..k).map(|i| eigen.U()[(a, i)] * strength(i) * eigen.U()[(b, i)]).sum::<f64>()
            });
            for (at, entry) in across.iter().enumerate() {
                left[at] -=
                    (0..k).flat_map(|a| (0..k).map(move |b| (a, b))).map(|ab| kept[ab] * entry[ab]).sum::<f64>()
                        / lengths[free[at]];
            }
            let pushing: Vec<usize> = (0..k)
                .filter(|&i| {
                    let along = |matrix: &Mat<f64>| -> f64 {
                        let u = eigen.U().col(i);
                        (0..k)
                            .flat_map(|a| (0..k).map(move |b| (a, b)))
                            .map(|(a, b)| u[a] * matrix[(a, b)] * u[b])
                            .sum()
                    };
                    let pushed = norm(across.iter().zip(free).map(|(a, &j)| strength(i) * along(a) / lengths[j]));
                    pushed > PUSHES * size
                })
                .collect();
            for (a, &i) in pushing.iter().enumerate() {
                for &h in &pushing[..=a] {
                    let of = |matrix: &Mat<f64>| {
                        let (u, w) = (eigen.U().col(i), eigen.U().col(h));
                        (0..k)
                            .flat_map(|a| (0..k).map(move |b| (a, b)))
                            .map(|(a, b)| u[a] * matrix[(a, b)] * w[b])
                            .sum()
                    };
                    directions.push(across.iter().map(of).collect());
                }
            }
        }
        (left, directions)
    }
}

/// The program of a step, in units of the region's scale: `1/2 y'H y + g'y` over the parameters that may move.
struct Program<'a> {
    limits: &'a Limits,
    theta: &'a [f64],
    scale: &'a [f64],
    free: Vec<usize>,
    H: Mat<f64>,
    g: Vec<f64>,
    /// Derivatives of each matrix by each free parameter, in its unit.
    slopes: Vec<Vec<Mat<f64>>>,
}

impl<'a> Program<'a> {
    fn new(limits: &'a Limits, at: &Evaluation, theta: &'a [f64], region: &Region<'a>, damping: f64) -> Self {
        let free: Vec<usize> = (0..theta.len()).filter(|&j| limits.bounds[j][0] < limits.bounds[j][1]).collect();
        let A = Mat::from_fn(at.rhs.len(), free.len(), |i, k| at.jacobian[(i, free[k])] / region.scale[free[k]]);
        let H = A.transpose() * &A;
        let H =
            Mat::from_fn(free.len(), free.len(), |a, b| H[(a.max(b), a.min(b))] + if a == b { damping } else { 0.0 });
        let g = (0..free.len()).map(|k| A.col_as_slice(k).iter().zip(&at.rhs).map(|(a, r)| a * r).sum()).collect();
        let unit = |&j: &usize, limit: &MatrixLimit| faer::Scale(1.0 / region.scale[j]) * limit.slope(j);
        let slopes = limits.limits.iter().map(|limit| free.iter().map(|j| unit(j, limit)).collect()).collect();
        Self { limits, theta, scale: region.scale, free, H, g, slopes }
    }

    fn moved(&self, y: &[f64]) -> Vec<f64> {
        let mut theta = self.theta.to_vec();
        self.free.iter().zip(y).for_each(|(&j, y)| theta[j] += y / self.scale[j]);
        theta
    }

    fn value(&self, y: &[f64]) -> f64 {
        let k = y.len();
        (0..k).map(|a| y[a] * (self.g[a] + 0.5 * (0..k).map(|b| self.H[(a, b)] * y[b]).sum::<f64>())).sum()
    }

    /// Strictly within everything.
    fn within(&self, y: &[f64]) -> bool {
        let theta = self.moved(y);
        let between = |&j: &usize| self.limits.bounds[j][0] < theta[j] && theta[j] < self.limits.bounds[j][1];
        self.free.iter().all(between)
            && self.limits.limits.iter().all(|limit| limit.room(&theta).llt(Side::Lower).is_ok())
    }

    /// Slope and curvature of the barrier; `None` outside.
    fn barrier(&self, y: &[f64]) -> Option<(Vec<f64>, Mat<f64>)> {
        let (theta, k) = (self.moved(y), y.len());
        let (mut slope, mut curvature) = (vec![0.0; k], Mat::<f64>::zeros(k, k));
        for (limit, slopes) in self.limits.limits.iter().zip(&self.slopes) {
            let lower = limit.room(&theta).llt(Side::Lower).ok()?.L().to_owned();
            let inverse = faer::linalg::solvers::Solve::solve(
                &lower.partial_piv_lu(),
                Mat::<f64>::identity(lower.nrows(), lower.nrows()),
            );
            let turned: Vec<Mat<f64>> = slopes.iter().map(|M| &inverse * M * inverse.transpose()).collect();
            for a in 0..k {
                slope[a] -= (0..lower.nrows()).map(|i| turned[a][(i, i)]).sum::<f64>();
                for b in 0..=a {
                    let product: f64 = (0..lower.nrows())
                        .flat_map(|i| (0..lower.nrows()).map(move |j| (i, j)))
                        .map(|at| turned[a][at] * turned[b][at])
                        .sum();
                    curvature[(a, b)] += product;
                    if a != b {
                        curvature[(b, a)] += product;
                    }
                }
            }
        }
        for (a, &j) in self.free.iter().enumerate() {
            let [low, high] = self.limits.bounds[j];
            for (distance, sign) in [(theta[j] - low, -1.0), (high - theta[j], 1.0)] {
                if distance.is_finite() {
                    let inverse = 1.0 / (distance * self.scale[j]);
                    slope[a] += sign * inverse;
                    curvature[(a, a)] += inverse * inverse;
                }
            }
        }
        Some((slope, curvature))
    }

    /// The step (p); where numbers fail the best so far.
    fn solve(&self, cost: f64, free_step: &Step) -> Vec<f64> {
        let k = self.free.len();
        let sides = self.free.iter().flat_map(|&j| self.limits.bounds[j]).filter(|bound| bound.is_finite()).count();
        let m = (self.limits.limits.iter().map(MatrixLimit::order).sum::<usize>() + sides) as f64;
        // From a tenth of the way back to where all is kept strictly.
        let back = |&j: &usize| 0.1 * (self.limits.inside[j] - self.theta[j]) * self.scale[j];
        let mut y: Vec<f64> = self.free.iter().map(back).collect();
        let best: Vec<f64> = self.free.iter().map(|&j| free_step.step[j] * self.scale[j]).collect();
        let range = (self.value(&y) - self.value(&best)).max(GAP * cost);
        let (mut tau, last, mut before) = (m / range, m / (GAP * cost), f64::INFINITY);
        for _ in 0..STEPS {
            let Some((slope, curvature)) = self.barrier(&y) else { break };
            let whole = Mat::from_fn(k, k, |a, b| tau * self.H[(a, b)] + curvature[(a, b)]);
            let down = Mat::from_fn(k, 1, |a, _| {
                -(tau * (self.g[a] + (0..k).map(|b| self.H[(a, b)] * y[b]).sum::<f64>()) + slope[a])
            });
            let Ok(factor) = whole.llt(Side::Lower) else { break };
            let direction = faer::linalg::solvers::Solve::solve(&factor, &down);
            let decrement = (0..k).map(|a| down[(a, 0)] * direction[(a, 0)]).sum::<f64>().max(0.0).sqrt();
            // At the last centre, until rounding stands in the way.
            if !decrement.is_finite()
                || (tau >= last && (decrement < 1e-7 || (before < 0.1 && decrement > 0.5 * before)))
            {
                break;
            }
            before = if tau >= last { decrement } else { f64::INFINITY };
            if decrement < 0.1 && tau < last {
                tau = (tau * GROWTH).min(last);
                continue;
            }
            let mut length = if decrement > 0.25 { 1.0 / (1.0 + decrement) } else { 1.0 };
            let next = (0..40).find_map(|_| {
                let next: Vec<f64> = (0..k).map(|a| y[a] + length * direction[(a, 0)]).collect();
                length *= 0.5;
                self.within(&next).then_some(next)
            });
            match next {
                Some(next) => y = next,
                None => break,
            }
        }
        let mut step = vec![0.0; self.theta.len()];
        self.free.iter().zip(&y).for_each(|(&j, y)| step[j] = y / self.scale[j]);
        step
    }
}

//! One region's coefficients in coordinates in which the price is a distance.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, MatRef, Side, linalg::solvers::Solve};
use fleetfoot_stats::{Contraction, SquareRoot, svd};

use super::{Loop, metric::Metric};
use crate::region_model::RegionModel;

/// Share of a region's mean curvature that pulls towards the free coefficients in directions that its rows do not
/// determine.
const UNTOLD: f64 = 1e-9;

/// Pull on the map from these to the other coefficients, in squares of a row at one standard deviation. With fewer rows
/// than that they stay: rows elsewhere would pay for it.
const FOLLOWED: f64 = 1.0;

/// Weights of the rows of a region in the search for the nearest coefficients.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct RegionWeight {
    /// Products of the constant's 1 and the functions of the library (p + 1 x p + 1), positive definite.
    pub products: Mat<f64>,
    /// Of every target, the weight of a square (q).
    pub targets: Vec<f64>,
}

impl RegionWeight {
    /// From both.
    pub fn new(products: Mat<f64>, targets: Vec<f64>) -> Self {
        Self { products, targets }
    }
}

/// A region. Let A (s x q) be the coefficients of the functions that read the loop's variables; all others follow. The
/// squared errors over their variance grow by `|Y - Y0|^2` with `Y = L' A diag(1 / sigma)`. L L' is the Gram matrix of
/// these functions without the part that the other functions explain.
pub(crate) struct Region {
    /// Y0 (s x q).
    pub(crate) free: Mat<f64>,
    /// `L^-1 reads` (s x n + m).
    right: Mat<f64>,
    /// `L'` (s x s).
    upper: Mat<f64>,
    /// Dependence of the other coefficients on these (others x s).
    follow: Mat<f64>,
    others: Vec<usize>,
    /// 1 / sigma of every target (q).
    scale: Vec<f64>,
}

impl Region {
    /// Of a region's free model and the rows that it was fitted on; `noise` are the variances of the targets' errors. `None` where a number is not finite.
    pub(crate) fn new(
        state_loop: &Loop,
        model: &RegionModel,
        root: &SquareRoot,
        (units, shrinkage): (&[f64], f64),
        noise: &[f64],
    ) -> Option<Self> {
        let p = root.regressors();
        // Rows of the pull towards the one-region model stand below those of the region.
        let pull = if shrinkage > 0.0 { p } else { 0 };
        let entry = |i: usize, j: usize| match i.checked_sub(p) {
            None => root.r[(i, j)],
            Some(row) => {
                if row == j {
                    shrinkage.sqrt() * units[j]
                } else {
                    0.0
                }
            }
        };
        let R = Mat::from_fn(p + pull, p, entry);
        let scale = noise.iter().map(|variance| 1.0 / variance.sqrt()).collect();
        Self::of(state_loop, &model.coefficients, R.as_ref(), (units, FOLLOWED), scale)
    }

    /// Of products of the functions, the constant first, that are positive definite, and weights of the targets: the
    /// metric of the nearest coefficients. With the means of the functions.
    pub(crate) fn weighted(
        state_loop: &Loop,
        coefficients: &Mat<f64>,
        weight: &RegionWeight,
    ) -> Option<(Self, Vec<f64>)> {
        let (G, p) = (&weight.products, coefficients.nrows());
        let mean: Vec<f64> = (0..p).map(|j| G[(j + 1, 0)] / G[(0, 0)]).collect();
        let S = Mat::from_fn(p, p, |i, j| G[(i + 1, j + 1)] - G[(i + 1, 0)] * mean[j]);
        let R = S.llt(Side::Lower).ok()?.L().transpose().to_owned();
        let units: Vec<f64> = (0..p).map(|j| (S[(j, j)] / G[(0, 0)]).sqrt()).collect();
        let scale = weight.targets.iter().map(|weight| weight.sqrt()).collect();
        Some((Self::of(state_loop, coefficients, R.as_ref(), (&units, 0.0), scale)?, mean))
    }

    /// Of rows R, in raw units and centred; `followed`: the pull on how other coefficients follow.
    fn of(
        state_loop: &Loop,
        coefficients: &Mat<f64>,
        R: MatRef<'_, f64>,
        (units, followed): (&[f64], f64),
        scale: Vec<f64>,
    ) -> Option<Self> {
        let (p, rows) = (R.ncols(), &state_loop.regressors);
        let others: Vec<usize> = (0..p).filter(|j| !rows.contains(j)).collect();
        // In units of the columns, so that rank is told.
        let columns = |of: &[usize]| Mat::from_fn(R.nrows(), of.len(), |i, k| R[(i, of[k])] / units[of[k]]);
        let (read, other) = (columns(rows), columns(&others));
        let follow = solved(other.as_ref(), read.as_ref(), followed)?;
        let left = &read - &other * &follow;
        let mut H = left.transpose() * &left;
        let s = rows.len();
        let mean = (0..s).map(|k| H[(k, k)]).sum::<f64>() / s as f64;
        (0..s).for_each(|k| H[(k, k)] += UNTOLD * mean.max(1.0));
        let L = H.llt(Side::Lower).ok()?.L().to_owned();
        // From the units of the columns back to raw ones.
        let upper = Mat::from_fn(s, s, |i, k| if k >= i { L[(k, i)] * units[rows[k]] } else { 0.0 });
        let follow = Mat::from_fn(others.len(), s, |i, k| follow[(i, k)] * units[rows[k]] / units[others[i]]);
        let reads = Mat::from_fn(s, state_loop.reads.ncols(), |k, v| state_loop.reads[(rows[k], v)]);
        let right = upper.transpose().partial_piv_lu().solve(&reads);
        let A = Mat::from_fn(s, scale.len(), |k, t| coefficients[(rows[k], t)]);
        let mut region = Self { free: Mat::zeros(0, 0), right, upper, follow, others, scale };
        region.free = region.inner(A.as_ref());
        Some(region)
    }

    /// Y of coefficients A (s x q).
    pub(crate) fn inner(&self, A: MatRef<'_, f64>) -> Mat<f64> {
        let Y = &self.upper * A;
        Mat::from_fn(Y.nrows(), Y.ncols(), |k, t| Y[(k, t)] * self.scale[t])
    }

    /// The map in a metric.
    pub(crate) fn contraction(&self, state_loop: &Loop, metric: &Metric) -> Contraction {
        let n = state_loop.variables.len();
        let entry = |i: usize, t: usize| {
            state_loop.targets[t].map_or(0.0, |(row, gain)| metric.root[(i, row)] * gain / self.scale[t])
        };
        let left = |i: usize, t: usize| if i < n { entry(i, t) } else { 0.0 };
        let offset = metric.seen(&state_loop.offset);
        Contraction {
            left: Mat::from_fn(offset.nrows(), state_loop.targets.len(), left),
            offset,
            right: metric.behind(&self.right),
            bound: if state_loop.ports.is_some() { 1.0 } else { state_loop.bound },
        }
    }

    /// Writes Y into a model of the region; functions that read no variable, and the constant, follow.
    pub(crate) fn write(&self, state_loop: &Loop, values: &Mat<f64>, model: &mut RegionModel, root: &SquareRoot) {
        self.moved(state_loop, values, &mut model.coefficients);
        for t in 0..values.ncols() {
            let explained = |(j, mean): (usize, &f64)| mean * model.coefficients[(j, t)];
            model.intercept[t] = root.mean_y[t] - root.mean_x.iter().enumerate().map(explained).sum::<f64>();
        }
    }

    /// Writes Y into the coefficients of the region (p x q); functions that read no variable follow. The change.
    pub(crate) fn moved(&self, state_loop: &Loop, values: &Mat<f64>, coefficients: &mut Mat<f64>) -> Mat<f64> {
        let (s, q) = (values.nrows(), values.ncols());
        let raw = Mat::from_fn(s, q, |k, t| values[(k, t)] / self.scale[t]);
        let A = self.upper.partial_piv_lu().solve(&raw);
        let before = coefficients.clone();
        let change = Mat::from_fn(s, q, |k, t| A[(k, t)] - before[(state_loop.regressors[k], t)]);
        let followed = &self.follow * &change;
        for t in 0..q {
            state_loop.regressors.iter().enumerate().for_each(|(k, &j)| coefficients[(j, t)] = A[(k, t)]);
            self.others.iter().enumerate().for_each(|(k, &j)| coefficients[(j, t)] -= followed[(k, t)]);
        }
        &*coefficients - before
    }
}

/// `X` for which `|A X - B|^2 + pull |X|^2` is least.
fn solved(A: MatRef<'_, f64>, B: MatRef<'_, f64>, pull: f64) -> Option<Mat<f64>> {
    let svd = svd(A)?;
    let along = svd.u.transpose() * B;
    let scaled = Mat::from_fn(svd.s.len(), B.ncols(), |k, j| along[(k, j)] * svd.s[k] / (svd.s[k].powi(2) + pull));
    Some(svd.v.subcols(0, svd.s.len()) * &scaled)
}

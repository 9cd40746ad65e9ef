//! Points as a chain of differences, and least squares on it.
//!
//! | symbol | here |
//! |---|---|
//! | k, M = k + 1 | degree, states |
//! | s_i = (x_i, b1_i, ..., bk_i) | value and backward derivatives: `bj_i = j (b(j-1)_i - b(j-1)_(i-1)) / (t_i - t_(i-j))` |
//! | z_j = (D x)_j | step of the k-th derivative between the points j + k and j + k + 1 |
//!
//! A Newton step of the interior point is a weighted least-squares problem in x,
//!
//! ```text
//! sum_i w_i (x_i - d_i)^2  +  sum_j ((D x)_j - rho_j)^2 / theta_j
//! ```
//!
//! which is the smoothing of a chain of M states whose last one is pushed by rho_j and noise of variance theta_j. Its filter goes forward on triangles of covariances, as that of the
//! smoothing spline, and the adjoint of the smoother goes back (Bierman, "Fixed interval smoothing with discrete measurements", International Journal of Control 18, 1973): it
//! never divides by theta, which is nearly nothing inside of pieces, and hands out the multipliers of D x = z by the way. The matrix D W^-1 D' of the textbook's dual is never formed: its
//! condition grows as the 2 (k + 1)-th power of the length of a piece, that of the chain as the root of it.

use crate::{
    outliers::median,
    spline::{
        chain::Matrix,
        filter::{Belief, Innovation},
    },
};

/// Points that are measured, in units in which they are near one.
pub(super) struct Points {
    pub(super) times: Vec<f64>,
    pub(super) values: Vec<f64>,
    /// 1 / w.
    pub(super) variances: Vec<f64>,
}

/// Gain of the forward filter for the backward pass, independent of the data.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gain<const M: usize> {
    /// Change of the state for an innovation of one.
    gain: [f64; M],
    /// The variance of the innovation.
    variance: f64,
}

/// The least-squares problem solved.
pub(super) struct Least {
    pub(super) x: Vec<f64>,
    /// The multipliers: `(D x)_j = rho_j + theta_j u_j`, and `w (x - d) + D' u = 0`.
    pub(super) u: Vec<f64>,
}

impl Points {
    /// Steps of the k-th derivative.
    pub(super) fn steps<const M: usize>(&self) -> usize {
        self.times.len() - M
    }

    /// (t_i - t_(i-j)) / j for j = 1..k; the first entry is not used.
    #[inline]
    fn reach<const M: usize>(&self, i: usize) -> [f64; M] {
        let mut reach = [0.0; M];
        for j in 1..M {
            reach[j] = (self.times[i] - self.times[i - j]) / j as f64;
        }
        reach
    }

    /// Weighted sum of squares of what is left of the values.
    pub(super) fn squares(&self, x: &[f64]) -> f64 {
        let rows = self.values.iter().zip(x).zip(&self.variances);
        rows.map(|((y, x), variance)| (y - x) * (y - x) / variance).sum()
    }

    /// The deviation of the values' noise by differences of neighbours, in units of weight one.
    pub(super) fn noise(&self) -> f64 {
        let mut steps: Vec<f64> = self.values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
        median(&mut steps).unwrap_or(0.0)
    }

    /// D y of values at the points.
    pub(super) fn differences<const M: usize>(&self, values: &[f64]) -> Vec<f64> {
        let mut left = values.to_vec();
        for j in 1..M {
            for i in (j..left.len()).rev() {
                left[i] = j as f64 * (left[i] - left[i - 1]) / (self.times[i] - self.times[i - j]);
            }
        }
        (M..left.len()).map(|i| left[i] - left[i - 1]).collect()
    }

    /// The rows of the map from the first M values to the M-th point's state: s = B x.
    fn start<const M: usize>(&self) -> Matrix<M> {
        let mut rows: Matrix<M> = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
        // Row i is the newest derivative of the point i; older points first become differences.
        let mut map = [[0.0; M]; M];
        map[0] = rows[M - 1];
        for j in 1..M {
            for i in (j..M).rev() {
                let scale = j as f64 / (self.times[i] - self.times[i - j]);
                for c in 0..M {
                    rows[i][c] = scale * (rows[i][c] - rows[i - 1][c]);
                }
            }
            map[j] = rows[M - 1];
        }
        map
    }

    /// The filter's way forward under the variances of the steps.
    pub(super) fn gains<const M: usize>(&self, theta: &[f64]) -> Vec<Gain<M>> {
        let start = self.start::<M>();
        let root = start.map(|row| std::array::from_fn(|c| row[c] * self.variances[c].sqrt()));
        let mut belief = Belief::<M>::new([0.0; M], root);
        let gain = |(j, theta): (usize, &f64)| {
            let reach = self.reach::<M>(j + M);
            let (variances, mut moved) = belief.parted();
            // The noise comes in at the last state and goes on to all.
            let mut noise = [0.0; M];
            noise[M - 1] = 1.0;
            for l in (1..M).rev() {
                for c in 0..M {
                    moved[l - 1][c] += reach[l] * moved[l][c];
                }
                noise[l - 1] += reach[l] * noise[l];
            }
            let column = noise.map(|entry| std::array::from_fn(|c| if c == 0 { entry } else { 0.0 }));
            belief = Belief::stepped([0.0; M], &moved, &variances, &column, *theta);
            let first = belief.factor[0][0];
            let states = belief.parted().1.map(|row| row[0]);
            let Innovation { variance, weight, .. } = belief.measure(0.0, self.variances[j + M]);
            Gain { gain: states.map(|state| state * first * weight), variance }
        };
        theta.iter().enumerate().map(gain).collect()
    }

    /// The least-squares problem of data d (all zero where not given) and pushes rho.
    pub(super) fn least<const M: usize>(&self, gains: &[Gain<M>], data: Option<&[f64]>, rho: &[f64]) -> Least {
        let n = self.times.len();
        let start = self.start::<M>();
        let datum = |i: usize| data.map_or(0.0, |data| data[i]);
        let mut mean: [f64; M] = std::array::from_fn(|i| (0..M).map(|c| start[i][c] * datum(c)).sum());
        // Innovations over their variances: the multipliers' room until the way back.
        let mut u = vec![0.0; gains.len()];
        for (j, gain) in gains.iter().enumerate() {
            let reach = self.reach::<M>(j + M);
            mean[M - 1] += rho[j];
            for l in (1..M).rev() {
                mean[l - 1] += reach[l] * mean[l];
            }
            let error = datum(j + M) - mean[0];
            u[j] = error / gain.variance;
            for l in 0..M {
                mean[l] += gain.gain[l] * error;
            }
        }
        let mut x = vec![0.0; n];
        let mut adjoint = [0.0; M];
        for (j, gain) in gains.iter().enumerate().rev() {
            let i = j + M;
            let pull = u[j] + (0..M).map(|l| gain.gain[l] * adjoint[l]).sum::<f64>();
            x[i] = datum(i) - self.variances[i] * pull;
            adjoint[0] -= pull;
            let reach = self.reach::<M>(i);
            for l in 1..M {
                adjoint[l] += reach[l] * adjoint[l - 1];
            }
            u[j] = -adjoint[M - 1];
        }
        for (c, x) in x.iter_mut().take(M).enumerate() {
            let pull: f64 = (0..M).map(|l| start[l][c] * adjoint[l]).sum();
            *x = datum(c) - self.variances[c] * pull;
        }
        Least { x, u }
    }

    /// The least penalty under which nothing but a polynomial of degree k is left: the greatest multiplier of D x = 0.
    pub(super) fn greatest_penalty<const M: usize>(&self) -> f64 {
        let zero = vec![0.0; self.steps::<M>()];
        let least = self.least(&self.gains::<M>(&zero), Some(&self.values), &zero);
        least.u.iter().fold(f64::EPSILON, |most, u| most.max(u.abs()))
    }
}

//! The normal distribution of a search, and its adaptation. Symbols are those of Hansen's tutorial.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_stats::kernel::norm;

use super::Draws;

/// A normal distribution of mean m and covariance sigma^2 C (n x n).
pub(super) struct Distribution {
    mean: Vec<f64>,
    sigma: f64,
    C: Mat<f64>,
    /// Principal axes of C, and the standard deviations along them.
    axes: (Mat<f64>, Vec<f64>),
    /// Paths of the mean: for the covariance, and for sigma.
    path: Vec<f64>,
    path_sigma: Vec<f64>,
    /// Weights of the better half, best first.
    weights: Vec<f64>,
    rates: Rates,
    generations: i32,
}

/// Constants of the adaptation, from the number of parameters and the weights (tutorial, table 1).
struct Rates {
    /// Effective number of selected points.
    selected: f64,
    path: f64,
    path_sigma: f64,
    damping: f64,
    rank_one: f64,
    rank_selected: f64,
    /// Expected length of a standard normal vector.
    length: f64,
}

impl Distribution {
    pub(super) fn new(mean: Vec<f64>, sigma: f64, points: usize) -> Self {
        let n = mean.len();
        let half = (points / 2) as f64;
        let raw: Vec<f64> = (1..=points / 2).map(|rank| (half + 0.5).ln() - (rank as f64).ln()).collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|weight| weight / sum).collect();
        let rates = Rates::new(n as f64, 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>());
        Self {
            mean,
            sigma,
            C: Mat::identity(n, n),
            axes: (Mat::identity(n, n), vec![1.0; n]),
            path: vec![0.0; n],
            path_sigma: vec![0.0; n],
            weights,
            rates,
            generations: 0,
        }
    }

    /// A random point.
    pub(super) fn draw(&self, draws: &mut Draws) -> Vec<f64> {
        let (B, deviations) = &self.axes;
        let along: Vec<f64> = deviations.iter().map(|deviation| deviation * draws.normal()).collect();
        let coordinate = |i: usize| along.iter().enumerate().map(|(j, value)| B[(i, j)] * value).sum::<f64>();
        self.mean.iter().enumerate().map(|(i, mean)| mean + self.sigma * coordinate(i)).collect()
    }

    /// True if no coordinate has a larger standard deviation, or if the covariance is degenerate.
    pub(super) fn has_converged(&self, deviation: f64) -> bool {
        let (_, deviations) = &self.axes;
        let [least, most] = deviations.iter().fold([f64::INFINITY, 0.0], |[a, b], &d| [a.min(d), f64::max(b, d)]);
        !(self.sigma * most > deviation && least > 1e-7 * most && self.sigma * most < 1e7)
    }

    /// Moves mean and covariance towards the points of least cost.
    pub(super) fn adapt(&mut self, points: &[Vec<f64>], costs: &[f64]) {
        let n = self.mean.len();
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        let steps: Vec<Vec<f64>> = (order.iter().take(self.weights.len()))
            .map(|&at| points[at].iter().zip(&self.mean).map(|(x, m)| (x - m) / self.sigma).collect())
            .collect();
        let mean_step: Vec<f64> =
            (0..n).map(|i| self.weights.iter().zip(&steps).map(|(weight, step)| weight * step[i]).sum()).collect();
        self.mean.iter_mut().zip(&mean_step).for_each(|(mean, step)| *mean += self.sigma * step);
        self.generations += 1;
        let Rates { selected, path, path_sigma, damping, rank_one, rank_selected, length } = self.rates;
        let white = self.whitened(&mean_step);
        let keep = (path_sigma * (2.0 - path_sigma) * selected).sqrt();
        self.path_sigma.iter_mut().zip(&white).for_each(|(p, w)| *p = (1.0 - path_sigma) * *p + keep * w);
        let travelled = norm(self.path_sigma.iter().copied());
        self.sigma *= ((path_sigma / damping) * (travelled / length - 1.0)).exp();
        // A path that grows too fast is not added to the covariance.
        let settled = (1.0 - (1.0 - path_sigma).powi(2 * self.generations)).sqrt();
        let is_slow = f64::from(u8::from(travelled / settled < (1.4 + 2.0 / (n as f64 + 1.0)) * length));
        let add = is_slow * (path * (2.0 - path) * selected).sqrt();
        self.path.iter_mut().zip(&mean_step).for_each(|(p, step)| *p = (1.0 - path) * *p + add * step);
        let lost = rank_one * (1.0 - is_slow) * path * (2.0 - path);
        for i in 0..n {
            for j in 0..n {
                let spread: f64 =
                    self.weights.iter().zip(&steps).map(|(weight, step)| weight * step[i] * step[j]).sum();
                self.C[(i, j)] = (1.0 - rank_one - rank_selected + lost) * self.C[(i, j)]
                    + rank_one * self.path[i] * self.path[j]
                    + rank_selected * spread;
            }
        }
        if let Ok(eigen) = self.C.self_adjoint_eigen(Side::Lower) {
            let deviations = (0..n).map(|j| eigen.S().column_vector()[j].max(0.0).sqrt()).collect();
            self.axes = (eigen.U().to_owned(), deviations);
        }
    }

    /// `C^(-1/2) step`.
    fn whitened(&self, step: &[f64]) -> Vec<f64> {
        let (B, deviations) = &self.axes;
        let n = step.len();
        let along: Vec<f64> =
            (0..n).map(|j| (0..n).map(|i| B[(i, j)] * step[i]).sum::<f64>() / deviations[j]).collect();
        (0..n).map(|i| (0..n).map(|j| B[(i, j)] * along[j]).sum()).collect()
    }
}

impl Rates {
    fn new(n: f64, selected: f64) -> Self {
        let path_sigma = (selected + 2.0) / (n + selected + 5.0);
        let rank_one = 2.0 / ((n + 1.3).powi(2) + selected);
        let rank_selected = 2.0 * (0.25 + selected + 1.0 / selected - 2.0) / ((n + 2.0).powi(2) + selected);
        Self {
            selected,
            path: (4.0 + selected / n) / (n + 4.0 + 2.0 * selected / n),
            path_sigma,
            damping: 1.0 + 2.0 * (((selected - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + path_sigma,
            rank_one,
            rank_selected: rank_selected.min(1.0 - rank_one),
            length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }
}

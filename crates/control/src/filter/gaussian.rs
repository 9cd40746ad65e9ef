//! Normal distributions of states: prediction, measurement, mixture.

use fleetfoot_stats::Autoregression;

use super::steps::StepMap;
use fleetfoot_dynamics::geometry::Geometry;

/// Points that the covariance of the whole counts as, where that of a part is found by few.
const BLENDED: f64 = 2.0;

/// A normal distribution of n states.
#[derive(Debug, Clone, PartialEq)]
pub struct Gaussian {
    /// n numbers.
    pub mean: Vec<f64>,
    /// n x n by rows, symmetric to the bit.
    pub covariance: Vec<f64>,
}

impl Gaussian {
    /// Independent states.
    pub(super) fn independent(mean: Vec<f64>, deviations: &[f64]) -> Self {
        let n = mean.len();
        let mut covariance = vec![0.0; n * n];
        deviations.iter().enumerate().for_each(|(i, deviation)| covariance[i * n + i] = deviation * deviation);
        Self { mean, covariance }
    }

    /// Appends, independent of these, the residuals of the rows before, with their stationary distribution.
    pub(super) fn with_residuals(self, colour: &Autoregression) -> Self {
        let (n, behind) = (self.mean.len(), colour.targets() * colour.order());
        let entry = |i: usize, j: usize| match (i < n, j < n) {
            (true, true) => self.covariance[i * n + j],
            (false, false) => colour.stationary[(i - n) * behind + j - n],
            _ => 0.0,
        };
        let all = n + behind;
        let covariance = (0..all * all).map(|at| entry(at / all, at % all)).collect();
        Self { mean: self.mean.iter().copied().chain(std::iter::repeat_n(0.0, behind)).collect(), covariance }
    }

    /// True if mean and covariance are finite.
    pub(super) fn is_finite(&self) -> bool {
        self.mean.iter().chain(&self.covariance).all(|value| value.is_finite())
    }

    /// The first n alone.
    pub(super) fn leading(self, n: usize) -> Self {
        let all = self.mean.len();
        if all == n {
            return self;
        }
        let covariance = self.covariance.chunks_exact(all).take(n).flat_map(|row| row[..n].to_vec()).collect();
        Self { mean: self.mean[..n].to_vec(), covariance }
    }

    /// One step on: `A m + B u + c`, `A P A' + f Q`.
    pub(super) fn predicted(&self, step: &StepMap, inputs: &[f64], factor: f64, geometry: &Geometry) -> Self {
        let (n, m) = (self.mean.len(), inputs.len());
        let row = |i: usize| {
            let mut value = step.c[i];
            for (j, x) in self.mean.iter().enumerate() {
                value += step.a[i * n + j] * x;
            }
            for (j, u) in inputs.iter().enumerate() {
                value += step.b[i * m + j] * u;
            }
            geometry.wrapped(i, value)
        };
        let mut mean: Vec<f64> = (0..n).map(row).collect();
        let mut half = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                for k in 0..n {
                    half[i * n + j] += step.a[i * n + k] * self.covariance[k * n + j];
                }
            }
        }
        let mut covariance = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let mut value = factor * step.q[i * n + j];
                for k in 0..n {
                    value += half[i * n + k] * step.a[j * n + k];
                }
                covariance[i * n + j] = value;
                covariance[j * n + i] = value;
            }
        }
        geometry.retract_distribution(&mut mean, &mut covariance);
        Self { mean, covariance }
    }

    /// Takes in the measurement of one state with a variance; returns the innovation and its variance. The covariance
    /// is that of Joseph's form, a sum of two positive semidefinite terms (Bucy and Joseph, *Filtering for Stochastic
    /// Processes with Applications to Guidance*, 1968).
    pub(super) fn observe(&mut self, state: usize, value: f64, variance: f64, geometry: &Geometry) -> [f64; 2] {
        let n = self.mean.len();
        let innovation = geometry.wrapped(state, value - self.mean[state]);
        let spread = self.covariance[state * n + state] + variance;
        let gain: Vec<f64> = (0..n).map(|i| self.covariance[i * n + state] / spread).collect();
        for i in 0..n {
            self.mean[i] += gain[i] * innovation;
            self.mean[i] = geometry.wrapped(i, self.mean[i]);
        }
        // (I - K h') P, then its product with (I - K h')', and the measurement's own share.
        let half: Vec<f64> =
            (0..n * n).map(|at| self.covariance[at] - gain[at / n] * self.covariance[state * n + at % n]).collect();
        for i in 0..n {
            for j in 0..=i {
                let value = half[i * n + j] - half[i * n + state] * gain[j] + gain[i] * variance * gain[j];
                self.covariance[i * n + j] = value;
                self.covariance[j * n + i] = value;
            }
        }
        [innovation, spread]
    }

    /// The normal distribution with the mean and the covariance of a mixture; weights sum to one. Of angles, differences from the first part's are averaged.
    pub(super) fn mixture(parts: &[(f64, &Gaussian)], geometry: &Geometry) -> Self {
        let Some(((_, first), rest)) = parts.split_first() else { return Self { mean: vec![], covariance: vec![] } };
        if rest.is_empty() {
            return (*first).clone();
        }
        let n = first.mean.len();
        let mut mean = first.mean.clone();
        for i in 0..n {
            for (weight, part) in rest {
                mean[i] += weight * geometry.difference(i, |s| part.mean[s], |s| first.mean[s]);
            }
            mean[i] = geometry.wrapped(i, mean[i]);
        }
        geometry.retract(&mut mean, |s| s);
        let mut covariance = vec![0.0; n * n];
        for (weight, part) in parts {
            let off: Vec<f64> = (0..n).map(|i| geometry.difference(i, |s| part.mean[s], |s| mean[s])).collect();
            for i in 0..n {
                for j in 0..=i {
                    covariance[i * n + j] += weight * (part.covariance[i * n + j] + off[i] * off[j]);
                }
            }
        }
        for i in 0..n {
            for j in 0..i {
                covariance[j * n + i] = covariance[i * n + j];
            }
        }
        Self { mean, covariance }
    }

    /// The distribution of a part of this one: of `count` of the points that stand for its first n numbers, at these
    /// offsets from their mean. The numbers behind them follow from them by regression.
    pub(super) fn around<'a>(
        &self,
        n: usize,
        count: usize,
        offsets: impl Iterator<Item = &'a [f64]> + Clone,
        geometry: &Geometry,
    ) -> Self {
        let all = self.mean.len();
        let mut centre = vec![0.0; n];
        for offset in offsets.clone() {
            centre.iter_mut().zip(offset).for_each(|(sum, value)| *sum += value);
        }
        centre.iter_mut().for_each(|sum| *sum /= count as f64);
        let mut covariance: Vec<f64> = (0..n * n).map(|at| BLENDED * self.covariance[at / n * all + at % n]).collect();
        for offset in offsets {
            for i in 0..n {
                for j in 0..=i {
                    covariance[i * n + j] += (offset[i] - centre[i]) * (offset[j] - centre[j]);
                }
            }
        }
        for i in 0..n {
            for j in 0..=i {
                covariance[i * n + j] /= count as f64 + BLENDED;
                covariance[j * n + i] = covariance[i * n + j];
            }
        }
        let mean = |s: usize| {
            let value = self.mean[s] + centre[s];
            geometry.wrapped(s, value)
        };
        let mut mean: Vec<f64> = (0..n).map(mean).collect();
        if all > n {
            (mean, covariance) = self.followed(mean, &centre, &covariance);
        }
        geometry.retract_distribution(&mut mean, &mut covariance);
        Self { mean, covariance }
    }

    /// Mean and covariance of all numbers after a change of the first n: `centre` off and of this covariance. With W
    /// the regression of the others on those, they are `h + W centre` and `P + W D W'`, D the change of the first n's
    /// covariance.
    fn followed(&self, mean: Vec<f64>, centre: &[f64], first: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (n, all) = (mean.len(), self.mean.len());
        let (lower, behind) = (self.factor(n), all - n);
        let mut gain = vec![0.0; behind * n];
        for (h, row) in gain.chunks_exact_mut(n).enumerate() {
            for i in 0..n {
                let mut value = self.covariance[(n + h) * all + i];
                for k in 0..i {
                    value -= lower[i * n + k] * row[k];
                }
                row[i] = if lower[i * n + i] > 0.0 { value / lower[i * n + i] } else { 0.0 };
            }
            for i in (0..n).rev() {
                let mut value = row[i];
                for k in i + 1..n {
                    value -= lower[k * n + i] * row[k];
                }
                row[i] = if lower[i * n + i] > 0.0 { value / lower[i * n + i] } else { 0.0 };
            }
        }
        let mut moved = mean;
        let mut covariance = vec![0.0; all * all];
        for i in 0..n {
            (0..n).for_each(|j| covariance[i * all + j] = first[i * n + j]);
        }
        let mut changed = vec![0.0; n];
        for h in 0..behind {
            let row = &gain[h * n..][..n];
            let mut value = self.mean[n + h];
            for k in 0..n {
                value += row[k] * centre[k];
            }
            moved.push(value);
            for j in 0..n {
                let (mut both, mut change) = (0.0, 0.0);
                for k in 0..n {
                    both += row[k] * first[k * n + j];
                    change += row[k] * (first[k * n + j] - self.covariance[k * all + j]);
                }
                covariance[(n + h) * all + j] = both;
                covariance[j * all + n + h] = both;
                changed[j] = change;
            }
            for other in 0..=h {
                let mut value = self.covariance[(n + h) * all + n + other];
                for j in 0..n {
                    value += changed[j] * gain[other * n + j];
                }
                covariance[(n + h) * all + n + other] = value;
                covariance[(n + other) * all + n + h] = value;
            }
        }
        (moved, covariance)
    }

    /// The lower Cholesky factor of the first n numbers' covariance, by rows; a direction without spread has a column of zeros.
    pub(super) fn factor(&self, n: usize) -> Vec<f64> {
        let all = self.mean.len();
        let mut lower = vec![0.0; n * n];
        for j in 0..n {
            for i in j..n {
                let mut value = self.covariance[i * all + j];
                for k in 0..j {
                    value -= lower[i * n + k] * lower[j * n + k];
                }
                if i == j {
                    lower[j * n + j] = if value > 0.0 { value.sqrt() } else { 0.0 };
                } else if lower[j * n + j] > 0.0 {
                    lower[i * n + j] = value / lower[j * n + j];
                }
            }
        }
        lower
    }

    /// The squared Mahalanobis distance `e'P^-1 e` of some states' errors; NaN where they have no spread.
    pub fn square(&self, states: &[usize], errors: &[f64]) -> f64 {
        let (n, d) = (self.mean.len(), states.len());
        let part = Self {
            mean: vec![0.0; d],
            covariance: (0..d * d).map(|at| self.covariance[states[at / d] * n + states[at % d]]).collect(),
        };
        let lower = part.factor(d);
        let mut whitened = vec![0.0; d];
        for i in 0..d {
            let mut value = errors[i];
            for k in 0..i {
                value -= lower[i * d + k] * whitened[k];
            }
            whitened[i] = value / lower[i * d + i];
        }
        let square: f64 = whitened.iter().map(|value| value * value).sum();
        if square.is_finite() { square } else { f64::NAN }
    }
}

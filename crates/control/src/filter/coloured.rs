//! A step whose noise is correlated with that of the steps before.

use fleetfoot_stats::Autoregression;

use super::{Gaussian, StepMap};
use fleetfoot_dynamics::geometry::Geometry;

impl Gaussian {
    /// One step of n states and, behind them, of the whitened residuals of the last p rows, the newest first.
    /// `rho+ = Phi h + e`, then `x+ = A x + B u + c + sqrt(f) S rho+ + w`, w of covariance `f Q`.
    pub(super) fn coloured(
        &self,
        step: &StepMap,
        inputs: &[f64],
        factor: f64,
        colour: &Autoregression,
        geometry: &Geometry,
    ) -> Self {
        let (n, m, q) = (step.c.len(), inputs.len(), colour.targets());
        let all = self.mean.len();
        let s: Vec<f64> = step.s.iter().map(|coefficient| factor.sqrt() * coefficient).collect();
        let Self { mut mean, covariance: known } = self.residuals_on(colour);
        for i in 0..n {
            let mut value = step.c[i];
            for j in 0..n {
                value += step.a[i * n + j] * self.mean[j];
            }
            for (j, u) in inputs.iter().enumerate() {
                value += step.b[i * m + j] * u;
            }
            for t in 0..q {
                value += s[i * q + t] * mean[n + t];
            }
            mean[i] = geometry.wrapped(i, value);
        }
        let mut half = vec![0.0; n * all];
        for (i, row) in half.chunks_exact_mut(all).enumerate() {
            for k in 0..n {
                add_scaled(row, &known[k * all..][..all], step.a[i * n + k]);
            }
            for t in 0..q {
                add_scaled(row, &known[(n + t) * all..][..all], s[i * q + t]);
            }
        }
        let mut covariance = known;
        for i in 0..n {
            for j in 0..=i {
                let mut value = factor * step.q[i * n + j];
                for k in 0..n {
                    value += half[i * all + k] * step.a[j * n + k];
                }
                for t in 0..q {
                    value += half[i * all + n + t] * s[j * q + t];
                }
                covariance[i * all + j] = value;
                covariance[j * all + i] = value;
            }
            for j in n..all {
                covariance[i * all + j] = half[i * all + j];
                covariance[j * all + i] = half[i * all + j];
            }
        }
        geometry.retract_distribution(&mut mean, &mut covariance);
        Self { mean, covariance }
    }

    /// The residuals one row on, the states as they are.
    fn residuals_on(&self, colour: &Autoregression) -> Self {
        let (all, q) = (self.mean.len(), colour.targets());
        let behind = q * colour.order();
        let n = all - behind;
        let (phi, known) = (&colour.coefficients, &self.covariance);
        let mut mean = self.mean.clone();
        mean[n + q..].copy_from_slice(&self.mean[n..all - q]);
        let mut half = known.clone();
        half[(n + q) * all..].copy_from_slice(&known[n * all..(all - q) * all]);
        for i in 0..q {
            let mut value = 0.0;
            let row = &mut half[(n + i) * all..][..all];
            row.fill(0.0);
            for k in 0..behind {
                value += phi[i * behind + k] * self.mean[n + k];
                add_scaled(row, &known[(n + k) * all..][..all], phi[i * behind + k]);
            }
            mean[n + i] = value;
        }
        let mut covariance = known.clone();
        for i in n..all {
            for j in 0..=i {
                let value = if j < n {
                    half[i * all + j]
                } else if j < n + q {
                    let mut value = if i < n + q { colour.innovation[(i - n) * q + j - n] } else { 0.0 };
                    for k in 0..behind {
                        value += half[i * all + n + k] * phi[(j - n) * behind + k];
                    }
                    value
                } else {
                    half[i * all + j - q]
                };
                covariance[i * all + j] = value;
                covariance[j * all + i] = value;
            }
        }
        Self { mean, covariance }
    }
}

fn add_scaled(sums: &mut [f64], values: &[f64], factor: f64) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

//! Gaussian noise with an exponential autocorrelation.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::ParameterError;
use crate::parameter_error::{finite, not_negative, positive};

/// The Ornstein-Uhlenbeck process about a mean: Gaussian, with autocorrelation `exp(-|lag| / correlation)`, white below and
/// 1/f^2 above `1 / (2 pi correlation)` Hz.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OrnsteinUhlenbeckNoise {
    /// Mean, in the channel's unit.
    pub offset: f64,
    /// Standard deviation, in the channel's unit.
    pub deviation: f64,
    /// Correlation time, s.
    pub correlation: f64,
}

impl Default for OrnsteinUhlenbeckNoise {
    fn default() -> Self {
        Self { offset: 0.0, deviation: 0.4, correlation: 1.0 }
    }
}

impl OrnsteinUhlenbeckNoise {
    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        finite("offset", self.offset)?;
        not_negative("deviation", self.deviation)?;
        positive("correlation", self.correlation)
    }
}

/// The Ornstein-Uhlenbeck process, sampled exactly: Gaussian, mean 0, with the given standard deviation and correlation time.
#[derive(Debug, Clone)]
pub struct OrnsteinUhlenbeck {
    value: f64,
    decay: f64,
    kick: f64,
}

impl OrnsteinUhlenbeck {
    /// Starts in the stationary distribution. `deviation` in the signal's unit, `correlation` and `dt` in seconds.
    pub fn new(deviation: f64, correlation: f64, dt: f64, random: &mut impl Rng) -> Self {
        let decay = (-dt / correlation).exp();
        let start: f64 = StandardNormal.sample(random);
        Self { value: deviation * start, decay, kick: deviation * (1.0 - decay * decay).sqrt() }
    }

    /// The value one sample later.
    pub fn next(&mut self, random: &mut impl Rng) -> f64 {
        let normal: f64 = StandardNormal.sample(random);
        self.value = self.decay * self.value + self.kick * normal;
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    #[test]
    fn variance_and_autocorrelation_match_process() {
        let mut random = Pcg64::seed_from_u64(11);
        let mut process = OrnsteinUhlenbeck::new(0.5, 0.2, 0.05, &mut random);
        let samples: Vec<f64> = (0..400_000).map(|_| process.next(&mut random)).collect();
        let covariance = |lag: usize| -> f64 {
            samples.iter().zip(&samples[lag..]).map(|(a, b)| a * b).sum::<f64>() / (samples.len() - lag) as f64
        };
        // 20,000 s hold 50,000 independent samples: the relative deviation of a variance is sqrt(2 / 50,000) = 0.6 %.
        for lag in [0, 1, 4, 8] {
            let expected = 0.25 * (-(lag as f64) * 0.05 / 0.2).exp();
            assert!((covariance(lag) - expected).abs() < 0.25 * 0.03, "{lag}: {} {expected}", covariance(lag));
        }
    }
}

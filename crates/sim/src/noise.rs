//! Random signals.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

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

//! Random walks.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::check::interval;
use super::uniform;
use crate::ParameterError;
use crate::parameter_error::not_negative;

/// A Gaussian random walk between two reflecting levels: its values are uniform between them in the long run, and it starts
/// anywhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RandomWalk {
    /// In the channel's unit.
    pub low: f64,
    /// In the channel's unit.
    pub high: f64,
    /// Standard deviation after one second, in the channel's unit; it grows with the square root of time.
    pub rate: f64,
}

impl Default for RandomWalk {
    fn default() -> Self {
        Self { low: -1.0, high: 1.0, rate: 0.5 }
    }
}

impl RandomWalk {
    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        interval(self.low, self.high)?;
        not_negative("rate", self.rate)
    }
}

#[derive(Debug, Clone)]
pub(super) struct RandomWalkSignal {
    low: f64,
    width: f64,
    step: f64,
    value: f64,
}

impl RandomWalkSignal {
    pub(super) fn new(parameters: &RandomWalk, dt: f64, random: &mut Pcg64) -> Self {
        let RandomWalk { low, high, rate } = *parameters;
        Self { low, width: high - low, step: rate * dt.sqrt(), value: uniform(low, high, random) }
    }

    pub(super) fn next(&mut self, random: &mut Pcg64) -> f64 {
        let normal: f64 = StandardNormal.sample(random);
        // However far the step, its mirror images lie on a triangle wave of period 2 widths.
        let unfolded = (self.value + self.step * normal - self.low).rem_euclid(2.0 * self.width);
        self.value = self.low + unfolded.min(2.0 * self.width - unfolded);
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::{Axis, Histogram};
    use rand::SeedableRng;

    #[test]
    fn random_walk_visits_all_levels() {
        let mut random = Pcg64::seed_from_u64(2);
        let parameters = RandomWalk { low: -0.2, high: 0.6, rate: 0.5 };
        let mut signal = RandomWalkSignal::new(&parameters, 0.01, &mut random);
        let mut visits = Histogram::new([Axis { low: -0.2, high: 0.6, bins: 8 }]);
        let (mut squares, mut before) = (0.0, signal.next(&mut random));
        for _ in 0..1_000_000 {
            let value = signal.next(&mut random);
            squares += (value - before).powi(2);
            before = value;
            visits.add(&[value]);
        }
        assert_eq!(visits.outside(), 0);
        assert!(visits.nonuniformity() < 1e-3, "{}", visits.nonuniformity());
        // Steps of 0.05; those that reflect, some 10 %, are shorter.
        let step = (squares / 1e6).sqrt();
        assert!((0.046..0.0501).contains(&step), "{step}");
    }

    #[test]
    fn a_step_of_many_widths_is_reflected_as_often() {
        let mut random = Pcg64::seed_from_u64(2);
        let mut signal = RandomWalkSignal::new(&RandomWalk { low: 1.0, high: 1.1, rate: 50.0 }, 1.0, &mut random);
        assert!((0..10_000).all(|_| (1.0..=1.1).contains(&signal.next(&mut random))));
    }
}

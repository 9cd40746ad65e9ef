//! Held random levels.

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::check::{hold, interval, samples};
use super::uniform;
use crate::ParameterError;

/// Levels drawn uniformly and held for uniformly drawn times: the random references of collecting data without any model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RandomSteps {
    /// Of the levels, in the channel's unit.
    pub low: f64,
    /// Of the levels, in the channel's unit.
    pub high: f64,
    /// Hold, s.
    pub shortest: f64,
    /// Hold, s.
    pub longest: f64,
}

impl Default for RandomSteps {
    fn default() -> Self {
        Self { low: -1.0, high: 1.0, shortest: 0.5, longest: 2.0 }
    }
}

impl RandomSteps {
    pub(super) fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        interval(self.low, self.high)?;
        hold(self.shortest, self.longest, dt)
    }
}

#[derive(Debug, Clone)]
pub(super) struct RandomStepsSignal {
    parameters: RandomSteps,
    dt: f64,
    value: f64,
    left: u64,
    levels: u64,
}

impl RandomStepsSignal {
    pub(super) fn new(parameters: &RandomSteps, dt: f64) -> Self {
        Self { parameters: parameters.clone(), dt, value: 0.0, left: 0, levels: 0 }
    }

    pub(super) fn levels(&self) -> u64 {
        self.levels
    }

    pub(super) fn next(&mut self, random: &mut Pcg64) -> f64 {
        if self.left == 0 {
            let RandomSteps { low, high, shortest, longest } = self.parameters;
            self.value = uniform(low, high, random);
            self.levels += 1;
            self.left = samples(uniform(shortest, longest, random), self.dt);
        }
        self.left -= 1;
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn levels_are_uniform_with_the_stated_hold_time() {
        let mut random = Pcg64::seed_from_u64(4);
        let parameters = RandomSteps { low: -3.0, high: 1.0, shortest: 0.1, longest: 0.3 };
        let mut signal = RandomStepsSignal::new(&parameters, 0.01);
        let samples: Vec<f64> = (0..200_000).map(|_| signal.next(&mut random)).collect();
        let holds: Vec<&[f64]> = samples.chunk_by(|a, b| a == b).collect();
        // The last is cut short by the end.
        let holds = &holds[..holds.len() - 1];
        assert!(holds.iter().all(|hold| (10..=30).contains(&hold.len())));
        assert!((holds.len() as f64 - 10_000.0).abs() < 200.0, "{}", holds.len());
        let mean = holds.iter().map(|hold| hold[0]).sum::<f64>() / holds.len() as f64;
        let variance = holds.iter().map(|hold| (hold[0] - mean).powi(2)).sum::<f64>() / holds.len() as f64;
        assert!((mean + 1.0).abs() < 0.06 && (variance - 16.0 / 12.0).abs() < 0.07, "{mean} {variance}");
        assert!(samples.iter().all(|x| (-3.0..1.0).contains(x)));
    }
}

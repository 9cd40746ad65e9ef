//! 1/f noise.

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

use super::OrnsteinUhlenbeck;
use super::check::band;
use crate::ParameterError;
use crate::parameter_error::{finite, not_negative};

/// Gaussian noise whose power density falls as 1/f from `lowest` to `highest`: each octave has the same power. It is white
/// below the band and falls as 1/f^2 above it; at the two ends it bends, at half of its power there.
///
/// The sum of independent Ornstein-Uhlenbeck processes of one variance, whose corner frequencies lie an octave apart at
/// most: relaxations with log-uniform times have a 1/f spectrum (J. Bernamont, 1937). Other than the Voss-McCartney algorithm
/// it has no steps, and its spectrum does not depend on the sampling period.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Pink {
    /// Mean, in the channel's unit.
    pub offset: f64,
    /// Standard deviation, in the channel's unit.
    pub deviation: f64,
    /// Hz
    pub lowest: f64,
    /// Hz
    pub highest: f64,
}

impl Default for Pink {
    fn default() -> Self {
        Self { offset: 0.0, deviation: 0.4, lowest: 0.02, highest: 2.0 }
    }
}

impl Pink {
    pub(super) fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        finite("offset", self.offset)?;
        not_negative("deviation", self.deviation)?;
        band(self.lowest, self.highest, dt)
    }
}

#[derive(Debug, Clone)]
pub(super) struct PinkSignal {
    offset: f64,
    relaxations: Vec<OrnsteinUhlenbeck>,
}

impl PinkSignal {
    pub(super) fn new(parameters: &Pink, dt: f64, random: &mut Pcg64) -> Self {
        let octaves = (parameters.highest / parameters.lowest).log2();
        // 64 octaves are more than any frequencies span.
        let count = octaves.ceil().clamp(1.0, 64.0) as usize + 1;
        let deviation = parameters.deviation / (count as f64).sqrt();
        let relaxation = |k: usize| {
            let corner = parameters.lowest * (octaves * k as f64 / (count - 1) as f64).exp2();
            OrnsteinUhlenbeck::new(deviation, 1.0 / (TAU * corner), dt, random)
        };
        Self { offset: parameters.offset, relaxations: (0..count).map(relaxation).collect() }
    }

    pub(super) fn next(&mut self, random: &mut Pcg64) -> f64 {
        self.offset + self.relaxations.iter_mut().map(|relaxation| relaxation.next(random)).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::spectrum::{density, slope};
    use rand::SeedableRng;

    #[test]
    fn pink_power_falls_with_frequency() {
        const DT: f64 = 0.01;
        let parameters = Pink { offset: 0.3, deviation: 0.8, lowest: 0.02, highest: 20.0 };
        let mut random = Pcg64::seed_from_u64(8);
        let mut signal = PinkSignal::new(&parameters, DT, &mut random);
        let samples: Vec<f64> = (0..1_000_000).map(|_| signal.next(&mut random)).collect();
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / samples.len() as f64;
        assert!((mean - 0.3).abs() < 0.06 && (variance / 0.64 - 1.0).abs() < 0.06, "{mean} {variance}");
        // Two octaves and more inside the band's ends, where their bends are hardly felt.
        let frequencies: Vec<f64> = (0..6).map(|k| 0.1 * 2f64.powi(k)).collect();
        let densities: Vec<f64> = frequencies.iter().map(|&f| density(&samples, DT, f, 4000)).collect();
        let exponent = slope(&frequencies, &densities);
        assert!((exponent + 1.0).abs() < 0.07, "{exponent}");
        // Equal power per octave: f S(f) ln 2 = variance over the number of relaxations.
        for (frequency, density) in frequencies.iter().zip(densities) {
            let octave = frequency * density * std::f64::consts::LN_2;
            assert!((octave / (0.64 / 11.0) - 1.0).abs() < 0.2, "{frequency}: {octave}");
        }
    }
}

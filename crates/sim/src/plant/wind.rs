//! Wind: a mean, a slow oscillation, and gusts.

use std::f64::consts::TAU;

use glam::DVec3;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::OrnsteinUhlenbeck;
use crate::parameter_error::{ParameterError, in_range, positive};
use crate::sensor::stream;

/// Wind in the world's axes: the same everywhere in the small volume that is flown through.
///
/// `mean + oscillation sin(2 pi t / period) + gusts`. The gusts are an Ornstein-Uhlenbeck process along each axis,
/// whose spectrum `2 s^2 tau / (1 + (tau w)^2)` is the longitudinal one of Dryden's model (MIL-F-8785C) with tau =
/// length scale / airspeed; Dryden's spectra across the path are of second order and not reproduced. The conditions of
/// the Neural-Fly data are means of up to 12.1 m/s, and 8.5 + 2.4 sin t m/s.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Wind {
    /// m/s
    pub mean: [f64; 3],
    /// Amplitude of the oscillation, m/s.
    pub oscillation: [f64; 3],
    /// Its period, s.
    pub oscillation_period: f64,
    /// Standard deviation of the gusts, m/s.
    pub gust: [f64; 3],
    /// Correlation time of the gusts, s.
    pub gust_correlation: f64,
}

impl Default for Wind {
    fn default() -> Self {
        Self {
            mean: [1.5, 0.5, 0.0],
            oscillation: [0.0; 3],
            oscillation_period: TAU,
            gust: [0.4, 0.4, 0.2],
            gust_correlation: 0.8,
        }
    }
}

impl Wind {
    /// No wind.
    pub fn calm() -> Self {
        Self { mean: [0.0; 3], gust: [0.0; 3], ..Self::default() }
    }

    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        for axis in 0..3 {
            in_range(&format!("mean[{axis}]"), self.mean[axis], -100.0, 100.0, "from -100 to 100 m/s")?;
            in_range(&format!("oscillation[{axis}]"), self.oscillation[axis], -100.0, 100.0, "from -100 to 100 m/s")?;
            in_range(&format!("gust[{axis}]"), self.gust[axis], 0.0, 50.0, "from 0 to 50 m/s")?;
        }
        positive("oscillation_period", self.oscillation_period)?;
        positive("gust_correlation", self.gust_correlation)
    }
}

/// Wind that blows: sampled every `period` seconds, and held between.
pub(super) struct WindField {
    wind: Wind,
    period: f64,
    samples: u64,
    gusts: [(OrnsteinUhlenbeck, Pcg64); 3],
}

impl WindField {
    pub(super) fn new(wind: &Wind, period: f64, seed: u64) -> Self {
        let gusts = std::array::from_fn(|axis| {
            let mut random = stream(seed, &format!("wind/gust/{axis}"));
            (OrnsteinUhlenbeck::new(wind.gust[axis], wind.gust_correlation, period, &mut random), random)
        });
        Self { wind: wind.clone(), period, samples: 0, gusts }
    }

    /// The wind during the next period, m/s.
    pub(super) fn next(&mut self) -> DVec3 {
        let phase = TAU * self.samples as f64 * self.period / self.wind.oscillation_period;
        self.samples += 1;
        let gusts = DVec3::from_array(std::array::from_fn(|axis| {
            let (process, random) = &mut self.gusts[axis];
            process.next(random)
        }));
        DVec3::from_array(self.wind.mean) + phase.sin() * DVec3::from_array(self.wind.oscillation) + gusts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gusts_have_their_deviation_and_correlation() {
        const SAMPLES: usize = 100_000;
        let wind = Wind { gust: [1.0, 0.0, 0.5], ..Wind::default() };
        let mut field = WindField::new(&wind, 0.08, 3);
        let samples: Vec<DVec3> = (0..SAMPLES).map(|_| field.next() - DVec3::from_array(wind.mean)).collect();
        let mean = |f: &dyn Fn(usize) -> f64| (0..SAMPLES - 10).map(f).sum::<f64>() / (SAMPLES - 10) as f64;
        // A sample holds about period / (2 tau) = 1/20 of an independent one.
        let bound = 5.0 * (2.0 * 20.0 / SAMPLES as f64).sqrt();
        assert!((mean(&|i| samples[i].x.powi(2)) - 1.0).abs() < bound);
        assert!((mean(&|i| samples[i].z.powi(2)) - 0.25).abs() < bound);
        assert!(samples.iter().all(|wind| wind.y.abs() < 1e-12));
        // Ten samples are one correlation time.
        assert!((mean(&|i| samples[i].x * samples[i + 10].x) - (-1.0f64).exp()).abs() < bound);
        assert!(mean(&|i| samples[i].x * samples[i].z).abs() < bound);
    }

    #[test]
    fn the_oscillation_is_the_sine_of_the_neural_fly_data() {
        let wind = Wind { mean: [8.5, 0.0, 0.0], oscillation: [2.4, 0.0, 0.0], ..Wind::calm() };
        let mut field = WindField::new(&wind, 0.02, 1);
        for sample in 0..500 {
            let expected = 8.5 + 2.4 * (0.02 * f64::from(sample)).sin();
            assert!((field.next().x - expected).abs() < 1e-12);
        }
    }
}

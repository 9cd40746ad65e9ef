//! Sums of sines.

use std::f64::consts::{PI, TAU};

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::check::{band, that};
use super::uniform;
use crate::ParameterError;
use crate::parameter_error::{finite, not_negative};

/// Sines of one amplitude at `count` frequencies, equally spaced from `lowest` to `highest`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Multisine {
    /// Mean, in the channel's unit.
    pub offset: f64,
    /// Standard deviation over a period of the sum, in the channel's unit: each sine's amplitude is `deviation sqrt(2 / count)`.
    pub deviation: f64,
    /// Hz
    pub lowest: f64,
    /// Hz
    pub highest: f64,
    /// Number of sines.
    pub count: usize,
    /// Choice of the phases.
    pub phases: Phases,
    /// Odd multiples of `lowest` up to `highest` in place of `count` equal steps; of every four one, chosen at random, is
    /// left out. A nonlinear robot moves at the multiples that are left out, a linear one does not (R. Pintelon,
    /// J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., section 4.2).
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub odd: bool,
}

/// Phases of a multisine.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phases {
    /// Those of a low peak: `-pi k (k - 1) / count` for the k-th sine, k = 1, 2, ..., the case of a flat spectrum in
    /// M. R. Schroeder, Synthesis of low-peak-factor signals and binary sequences with low autocorrelation, 1970, equation (11).
    /// Channels with the same frequencies then move together.
    Schroeder,
    /// Uniform: channels with the same frequencies are independent of each other.
    #[default]
    Random,
}

/// Multiples of the lowest frequency, at most.
const MOST: usize = 20_000;

impl Default for Multisine {
    fn default() -> Self {
        Self { offset: 0.0, deviation: 0.4, lowest: 0.05, highest: 2.0, count: 40, phases: Phases::Random, odd: false }
    }
}

impl Multisine {
    pub(super) fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        finite("offset", self.offset)?;
        not_negative("deviation", self.deviation)?;
        that((1..=10_000).contains(&self.count), "count", self.count, "1 to 10000")?;
        band(self.lowest, self.highest, dt)
    }
}

/// Equal steps from the lowest frequency to the highest.
fn even(parameters: &Multisine) -> Vec<f64> {
    let spacing = (parameters.highest - parameters.lowest) / parameters.count.saturating_sub(1).max(1) as f64;
    (0..parameters.count).map(|k| parameters.lowest + spacing * k as f64).collect()
}

/// Odd multiples of the lowest frequency, three at random of every four.
fn odd(parameters: &Multisine, random: &mut Pcg64) -> Vec<f64> {
    // Half a multiple of room for rounding.
    let last = ((parameters.highest / parameters.lowest + 0.5) as usize).min(MOST);
    let multiples: Vec<usize> = (1..=last).step_by(2).collect();
    let mut chosen = Vec::with_capacity(multiples.len());
    for four in multiples.chunks(4) {
        let left = uniform(0.0, 4.0, random) as usize;
        let kept = four.iter().enumerate().filter(|(at, _)| four.len() < 4 || *at != left);
        chosen.extend(kept.map(|(_, multiple)| *multiple as f64 * parameters.lowest));
    }
    chosen
}

#[derive(Debug, Clone)]
pub(super) struct MultisineSignal {
    offset: f64,
    amplitude: f64,
    /// Hz and turns.
    sines: Vec<[f64; 2]>,
}

impl MultisineSignal {
    pub(super) fn new(parameters: &Multisine, random: &mut Pcg64) -> Self {
        let frequencies = if parameters.odd { odd(parameters, random) } else { even(parameters) };
        let count = frequencies.len();
        let sines = frequencies.into_iter().enumerate().map(|(k, frequency)| {
            let phase = match parameters.phases {
                Phases::Schroeder => -PI * k as f64 * (k + 1) as f64 / count as f64,
                Phases::Random => uniform(0.0, TAU, random),
            };
            [frequency, phase / TAU]
        });
        let sines: Vec<[f64; 2]> = sines.collect();
        Self { offset: parameters.offset, amplitude: parameters.deviation * (2.0 / count.max(1) as f64).sqrt(), sines }
    }

    pub(super) fn value(&self, t: f64) -> f64 {
        let sum: f64 = self.sines.iter().map(|[frequency, phase]| (TAU * (frequency * t + phase).fract()).cos()).sum();
        self.offset + self.amplitude * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::spectrum::power;
    use rand::SeedableRng;

    const DT: f64 = 0.002;
    const HARMONICS: usize = 30;

    fn one_period(phases: Phases, seed: u64) -> Vec<f64> {
        let parameters =
            Multisine { offset: 0.0, deviation: 0.7, lowest: 0.1, highest: 3.0, count: HARMONICS, phases, odd: false };
        let signal = MultisineSignal::new(&parameters, &mut Pcg64::seed_from_u64(seed));
        (0..5000).map(|k| signal.value(k as f64 * DT)).collect()
    }

    fn crest(samples: &[f64]) -> f64 {
        let peak = samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
        peak / (samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64).sqrt()
    }

    #[test]
    fn multisine_power_is_flat_and_confined() {
        for phases in [Phases::Schroeder, Phases::Random] {
            let samples = one_period(phases, 5);
            let variance = samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64;
            assert!((variance - 0.49).abs() < 1e-9);
            for harmonic in 1..=60 {
                let expected = if harmonic <= HARMONICS { 0.49 / HARMONICS as f64 } else { 0.0 };
                let measured = power(&samples, DT, 0.1 * harmonic as f64);
                assert!((measured - expected).abs() < 1e-9, "{harmonic}: {measured} {expected}");
            }
        }
    }

    #[test]
    fn odd_multisines_skip_detection_lines() {
        let parameters = Multisine { deviation: 0.7, lowest: 0.1, highest: 6.3, odd: true, ..Multisine::default() };
        let signal = MultisineSignal::new(&parameters, &mut Pcg64::seed_from_u64(3));
        let samples: Vec<f64> = (0..5000).map(|k| signal.value(k as f64 * DT)).collect();
        let there = |multiple: usize| power(&samples, DT, 0.1 * multiple as f64) > 1e-9;
        assert!((1..=31).all(|half| !there(2 * half)), "no even multiple");
        let odd: Vec<bool> = (0..32).map(|half| there(2 * half + 1)).collect();
        for four in odd.chunks(4) {
            assert_eq!(four.iter().filter(|there| **there).count(), 3, "{odd:?}");
        }
        let variance = samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64;
        assert!((variance - 0.49).abs() < 1e-9, "{variance}");
    }

    #[test]
    fn phases_of_schroeder_keep_the_peak_low() {
        let low = crest(&one_period(Phases::Schroeder, 0));
        assert!(low < 1.8, "{low}");
        for seed in 0..10 {
            let random = crest(&one_period(Phases::Random, seed));
            assert!(random > low + 0.2, "{random} {low}");
        }
    }
}

//! Sines that sweep.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::check::{band, time};
use crate::ParameterError;
use crate::parameter_error::{finite, not_negative};

/// A sine whose frequency goes from `lowest` to `highest` in `duration` seconds and back in as many, again and again; phase
/// and frequency are continuous.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Chirp {
    /// Mean, in the channel's unit.
    pub offset: f64,
    /// In the channel's unit.
    pub amplitude: f64,
    /// Hz
    pub lowest: f64,
    /// Hz
    pub highest: f64,
    /// Of one sweep, s.
    pub duration: f64,
    /// Course of the frequency with time.
    pub sweep: Sweep,
}

/// Course of a chirp's frequency with time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// The frequency changes at a constant rate in hertz.
    Linear,
    /// The frequency changes at a constant rate in octaves.
    #[default]
    Logarithmic,
}

impl Default for Chirp {
    fn default() -> Self {
        Self { offset: 0.0, amplitude: 1.0, lowest: 0.05, highest: 2.0, duration: 60.0, sweep: Sweep::Logarithmic }
    }
}

impl Chirp {
    pub(super) fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        finite("offset", self.offset)?;
        not_negative("amplitude", self.amplitude)?;
        band(self.lowest, self.highest, dt)?;
        time("duration", self.duration, dt)
    }

    /// The value at time `t`, s.
    pub fn value(&self, t: f64) -> f64 {
        let whole = self.turns(self.duration);
        let sweeps = 2.0 * self.duration;
        let (done, inside) = ((t / sweeps).floor(), t.rem_euclid(sweeps));
        // The way back is the mirror image of the way up.
        let turns =
            if inside <= self.duration { self.turns(inside) } else { 2.0 * whole - self.turns(sweeps - inside) };
        self.offset + self.amplitude * (TAU * ((2.0 * whole * done).fract() + turns).fract()).sin()
    }

    /// The integral of the frequency over the first `t` seconds of the way up.
    fn turns(&self, t: f64) -> f64 {
        let (low, high) = (self.lowest, self.highest);
        match self.sweep {
            Sweep::Linear => low * t + (high - low) * t * t / (2.0 * self.duration),
            Sweep::Logarithmic => {
                let growth = (high / low).ln();
                low * self.duration / growth * (growth * t / self.duration).exp_m1()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rising zero crossings in a span, by samples of 0.1 ms.
    fn crossings(chirp: &Chirp, from: f64, to: f64) -> usize {
        let samples: Vec<f64> =
            (0..((to - from) / 1e-4) as usize).map(|k| chirp.value(from + k as f64 * 1e-4)).collect();
        samples.windows(2).filter(|pair| pair[0] < 0.0 && pair[1] >= 0.0).count()
    }

    #[test]
    fn frequency_follows_the_sweep() {
        let linear = Chirp { lowest: 2.0, highest: 12.0, duration: 10.0, sweep: Sweep::Linear, ..Chirp::default() };
        // The mean frequency of second k of the way up is 2.5 + k Hz, and the way back mirrors it.
        for k in 0..20 {
            let expected = if k < 10 { 2.5 + k as f64 } else { 2.5 + (19 - k) as f64 };
            let count = crossings(&linear, k as f64, (k + 1) as f64) as f64;
            assert!((count - expected).abs() <= 1.0, "{k}: {count} {expected}");
        }
        let logarithmic = Chirp { lowest: 1.0, highest: 16.0, duration: 20.0, ..Chirp::default() };
        // Each of the 4 octaves takes 5 s; the octave from f has 5 f / ln 2 turns.
        for octave in 0..4 {
            let expected = 5.0 * 2f64.powi(octave) / std::f64::consts::LN_2;
            let count = crossings(&logarithmic, 5.0 * f64::from(octave), 5.0 * f64::from(octave + 1)) as f64;
            assert!((count - expected).abs() <= 1.0, "{octave}: {count} {expected}");
        }
    }

    #[test]
    fn chirp_is_continuous_and_bounded() {
        for sweep in [Sweep::Linear, Sweep::Logarithmic] {
            let chirp = Chirp { lowest: 0.3, highest: 4.0, duration: 3.7, sweep, ..Chirp::default() };
            let steepest = TAU * 4.0 * 1e-4 * 1.001;
            for k in 0..300_000 {
                let (a, b) = (chirp.value(k as f64 * 1e-4), chirp.value((k + 1) as f64 * 1e-4));
                assert!((a - b).abs() <= steepest && a.abs() <= 1.0);
            }
        }
    }
}

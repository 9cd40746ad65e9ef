//! Quick access recorder: the channels of section 9.1 of the block-sparse bolasso paper, with noise and resolution.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::parameter_error::{ParameterError, not_negative};
use crate::sensor::stream;

/// One recorded channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Standard deviation of its noise, in its unit.
    pub deviation: f64,
    /// Value of one bit, in the channel's unit; 0: not quantised.
    pub resolution: f64,
}

/// Noise and resolution of the recorded channels. White; resolutions are those common on recorders of airliners.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Recorder {
    /// Pressure altitude h, m (2 ft).
    pub altitude: Channel,
    /// Mach number M, 1.
    pub mach: Channel,
    /// Fuel flow C of both engines, kg/s (4 lb/h).
    pub fuel_flow: Channel,
    /// Fan speed N1 over its maximum, 1.
    pub fan_speed: Channel,
    /// Static air temperature SAT, K.
    pub temperature: Channel,
    /// Pitch, rad (2 pi / 1024).
    pub pitch: Channel,
    /// Mass, kg (20 lb).
    pub mass: Channel,
}

impl Default for Recorder {
    fn default() -> Self {
        let channel = |deviation, resolution| Channel { deviation, resolution };
        Self {
            altitude: channel(1.0, 0.6096),
            mach: channel(0.0005, 0.001),
            fuel_flow: channel(0.004, 0.000_504),
            fan_speed: channel(0.0005, 0.001_25),
            temperature: channel(0.1, 0.25),
            pitch: channel(0.001, std::f64::consts::TAU / 1024.0),
            mass: channel(0.0, 9.071_85),
        }
    }
}

impl Recorder {
    /// Number of channels.
    pub(super) const CHANNELS: usize = 7;

    /// In the order of the recorded columns.
    fn channels(&self) -> [(&'static str, Channel); Self::CHANNELS] {
        [
            ("altitude", self.altitude),
            ("mach", self.mach),
            ("fuel_flow", self.fuel_flow),
            ("fan_speed", self.fan_speed),
            ("temperature", self.temperature),
            ("pitch", self.pitch),
            ("mass", self.mass),
        ]
    }

    pub(super) fn validate(&self) -> Result<(), ParameterError> {
        for (name, channel) in self.channels() {
            not_negative("deviation", channel.deviation).map_err(|error| error.within(name))?;
            not_negative("resolution", channel.resolution).map_err(|error| error.within(name))?;
        }
        Ok(())
    }
}

/// A recorder at work: every channel has its own random numbers.
pub(super) struct Recording {
    channels: [(Channel, Pcg64); Recorder::CHANNELS],
}

impl Recording {
    pub(super) fn new(recorder: &Recorder, seed: u64) -> Self {
        Self {
            channels: recorder.channels().map(|(name, channel)| (channel, stream(seed, &format!("recorder/{name}")))),
        }
    }

    /// Recorded values of the true ones, in the order of the channels.
    pub(super) fn keep(&mut self, truth: [f64; Recorder::CHANNELS]) -> [f64; Recorder::CHANNELS] {
        std::array::from_fn(|i| {
            let (channel, random) = &mut self.channels[i];
            let normal: f64 = if channel.deviation > 0.0 { StandardNormal.sample(random) } else { 0.0 };
            let value = truth[i] + channel.deviation * normal;
            if channel.resolution > 0.0 { (value / channel.resolution).round() * channel.resolution } else { value }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_have_their_resolution_and_noise() {
        let recorder = Recorder { pitch: Channel { deviation: 0.0, resolution: 0.01 }, ..Recorder::default() };
        let mut recording = Recording::new(&recorder, 5);
        let (mut sum, mut squares) = (0.0, 0.0);
        const SAMPLES: usize = 20_000;
        for i in 0..SAMPLES {
            let truth = 0.37 * i as f64;
            let kept = recording.keep([truth, 0.5, 1.0, 0.9, 250.0, 0.0449, 6e4]);
            let error = kept[0] - truth;
            sum += error;
            squares += error * error;
            assert!((kept[5] - 0.04).abs() < 1e-15);
            let bits = kept[0] / recorder.altitude.resolution;
            assert!((bits - bits.round()).abs() < 1e-6);
        }
        // Noise and rounding, which is uniform in a bit.
        let variance = 1.0 + 0.6096f64.powi(2) / 12.0;
        let n = SAMPLES as f64;
        assert!((sum / n).abs() < 5.0 * (variance / n).sqrt());
        assert!((squares / n / variance - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
    }
}

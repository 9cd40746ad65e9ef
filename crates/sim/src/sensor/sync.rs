//! A lamp that blinks by one computer's clock and is seen by others, so that their clocks can be aligned.

use serde::{Deserialize, Serialize};

use super::{Clock, check, clock::nanoseconds};
use crate::{ParameterError, Reading};

/// A square wave on a lamp, driven by the controller, recorded by the robot and seen by the motion capture. After II-B
/// of *Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot* (Buchan, Haldane, Fearing).
///
/// Edges can be told apart only while two clocks differ by less than half a period.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SyncWaveParameters {
    /// From one rising edge to the next by the driving clock, s.
    pub period: f64,
    /// The share of a period that the lamp is lit.
    pub duty: f64,
    /// Time of the first rising edge after a run's beginning, s, by the driving clock.
    pub delay: f64,
    /// Light of the lamp when lit, lx.
    pub light: f64,
}

impl Default for SyncWaveParameters {
    /// Half a period is 503.618034 times 1 ms, a share that is the golden one, and 50.3618034 times 10 ms: edges fall between the samples of 1 kHz and of 100 Hz about as evenly as points can, none twice
    /// at one place, and none at the instant of a sample. Edges of a wave whose period is a multiple of the sampling all say the same, and narrow nothing.
    fn default() -> Self {
        Self { period: 1.007_236_068, duty: 0.5, delay: 0.500_381_966, light: 1.0 }
    }
}

impl SyncWaveParameters {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check::within("period", self.period, 1e-6..=1e6)?;
        check::within("duty", self.duty, 0.0..=1.0)?;
        check::within("delay", self.delay, 0.0..=1e6)?;
        check::positive("light", self.light, 1e9)
    }
}

/// A square wave on a lamp. It has no noise: the light is there or not at the instant that a sensor looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SyncWave {
    clock: Clock,
    period: i64,
    lit: i64,
    delay: i64,
    light: f64,
}

impl SyncWave {
    /// A wave driven by a clock. The parameters have passed [`SyncWaveParameters::validate`].
    pub fn new(parameters: &SyncWaveParameters, clock: Clock) -> Self {
        let period = nanoseconds(parameters.period);
        Self {
            clock,
            period,
            lit: (period as f64 * parameters.duty).round() as i64,
            delay: nanoseconds(parameters.delay),
            light: parameters.light,
        }
    }

    /// The light at a true time in ns since the run's beginning.
    pub fn level(&self, time: i64) -> f64 {
        let since = self.clock.elapsed(time) - self.delay;
        if since >= 0 && since % self.period < self.lit { self.light } else { 0.0 }
    }

    /// The light as a switch between two true times leaves it, and when it was switched, ns since 1970 by the driving clock; `None` if it was not.
    pub fn switched(&self, from: i64, to: i64) -> Option<(f64, i64)> {
        let level = self.level(to);
        let since = self.clock.elapsed(to) - self.delay;
        let within = since.rem_euclid(self.period);
        let edge = if level == 0.0 { within - self.lit } else { within };
        (level != self.level(from)).then(|| (level, self.clock.read(to) - edge))
    }

    /// The light at a true time, as a message.
    pub fn reading(&self, time: i64) -> Reading<'static> {
        Reading::Light(self.level(time))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::ClockParameters;

    #[test]
    fn edges_follow_the_driving_clock() {
        let parameters = SyncWaveParameters { period: 0.2, duty: 0.25, delay: 0.1, light: 40.0 };
        parameters.validate().unwrap();
        let clock = Clock::new(&ClockParameters { offset: 3.0, skew: 100.0, jitter: 0.0 }, 0);
        let wave = SyncWave::new(&parameters, clock);
        // By a clock that is 100 ppm fast, 0.1 s pass in 0.1 / 1.0001 s.
        let true_time = |seconds: f64| (seconds / 1.0001 * 1e9).round() as i64;
        assert_eq!(wave.level(0), 0.0);
        for wave_number in 0..1000 {
            let (rising, falling) = (0.1 + 0.2 * f64::from(wave_number), 0.15 + 0.2 * f64::from(wave_number));
            assert_eq!([wave.level(true_time(rising) - 2), wave.level(true_time(rising) + 2)], [0.0, 40.0]);
            assert_eq!([wave.level(true_time(falling) - 2), wave.level(true_time(falling) + 2)], [40.0, 0.0]);
        }
    }

    #[test]
    fn switches_have_nanosecond_stamps() {
        let clock = Clock::new(&ClockParameters { offset: 0.0, skew: 20.0, jitter: 0.0 }, 7);
        let wave = SyncWave::new(&SyncWaveParameters::default(), clock);
        let (mut switches, step) = (Vec::new(), 250_000);
        for now in 0..40_000 {
            switches.extend(wave.switched((now - 1) * step, now * step));
        }
        assert_eq!(switches.len(), 19);
        for (index, (level, at)) in (0..).zip(switches) {
            assert_eq!((level, at), (if index % 2 == 0 { 1.0 } else { 0.0 }, 7 + 500_381_966 + index * 503_618_034));
        }
    }

    /// The first 240 edges are spread over the sampling of 1 kHz and of 100 Hz. No gap between neighbours is greater
    /// than the golden sequence's greatest, 1.618 / 240 of a period.
    #[test]
    fn edges_are_spread_over_the_sampling() {
        let half = nanoseconds(0.5 * SyncWaveParameters::default().period);
        for sampling in [1_000_000, 10_000_000] {
            let mut places: Vec<i64> = (0..240).map(|edge| (edge * half).rem_euclid(sampling)).collect();
            places.sort_unstable();
            places.push(places[0] + sampling);
            let widest = places.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
            assert!(widest < sampling * 1618 / 1000 / 240, "{sampling} {widest}");
        }
    }

    #[test]
    fn bad_wave_parameters_are_refused() {
        let error = SyncWaveParameters { duty: 1.5, ..SyncWaveParameters::default() }.validate().unwrap_err();
        assert_eq!(error.name, "duty");
        SyncWaveParameters { period: 0.0, ..SyncWaveParameters::default() }.validate().unwrap_err();
    }
}

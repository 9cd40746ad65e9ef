//! Computers' clocks, and the stamps that their programs write.

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::{check, streams};
use crate::ParameterError;

/// Nanoseconds in a second.
pub(crate) const NANOSECONDS: f64 = 1e9;

/// Seconds to whole nanoseconds, to the nearest.
pub(crate) fn nanoseconds(seconds: f64) -> i64 {
    (seconds * NANOSECONDS).round() as i64
}

/// Deviation of a computer's clock from true time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockParameters {
    /// Time shown less true time at the beginning of a run, s; at most an hour either way.
    pub offset: f64,
    /// Rate relative to true time, ppm (microseconds a second), positive: faster; at most 10,000 either way. Quartz: up
    /// to 50.
    pub skew: f64,
    /// Standard deviation of the stamp that the program writes about the clock's time of the measurement, s.
    pub jitter: f64,
}

impl Default for ClockParameters {
    /// True time, stamped by a program that is 20 us late or early.
    fn default() -> Self {
        Self { offset: 0.0, skew: 0.0, jitter: 20e-6 }
    }
}

impl ClockParameters {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check::within("offset", self.offset, -3600.0..=3600.0)?;
        check::within("skew", self.skew, -1e4..=1e4)?;
        check::within("jitter", self.jitter, 0.0..=1.0)
    }
}

/// A computer's clock: `epoch + offset + (1 + skew) t` at true time t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    start: i64,
    skew: f64,
    jitter: f64,
}

impl Clock {
    /// A clock of a run that begins at `epoch`, ns since 1970 of true time. The parameters have passed [`ClockParameters::validate`].
    pub fn new(parameters: &ClockParameters, epoch: i64) -> Self {
        let ClockParameters { offset, skew, jitter } = *parameters;
        Self { start: epoch + nanoseconds(offset), skew: skew * 1e-6, jitter }
    }

    /// The clock without an error: true time as ns since 1970.
    pub fn perfect(epoch: i64) -> Self {
        Self { start: epoch, skew: 0.0, jitter: 0.0 }
    }

    /// Time that the clock shows, ns since 1970, at a true time in ns since the run's beginning.
    pub fn read(&self, time: i64) -> i64 {
        self.start + self.elapsed(time)
    }

    /// Time by the clock since the run's beginning, ns.
    pub fn elapsed(&self, time: i64) -> i64 {
        // The product alone is rounded, so that a year's nanoseconds keep their last digit.
        time + (time as f64 * self.skew).round() as i64
    }

    /// The stamps that a program on this computer gives to one sensor's measurements. `sensor` names its stream of random numbers.
    pub fn stamper(&self, seed: u64, sensor: &str) -> Stamper {
        let random = streams::stream(seed, &format!("{sensor}/stamps"));
        Stamper { clock: *self, last: i64::MIN, random }
    }
}

/// One sensor's stamps: its computer's clock with jitter, strictly increasing.
#[derive(Debug, Clone)]
pub struct Stamper {
    clock: Clock,
    last: i64,
    random: Pcg64,
}

impl Stamper {
    /// The stamp of a measurement taken at a true time in ns since the run's beginning; ns since 1970. A stamp that jitter would put at or
    /// before the one before it comes one nanosecond after that.
    pub fn stamp(&mut self, time: i64) -> i64 {
        let jitter = nanoseconds(self.clock.jitter * streams::normal(&mut self.random));
        self.last = (self.clock.read(time) + jitter).max(self.last.saturating_add(1));
        self.last
    }

    /// The stamps that a program writes just before and just after it does something at `moment`, ns since 1970 by its own clock.
    pub fn around(&mut self, moment: i64) -> [i64; 2] {
        let mut apart = || 1 + nanoseconds(self.clock.jitter * streams::normal(&mut self.random)).abs();
        let (before, after) = (moment - apart(), moment + apart());
        let before = before.max(self.last.saturating_add(1));
        self.last = after.max(before + 1);
        [before, self.last]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EPOCH: i64 = 1_735_689_600_000_000_000;

    #[test]
    fn reads_offset_and_skew_to_the_nanosecond() {
        let parameters = ClockParameters { offset: 0.25, skew: 20.0, jitter: 0.0 };
        let clock = Clock::new(&parameters, EPOCH);
        assert_eq!(clock.read(0), EPOCH + 250_000_000);
        assert_eq!(clock.read(1_000_000_000), EPOCH + 1_250_020_000);
        // A day: 86,400 s at 20 ppm are 1.728 s.
        assert_eq!(clock.read(86_400_000_000_001), EPOCH + 86_400_000_000_001 + 250_000_000 + 1_728_000_000);
        assert_eq!(Clock::perfect(EPOCH).read(12_345), EPOCH + 12_345);
    }

    #[test]
    fn jitter_has_deviation_and_keeps_rate() {
        const SAMPLES: i64 = 40_000;
        let parameters = ClockParameters { jitter: 20e-6, ..ClockParameters::default() };
        let mut stamper = Clock::new(&parameters, EPOCH).stamper(3, "imu");
        let errors: Vec<f64> = (0..SAMPLES)
            .map(|sample| (stamper.stamp(sample * 1_000_000) - EPOCH - sample * 1_000_000) as f64 / 20e3)
            .collect();
        let mean = errors.iter().sum::<f64>() / SAMPLES as f64;
        let variance = errors.iter().map(|error| error * error).sum::<f64>() / SAMPLES as f64;
        assert!(mean.abs() < 5.0 / (SAMPLES as f64).sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / SAMPLES as f64).sqrt(), "{variance}");
    }

    #[test]
    fn stamps_increase_despite_large_jitter() {
        let parameters = ClockParameters { jitter: 5e-3, skew: -100.0, ..ClockParameters::default() };
        let mut stamper = Clock::new(&parameters, EPOCH).stamper(1, "imu");
        let stamps: Vec<i64> = (0..20_000).map(|sample| stamper.stamp(sample * 1_000_000)).collect();
        assert!(stamps.is_sorted_by(|a, b| a < b));
        // Jitter never pushes the stamps away for good: at most some deviations from the clock.
        let last = Clock::new(&parameters, EPOCH).read(19_999_000_000);
        assert!((stamps[19_999] - last).abs() < 30_000_000, "{}", stamps[19_999] - last);
    }

    #[test]
    fn bad_clock_parameters_are_refused() {
        let error =
            ClockParameters { skew: 2e4, ..ClockParameters::default() }.validate().unwrap_err().within("clocks.robot");
        assert!(error.to_string().contains("clocks.robot.skew") && error.to_string().contains("20000"), "{error}");
        ClockParameters { jitter: f64::NAN, ..ClockParameters::default() }.validate().unwrap_err();
        ClockParameters::default().validate().unwrap();
    }
}

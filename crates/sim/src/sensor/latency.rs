//! Delays of messages on a link.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::{check, clock::nanoseconds, streams};
use crate::ParameterError;

/// Delays of a link that keeps its messages in order.
///
/// A message's own delay is `minimum + (maximum - minimum) B` with B of the beta distribution (1, b) whose mean makes the delay's `mean`: most
/// messages are quick, few are late, none later than `maximum`. A message never overtakes the one before it, so that where delays exceed the
/// messages' period the mean delay is somewhat longer than `mean`: 10.5 ms
/// for the defaults at 100 Hz.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LatencyParameters {
    /// The shortest delay, s.
    pub minimum: f64,
    /// The mean delay, s.
    pub mean: f64,
    /// The longest delay, s.
    pub maximum: f64,
}

impl Default for LatencyParameters {
    /// Mean and maximum of the control loop in II-B of *Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot*
    /// (Buchan, Haldane, Fearing): 10 ms and 30 ms.
    fn default() -> Self {
        Self { minimum: 0.002, mean: 0.01, maximum: 0.03 }
    }
}

impl LatencyParameters {
    /// Every message takes `seconds`.
    pub fn fixed(seconds: f64) -> Self {
        Self { minimum: seconds, mean: seconds, maximum: seconds }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check::within("minimum", self.minimum, 0.0..=10.0)?;
        check::within("maximum", self.maximum, self.minimum..=10.0)?;
        check::within("mean", self.mean, self.minimum..=self.maximum)
    }
}

/// A link: when what is sent arrives.
#[derive(Debug, Clone)]
pub struct Latency {
    minimum: f64,
    spread: f64,
    /// 1 / b of the beta distribution.
    exponent: f64,
    last: i64,
    random: Pcg64,
}

impl Latency {
    /// A link whose parameters have passed [`LatencyParameters::validate`]. `link` names its stream of random numbers.
    pub fn new(parameters: &LatencyParameters, seed: u64, link: &str) -> Self {
        let LatencyParameters { minimum, mean, maximum } = *parameters;
        // The mean of B is 1 / (1 + b). At its ends the distribution is a point.
        let share = if maximum > minimum { (mean - minimum) / (maximum - minimum) } else { 0.0 };
        let (spread, exponent) = if share < 1.0 { (maximum - minimum, share / (1.0 - share)) } else { (0.0, 1.0) };
        let minimum = if share < 1.0 { minimum } else { maximum };
        let random = streams::stream(seed, &format!("{link}/latency"));
        Self { minimum, spread, exponent, last: i64::MIN, random }
    }

    /// When a message that is sent at `time` arrives; both true time in ns. Times of sending must not decrease.
    pub fn arrival(&mut self, time: i64) -> i64 {
        let uniform: f64 = self.random.random();
        // The inverse of the distribution function 1 - (1 - x)^b; `uniform` and `1 - uniform` are equally likely.
        let beta = 1.0 - (1.0 - uniform).powf(self.exponent);
        self.last = (time + nanoseconds(self.minimum + self.spread * beta)).max(self.last);
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLES: i64 = 50_000;

    /// Delays in seconds of messages `period` ns apart.
    fn delays(parameters: &LatencyParameters, period: i64) -> Vec<f64> {
        parameters.validate().unwrap();
        let mut latency = Latency::new(parameters, 5, "mocap");
        (0..SAMPLES).map(|sample| (latency.arrival(sample * period) - sample * period) as f64 * 1e-9).collect()
    }

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    #[test]
    fn delays_have_their_mean_and_bounds() {
        for (minimum, middle, maximum) in
            [(0.002, 0.01, 0.03), (0.0, 0.01, 0.03), (0.0, 0.02, 0.03), (0.001, 0.001, 0.1)]
        {
            let parameters = LatencyParameters { minimum, mean: middle, maximum };
            let delays = delays(&parameters, 1_000_000_000);
            assert!(delays.iter().all(|delay| (minimum - 1e-9..=maximum + 1e-9).contains(delay)));
            // The variance of the beta distribution (1, b) is b / ((1 + b)^2 (2 + b)), where 1 / (1 + b) is the mean m: m^2 (1 - m) / (1 + m).
            let share = (middle - minimum) / (maximum - minimum);
            let deviation = (maximum - minimum) * share * ((1.0 - share) / (1.0 + share)).sqrt();
            let bound = 5.0 * deviation / (SAMPLES as f64).sqrt();
            assert!((mean(&delays) - middle).abs() < bound.max(1e-9), "{parameters:?}: {}", mean(&delays));
        }
        assert!(delays(&LatencyParameters::fixed(0.004), 1_000_000).iter().all(|&delay| (delay - 0.004).abs() < 1e-12));
    }

    #[test]
    fn latency_keeps_order_and_maximum() {
        let parameters = LatencyParameters::default();
        let delays = delays(&parameters, 10_000_000);
        let arrivals: Vec<f64> =
            delays.iter().zip(0..).map(|(delay, sample)| f64::from(sample) * 0.01 + delay).collect();
        assert!(arrivals.windows(2).all(|pair| pair[0] <= pair[1] + 1e-9));
        assert!(delays.iter().all(|&delay| delay <= parameters.maximum + 1e-9));
        // Waiting for the one before costs little at the period of the motion capture.
        let excess = mean(&delays) - parameters.mean;
        assert!((0.0..0.002).contains(&excess), "{excess}");
    }

    #[test]
    fn refuses_a_mean_outside_its_bounds() {
        let error = LatencyParameters { mean: 0.04, ..LatencyParameters::default() }.validate().unwrap_err();
        assert!(error.to_string().contains("mean = 0.04"), "{error}");
        LatencyParameters { minimum: f64::INFINITY, ..LatencyParameters::default() }.validate().unwrap_err();
    }
}

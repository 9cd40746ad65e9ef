//! An absolute encoder, and the rate that the robot's program computes from it.

use std::f64::consts::TAU;

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::{check, streams};
use crate::ParameterError;

/// An absolute encoder on a shaft: 14 bits, after II-A of *Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot*
/// (Buchan, Haldane, Fearing). The noise is what data sheets of magnetic ones state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EncoderParameters {
    /// Seconds between samples.
    pub period: f64,
    /// Bits of a turn.
    pub bits: u32,
    /// Standard deviation of a sample's white noise before it is rounded to a code, rad.
    pub noise: f64,
    /// The angle at which the code is 0, rad.
    pub zero: f64,
    /// Cut-off frequency of the first-order low-pass filter on the differenced angle, Hz; 0 does not filter.
    pub rate_cutoff: f64,
}

impl Default for EncoderParameters {
    fn default() -> Self {
        Self { period: 1e-3, bits: 14, noise: 1e-3, zero: 0.0, rate_cutoff: 100.0 }
    }
}

impl EncoderParameters {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check::positive("period", self.period, 1.0)?;
        check::within("bits", f64::from(self.bits), 1.0..=31.0)?;
        check::within("noise", self.noise, 0.0..=1.0)?;
        check::within("zero", self.zero, -1e3..=1e3)?;
        check::within("rate_cutoff", self.rate_cutoff, 0.0..=1e6)
    }
}

/// Decoded sample of an encoder: the code, and the robot's estimates from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncoderSample {
    /// 0 to 2^bits - 1.
    pub code: u32,
    /// The shaft's angle from the encoder's zero, in [-pi, pi), rad.
    pub angle: f64,
    /// The same counted over whole turns, rad: equal to `angle` at the first sample.
    pub turned: f64,
    /// Of the shaft, rad/s: the difference of angles over the period, filtered; 0 at the first sample.
    pub rate: f64,
}

/// An absolute encoder on a shaft.
#[derive(Debug, Clone)]
pub struct Encoder {
    period: f64,
    codes: u32,
    noise: f64,
    zero: f64,
    /// Weight of the newest difference in the filtered rate.
    weight: f64,
    last: Option<EncoderSample>,
    /// Codes counted over whole turns, so that many turns lose no digit.
    count: i64,
    random: Pcg64,
}

impl Encoder {
    /// An encoder whose parameters have passed [`EncoderParameters::validate`]. `sensor` names its stream of random numbers.
    pub fn new(parameters: &EncoderParameters, seed: u64, sensor: &str) -> Self {
        let &EncoderParameters { period, bits, noise, zero, rate_cutoff } = parameters;
        let weight = if rate_cutoff > 0.0 { -(-TAU * rate_cutoff * period).exp_m1() } else { 1.0 };
        let random = streams::stream(seed, &format!("{sensor}/noise"));
        Self { period, codes: 1 << bits, noise, zero, weight, last: None, count: 0, random }
    }

    /// The angle between neighbouring codes, rad.
    pub fn resolution(&self) -> f64 {
        TAU / f64::from(self.codes)
    }

    /// The sample at the shaft's angle (rad, any number of turns); to be called once a period. Between two samples the shaft must turn by
    /// less than half a turn, or its direction is lost, as on the machine.
    pub fn sample(&mut self, angle: f64) -> EncoderSample {
        let codes = i64::from(self.codes);
        let noisy = angle - self.zero + self.noise * streams::normal(&mut self.random);
        let code = ((noisy / self.resolution()).round() as i64).rem_euclid(codes);
        let half = codes / 2;
        let wrap = |difference: i64| (difference + half).rem_euclid(codes) - half;
        let angle = wrap(code) as f64 * self.resolution();
        let rate = match self.last {
            None => {
                self.count = wrap(code);
                0.0
            }
            Some(last) => {
                let step = wrap(code - i64::from(last.code));
                self.count += step;
                let difference = step as f64 * self.resolution() / self.period;
                last.rate + self.weight * (difference - last.rate)
            }
        };
        let turned = self.count as f64 * self.resolution();
        let sample = EncoderSample { code: code as u32, angle, turned, rate };
        self.last = Some(sample);
        sample
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn quiet() -> EncoderParameters {
        EncoderParameters { noise: 0.0, rate_cutoff: 0.0, ..EncoderParameters::default() }
    }

    #[test]
    fn codes_wrap_and_angles_are_within_half_a_code() {
        let parameters = EncoderParameters { zero: 0.3, ..quiet() };
        let mut encoder = Encoder::new(&parameters, 1, "left");
        assert_eq!(encoder.resolution(), TAU / 16384.0);
        let mut start = None;
        for sample in 0..30_000 {
            let truth = 100.0 - f64::from(sample) * 0.0123;
            let reading = encoder.sample(truth);
            assert!(reading.code < 16384 && (-PI..PI).contains(&reading.angle));
            let code = reading.angle / encoder.resolution();
            assert!((code - code.round()).abs() < 1e-9);
            let error = truth - 0.3 - reading.angle;
            let error = error - (error / TAU).round() * TAU;
            assert!(error.abs() <= encoder.resolution() * 0.5 + 1e-9, "{sample}: {error}");
            let turns = *start.get_or_insert(truth - 0.3 - reading.turned);
            assert!((truth - 0.3 - reading.turned - turns).abs() <= encoder.resolution() * 1.01);
        }
    }

    #[test]
    fn encoder_reports_steady_shaft_rate() {
        for cutoff in [0.0, 20.0, 100.0] {
            let parameters = EncoderParameters { rate_cutoff: cutoff, ..quiet() };
            let mut encoder = Encoder::new(&parameters, 1, "left");
            let rates: Vec<f64> = (0..5000).map(|sample| encoder.sample(f64::from(sample) * -0.0314).rate).collect();
            let mean = rates[4000..].iter().sum::<f64>() / 1000.0;
            assert!((mean + 31.4).abs() < encoder.resolution() * 2.0 / 1.0, "{mean}");
            let ripple = rates[4000..].iter().map(|rate| (rate + 31.4).abs()).fold(0.0, f64::max);
            assert!(ripple <= encoder.resolution() / parameters.period * 1.01, "{ripple}");
            assert_eq!(rates[0], 0.0);
        }
    }

    #[test]
    fn filter_has_first_order_step_response() {
        let parameters = EncoderParameters { rate_cutoff: 10.0, bits: 31, ..quiet() };
        let mut encoder = Encoder::new(&parameters, 1, "left");
        encoder.sample(0.0);
        for sample in 1..100 {
            let expected = 20.0 * (1.0 - (-TAU * 10.0 * f64::from(sample) * 1e-3).exp());
            let rate = encoder.sample(f64::from(sample) * 0.02).rate;
            assert!((rate - expected).abs() < 1e-4, "{sample}: {rate} {expected}");
        }
    }

    #[test]
    fn noise_has_its_deviation() {
        const SAMPLES: usize = 40_000;
        let parameters = EncoderParameters::default();
        let mut encoder = Encoder::new(&parameters, 2, "left");
        let errors: Vec<f64> = (0..SAMPLES).map(|_| encoder.sample(PI).angle).map(|a| a - a.signum() * PI).collect();
        let variance = errors.iter().map(|error| error * error).sum::<f64>() / SAMPLES as f64;
        // Rounding adds the variance of a uniform distribution over one code.
        let expected = parameters.noise.powi(2) + encoder.resolution().powi(2) / 12.0;
        assert!((variance / expected - 1.0).abs() < 5.0 * (2.0 / SAMPLES as f64).sqrt(), "{variance} {expected}");
    }

    #[test]
    fn bad_encoder_parameters_are_refused() {
        let error = EncoderParameters { bits: 32, ..quiet() }.validate().unwrap_err();
        assert!(error.to_string().contains("bits = 32"), "{error}");
        EncoderParameters { period: 0.0, ..quiet() }.validate().unwrap_err();
        quiet().validate().unwrap();
    }
}

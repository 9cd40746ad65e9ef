//! Results of the fusion of a joint's sensors.

use crate::fuse::Prior;

/// The states of a run at the instants that were wanted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointStates {
    /// Position, rate and acceleration; NaN where nothing is known.
    pub derivatives: [Vec<f64>; 3],
    /// Their standard deviations.
    pub deviations: [Vec<f64>; 3],
    /// Rows of every sensor that were left out as gross errors.
    pub rejected: Vec<Vec<usize>>,
}

/// A sensor as it was found, or as it was given: then with a deviation of 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSensorEstimate {
    /// Standard deviation of a reading, steps aside.
    pub noise: f64,
    /// Standard deviation of a reading about the sensor's own curve. If `noise` is far greater, the sensors contradict
    /// each other.
    pub alone: f64,
    /// Seconds by which readings are stamped late.
    pub delay: Prior<f64>,
    /// Bias of a reading: reading less true value.
    pub bias: Prior<f64>,
    /// Readings of all runs.
    pub readings: usize,
}

/// Correlation of the errors of two sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    /// A sensor.
    pub first: usize,
    /// Another.
    pub second: usize,
    /// Of their errors at one stamp, or at neighbouring ones: the greatest. Independent sensors have some hundredths.
    pub correlation: f64,
    /// Pairs of readings behind the estimate.
    pub readings: usize,
}

/// Result of the fusion of a joint's sensors.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FusedJoint {
    /// In the order of the runs.
    pub runs: Vec<JointStates>,
    /// Density of the white noise that models the jerk, u/s^3/sqrt(Hz).
    pub jerk: f64,
    /// In the order of the sensors.
    pub sensors: Vec<JointSensorEstimate>,
    /// Of all pairs of sensors that share stamps.
    pub correlations: Vec<Correlation>,
    /// Passes over the readings to find noise and constants.
    pub rounds: usize,
    /// True if these converged.
    pub converged: bool,
    /// Seconds after which states share a hundredth of a reading.
    pub smoothed: f64,
}

/// Seconds after which the states of a chain share a hundredth of a reading.
///
/// `positions` and `rates` are the readings a second over the variance of one, `density` the square of the jerk's. Errors of the smoother decay as the roots in the upper half plane of
/// omega^6 / density + rates omega^2 + positions do: in u = omega^2 there is one negative root -a, and a pair about a / 2.
pub(super) fn smoothed(positions: f64, rates: f64, density: f64) -> f64 {
    let (p, r) = (density * positions, density * rates);
    // a^3 + r a - p is convex for a > 0: Newton's steps from above go down to its root.
    let mut a = p.cbrt();
    for _ in 0..100 {
        a -= (a * a * a + r * a - p) / (3.0 * a * a + r);
    }
    let (real, imaginary) = (0.5 * a, 0.5 * (3.0 * a * a + 4.0 * r).sqrt());
    // The imaginary part of the square root of the pair.
    let pair = (0.5 * (real.hypot(imaginary) - real)).sqrt();
    100.0_f64.ln() / a.sqrt().min(pair)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Spline;

    /// Positions alone are the quintic spline.
    #[test]
    fn encoder_joint_is_smoothed_like_its_spline() {
        let (noise, period, density) = (0.02_f64, 0.01, 40.0);
        let lambda = noise * noise / density;
        let expected = Spline::Quintic.correlation_rows(lambda, period, 1.0) * period;
        let variance = smoothed(1.0 / (period * noise * noise), 0.0, density);
        assert!((variance / expected - 1.0).abs() < 1e-9, "{variance} {expected}");
        // A rate that is known far better than the position says nothing of the position.
        assert!(smoothed(1.0, 1e6, 1.0) > 100.0 * smoothed(1.0, 0.0, 1.0));
    }
}

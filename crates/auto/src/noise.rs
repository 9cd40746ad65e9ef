//! The share of noise in the differences of a column from row to row.

use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Error;

/// Rows of an episode, and of all, that are looked at.
const ROWS: usize = 50_000;
/// From this share on, what differs from row to row is mostly noise.
pub(crate) const MOSTLY: f64 = 0.5;
/// Variance of the third differences of white noise, and their covariance two rows apart, over the variance of the
/// noise: sums of products of the coefficients 1, -3, 3, -1.
const VARIANCE: f64 = 20.0;
const COVARIANCE: f64 = 6.0;
/// Third differences beyond so many times their median are jumps: six medians are four deviations of a normal
/// distribution, which one in 20,000 exceeds.
const JUMP: f64 = 6.0;

/// The share of white noise in the variance of the differences of a column. Of a smooth curve nothing is left in third
/// differences; those of white noise have a known variance and covariance. The smaller share of both counts: states
/// that switch, or walk at random, have the variance of noise without its covariance. Jumps (wraps, outliers) are left
/// out.
///
/// # Errors
/// Those of reading.
pub(crate) fn share(rows: &dyn Source, column: usize) -> Result<f64, Error> {
    // Of six rows in a line: two third differences, two rows apart, and the difference between them.
    let (mut differences, mut left) = (Vec::new(), ROWS);
    for (at, episode) in rows.episodes().iter().enumerate() {
        let counted = episode.rows.min(left);
        left -= counted;
        let block = rows.read(at, 0..counted, Halo::default())?;
        let third = |x: &[f64]| x[3] - 3.0 * x[2] + 3.0 * x[1] - x[0];
        let rows_in_line = block.core(column).windows(6).filter(|x| x.iter().all(|x| x.is_finite()));
        differences.extend(rows_in_line.map(|x| [third(x), third(&x[2..]), x[3] - x[2]]));
    }
    if differences.is_empty() {
        return Ok(0.0);
    }
    let middle = differences.len() / 2;
    let (_, median, _) = differences.select_nth_unstable_by(middle, |a, b| a[0].abs().total_cmp(&b[0].abs()));
    // A value that mostly repeats is that of a coarse sensor: every step of it is an error.
    let is_coarse = median[0] == 0.0;
    let most = if is_coarse { f64::INFINITY } else { JUMP * median[0].abs() };
    let (mut variance, mut covariance, mut first) = (0.0, 0.0, 0.0);
    for [a, b, difference] in differences.iter().filter(|[a, b, _]| a.abs() <= most && b.abs() <= most) {
        variance += a * a;
        covariance += a * b;
        first += difference * difference;
    }
    if first == 0.0 {
        return Ok(0.0);
    }
    let by_covariance = if is_coarse { f64::INFINITY } else { covariance / COVARIANCE };
    // A difference has twice the variance of the noise.
    Ok((2.0 * (variance / VARIANCE).min(by_covariance) / first).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};

    use super::*;

    /// Uniform numbers between -0.5 and 0.5, of variance 1/12.
    fn random() -> impl FnMut() -> f64 {
        let mut seed = 3u64;
        move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        }
    }

    fn share_of(values: Vec<f64>) -> f64 {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        source.push_uniform("a", 0.01, vec![values]);
        share(&source, 0).unwrap()
    }

    fn wave(amplitude: f64, mut noise: impl FnMut() -> f64) -> Vec<f64> {
        (0..4000).map(|row| amplitude * (0.02 * f64::from(row)).sin() + noise()).collect()
    }

    #[test]
    fn noise_dominates_differences_of_slow_curves() {
        let mut draw = random();
        let mut noisy = |noise: f64| share_of(wave(1.0, || noise * draw()));
        assert!(noisy(0.0) < 0.01 && noisy(0.2) > 0.9, "{} {}", noisy(0.0), noisy(0.2));
        // A difference of 0.014 (root of the mean square) beside noise of 0.0058: twice 0.0058^2 of 2e-4 + twice that.
        assert!((noisy(0.02) - 0.25).abs() < 0.05, "{}", noisy(0.02));
    }

    #[test]
    fn coarse_sensors_are_noisy() {
        let slow = wave(1.0, || 0.0).into_iter().map(|x| (5.0 * x).round() / 5.0).collect();
        assert!(share_of(slow) > MOSTLY);
    }

    #[test]
    fn jumps_of_smooth_curves_are_no_noise() {
        // An angle in degrees that turns 40 times, and a curve with an outlier.
        let wraps = (0..4000).map(|row| (3.6 * f64::from(row) + 5.0 * (0.02 * f64::from(row)).sin()) % 360.0).collect();
        assert!(share_of(wraps) < 0.01);
        let mut outlier = wave(1.0, || 0.0);
        outlier[1234] = 50.0;
        assert!(share_of(outlier) < 0.01);
        // An outlier does not hide noise either.
        let mut draw = random();
        let mut noisy = wave(1.0, || 0.2 * draw());
        noisy[1234] = 50.0;
        assert!(share_of(noisy) > 0.9);
    }

    #[test]
    fn fast_and_random_motion_is_no_noise() {
        // The share would be (2 sin 0.95)^4 / 10 = 0.7 by the variance alone.
        let fast = share_of((0..4000).map(|row| (1.9 * f64::from(row)).sin()).collect());
        assert!(fast < 0.01, "{fast}");
        // The increments of a walk are white: third differences have variance 6 and covariance 1: 1/6 of a noise.
        let (mut place, mut draw) = (0.0, random());
        let walk = (0..4000).map(|_| {
            place += draw();
            place
        });
        let walk = share_of(walk.collect());
        assert!((walk - 1.0 / 3.0).abs() < 0.1, "{walk}");
    }
}

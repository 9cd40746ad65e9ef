//! The share of noise in the differences of a column from row to row.

use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Error;

/// Rows of an episode, and of all, that are looked at.
const ROWS: usize = 50_000;
/// From this share on, what differs from row to row is mostly noise.
pub(crate) const MOSTLY: f64 = 0.5;
/// Squares of the coefficients of a third difference, summed: that many times the variance of white noise is the variance of its third difference.
const THIRD: f64 = 20.0;

/// The share of white noise in the variance of the differences of a column. Of a smooth curve nothing is left in third differences, of white noise twenty times its variance.
///
/// # Errors
/// Those of reading.
pub(crate) fn share(rows: &dyn Source, column: usize) -> Result<f64, Error> {
    let (mut first, mut third, mut count, mut left) = (0.0, 0.0, 0usize, ROWS);
    for (at, episode) in rows.episodes().iter().enumerate() {
        let counted = episode.rows.min(left);
        left -= counted;
        let block = rows.read(at, 0..counted, Halo::default())?;
        for x in block.core(column).windows(4).filter(|x| x.iter().all(|x| x.is_finite())) {
            first += (x[3] - x[2]).powi(2);
            third += (x[3] - 3.0 * x[2] + 3.0 * x[1] - x[0]).powi(2);
            count += 1;
        }
    }
    if count == 0 || first == 0.0 {
        return Ok(0.0);
    }
    // A difference has twice the variance of the noise.
    Ok((2.0 * third / THIRD / first).min(1.0))
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};

    use super::*;

    #[test]
    fn noise_dominates_differences_of_slow_curves() {
        let mut seed = 3u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut share_of = |noise: f64| {
            let values: Vec<f64> = (0..4000).map(|row| (0.02 * f64::from(row)).sin() + noise * random()).collect();
            let mut source = MemorySource::new(vec![Column::float("x")]);
            source.push_uniform("a", 0.01, vec![values]);
            share(&source, 0).unwrap()
        };
        assert!(share_of(0.0) < 0.01 && share_of(0.2) > 0.9, "{} {}", share_of(0.0), share_of(0.2));
        // A difference of 0.014 (root of the mean square) beside noise of 0.0058.
        assert!((0.15..0.4).contains(&share_of(0.02)), "{}", share_of(0.02));
    }
}

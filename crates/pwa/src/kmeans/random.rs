//! Random numbers by counting: every draw has an address, so that nothing depends on who draws first.

use fleetfoot_data::mix;

/// A uniform number in `[0, 1)` for (seed, restart, draw).
pub(super) fn uniform(seed: u64, restart: u64, draw: u64) -> f64 {
    let bits = mix(mix(mix(seed).wrapping_add(restart)).wrapping_add(draw));
    (bits >> 11) as f64 * 2f64.powi(-53)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_uniform_and_uncorrelated() {
        let n = 100_000u64;
        let draws: Vec<f64> = (0..n).map(|i| uniform(7, i / 1000, i % 1000)).collect();
        assert!(draws.iter().all(|u| (0.0..1.0).contains(u)));
        let mean = draws.iter().sum::<f64>() / n as f64;
        let correlation = draws.windows(2).map(|pair| (pair[0] - 0.5) * (pair[1] - 0.5)).sum::<f64>() / n as f64;
        // Five standard errors of the mean and of the lag-one product.
        assert!((mean - 0.5).abs() < 5.0 * (1.0 / 12.0 / n as f64).sqrt(), "{mean}");
        assert!(correlation.abs() < 5.0 / 12.0 / (n as f64).sqrt(), "{correlation}");
        assert_ne!(uniform(1, 0, 1), uniform(1, 1, 0));
        assert_ne!(uniform(1, 0, 0), uniform(0, 1, 0));
    }
}

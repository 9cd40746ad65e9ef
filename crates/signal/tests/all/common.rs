//! Random numbers, and distances between lists.

use fleetfoot_data::mix;

/// A number from 0 to 1 with this address.
pub(crate) fn uniform(seed: u64, at: u64) -> f64 {
    (mix(mix(seed).wrapping_add(at)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A standard normal number with this address (Box and Muller).
pub(crate) fn normal(seed: u64, at: u64) -> f64 {
    let (a, b) = (uniform(seed, 2 * at), uniform(seed, 2 * at + 1));
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// The greatest difference over the greatest size of what is expected.
pub(crate) fn distance(actual: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(actual.len(), expected.len());
    let size = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let apart = actual.iter().zip(expected).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    assert!(!actual.iter().chain(expected).any(|x| x.is_nan()), "NaN");
    apart / size
}

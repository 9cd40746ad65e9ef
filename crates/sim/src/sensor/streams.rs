//! Random numbers: one independent stream for each purpose of a run.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// The stream of random numbers for one purpose of the run with this seed.
///
/// The draws of one purpose never move another's numbers. A sensor that is switched off, or reads more often, leaves
/// the physics and the other sensors unchanged. A purpose is a path, e.g. `imu/noise`; each is used for one generator.
///
/// The generator begins at `Pcg64::from_seed(h)`, with `h` the 32 bytes of BLAKE3 over the seed (8 bytes,
/// little-endian) followed by the purpose (UTF-8). So all 256 bits of state and increment differ between purposes: PCG
/// streams that share the state are correlated. This is fixed; another function would change every simulated log.
pub fn stream(seed: u64, purpose: &str) -> Pcg64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes());
    hasher.update(purpose.as_bytes());
    Pcg64::from_seed(*hasher.finalize().as_bytes())
}

/// One number of the standard normal distribution.
pub(super) fn normal(random: &mut Pcg64) -> f64 {
    StandardNormal.sample(random)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn random_bits_never_change() {
        let mut random = stream(1, "imu/noise");
        assert_eq!([random.next_u64(), random.next_u64()], VECTOR);
    }

    /// From another BLAKE3, written after its paper, and NumPy's PCG64, by the recipe in the documentation of [`stream`].
    const VECTOR: [u64; 2] = [0xf906_2d91_ed3c_a4d7, 0xf4fc_c20a_7505_6452];

    #[test]
    fn seeds_and_purposes_are_uncorrelated() {
        const SAMPLES: usize = 20_000;
        let draw = |seed, purpose| {
            let mut random = stream(seed, purpose);
            std::array::from_fn::<f64, SAMPLES, _>(|_| normal(&mut random))
        };
        let base = draw(7, "imu/noise");
        assert_eq!(base, draw(7, "imu/noise"));
        for (seed, purpose) in [(8, "imu/noise"), (7, "imu/bias"), (7, "imu/noisf"), (7, "")] {
            let correlation = base.iter().zip(draw(seed, purpose)).map(|(a, b)| a * b).sum::<f64>() / SAMPLES as f64;
            assert!(correlation.abs() < 5.0 / (SAMPLES as f64).sqrt(), "{seed} {purpose}: {correlation}");
        }
    }
}

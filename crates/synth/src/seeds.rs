//! Seeds of each run's random numbers.

use fleetfoot_data::mix;

/// The seed of a run, by the seed of all runs and the run's number only, so that a run is the same however many there
/// are.
pub fn run_seed(seed: u64, run: u64) -> u64 {
    mix(mix(seed).wrapping_add(run))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::run_seed;

    #[test]
    fn runs_of_neighbouring_seeds_have_distinct_seeds() {
        let seeds: BTreeSet<u64> = (0..100).flat_map(|seed| (0..100).map(move |run| run_seed(seed, run))).collect();
        assert_eq!(seeds.len(), 10_000);
    }
}

//! Where the random numbers of each run begin.

/// The seed of a run: by the seed of all runs and the run's number and by nothing else, so that a run is the same however many there are.
///
/// Mixed by the output function of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014), once for each part.
pub fn run_seed(seed: u64, run: u64) -> u64 {
    mix(mix(seed).wrapping_add(run))
}

fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::run_seed;

    #[test]
    fn runs_of_neighbouring_seeds_have_seeds_of_their_own() {
        let seeds: BTreeSet<u64> = (0..100).flat_map(|seed| (0..100).map(move |run| run_seed(seed, run))).collect();
        assert_eq!(seeds.len(), 10_000);
    }
}

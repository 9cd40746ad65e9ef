//! Pairs of regions that may have the same dynamics.

/// Test of one affine map for two regions: the likelihood ratio of a map for each against one for both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionPair {
    /// The regions, the smaller number first.
    pub regions: [u32; 2],
    /// Twice the logarithm of the ratio, with the effective number of rows; infinite where one map leaves errors and two leave none.
    pub statistic: f64,
    /// Its degrees of freedom: numbers that two maps have more than one, of all targets.
    pub freedom: usize,
    /// The probability of such a ratio or a larger one if both regions have the same map; NaN if their rows are too
    /// few.
    pub p: f64,
}

/// The probabilities of several tests, corrected for their number (Holm, *Scandinavian Journal of Statistics* 6, 1979).
/// The chance that any falls below a level, with no real difference, is at most the level, however the tests depend on
/// each other. NaN stays: no test.
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).filter(|&at| !p[at].is_nan()).collect();
    order.sort_by(|&a, &b| p[a].total_cmp(&p[b]));
    let (mut adjusted, mut least) = (p.to_vec(), 0.0f64);
    for (rank, &at) in order.iter().enumerate() {
        least = least.max((p[at] * (order.len() - rank) as f64).min(1.0));
        adjusted[at] = least;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn holm_corrects_the_example_of_his_paper() {
        // 0.01 of four, then 0.03 of two (0.04 of one would be less), 0.005 first: 4 x 0.005, 3 x 0.01, 2 x 0.03, and no less than that.
        let adjusted = holm(&[0.01, 0.04, 0.03, f64::NAN, 0.005]);
        assert_eq!(adjusted[..3], [0.03, 0.06, 0.06]);
        assert!(adjusted[3].is_nan());
        assert_eq!(adjusted[4], 0.02);
    }

    proptest! {
        #[test]
        fn between_the_plain_ones_and_bonferronis(p in prop::collection::vec(0.0..1.0f64, 1..30)) {
            let (adjusted, count) = (holm(&p), p.len() as f64);
            for (adjusted, plain) in adjusted.iter().zip(&p) {
                prop_assert!(*plain <= *adjusted && *adjusted <= (plain * count).min(1.0));
            }
            for (a, b) in (0..p.len()).flat_map(|a| (0..p.len()).map(move |b| (a, b))) {
                prop_assert!(p[a] > p[b] || adjusted[a] <= adjusted[b], "the order stays");
            }
        }
    }
}

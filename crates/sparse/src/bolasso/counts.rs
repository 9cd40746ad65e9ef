//! Resampling counts from counter-based random numbers: a count is a function of the seed, the row (or the draw) and the replicate, and of nothing else.

use faer::Mat;
use fleetfoot_data::{EpisodeId, mix};
use pulp::{Simd, WithSimd};

/// 2^64 over the golden ratio: the increment of SplitMix64 (Steele, Lea, Flood 2014).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
/// Seeds that separate the draws of units, halves and counts of rows under one seed.
const DRAWS: u64 = 0x6472_6177_7321_0001;
const HALVES: u64 = 0x6861_6c76_6573_0002;
/// Replicates that share a run of 64-bit numbers: the low half of each counts for one of the first eight, the high half for one of the others.
const BLOCK: usize = 16;
/// Counts beyond this are rarer than 2^-33.
const LARGEST: usize = 12;

/// The random number with this index of the sequence with this key.
#[inline(always)]
fn number(key: u64, index: u64) -> u64 {
    mix(key.wrapping_add(index.wrapping_mul(GOLDEN)))
}

/// `2^32 P(X <= k)` for X of the Poisson distribution of mean 1, k = 0 .. `LARGEST`, rounded.
const fn thresholds() -> [u64; LARGEST] {
    let mut thresholds = [0; LARGEST];
    let (mut term, mut sum) = (1.0 / core::f64::consts::E, 0.0);
    let mut k = 0;
    while k < LARGEST {
        sum += term;
        thresholds[k] = (sum * 4_294_967_296.0 + 0.5) as u64;
        k += 1;
        term /= k as f64;
    }
    thresholds
}

const THRESHOLDS: [u64; LARGEST] = thresholds();

/// Poisson(1) counts of the rows of an episode: what resampling with replacement gives each of many rows, without the condition that the counts sum
/// to n (their sum has the standard deviation sqrt(n), so a replicate's own n is used in its objective).
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoissonCounts {
    key: u64,
}

impl PoissonCounts {
    pub(crate) fn new(seed: u64, episode: EpisodeId) -> Self {
        let halves = [episode.0 as u64, (episode.0 >> 64) as u64];
        Self { key: halves.into_iter().fold(mix(seed), |key, half| mix(key.wrapping_add(half))) }
    }

    /// Length of the counts of one row for `replicates`: whole blocks, the last counts of which are there to be ignored.
    pub(crate) fn stride(replicates: usize) -> usize {
        replicates.next_multiple_of(BLOCK)
    }

    /// The counts of these rows of the episode for the replicates 0, 1, ..., row after row: `stride` numbers each.
    pub(crate) fn fill(&self, rows: &[usize], first: usize, stride: usize, counts: &mut [f64]) {
        debug_assert_eq!((counts.len(), stride % BLOCK), (rows.len() * stride, 0));
        if stride > 0 {
            fleetfoot_data::arch().dispatch(Fill { key: self.key, rows, first, stride, counts });
        }
    }
}

struct Fill<'a> {
    key: u64,
    rows: &'a [usize],
    first: usize,
    stride: usize,
    counts: &'a mut [f64],
}

impl WithSimd for Fill<'_> {
    type Output = ();

    // Plain loops of eight: the compiler makes vectors of them for the instruction set that this is compiled for.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (&row, counts) in self.rows.iter().zip(self.counts.chunks_exact_mut(self.stride)) {
            let key = number(self.key, (self.first + row) as u64);
            for (block, counts) in counts.chunks_exact_mut(BLOCK).enumerate() {
                let mut bits = [0_u64; BLOCK / 2];
                for (j, bits) in bits.iter_mut().enumerate() {
                    *bits = number(key, (block * (BLOCK / 2) + j) as u64);
                }
                let (low, high) = counts.split_at_mut(BLOCK / 2);
                for j in 0..BLOCK / 2 {
                    low[j] = poisson(bits[j] & 0xffff_ffff);
                    high[j] = poisson(bits[j] >> 32);
                }
            }
        }
    }
}

/// The Poisson(1) count of 32 random bits, by inversion.
#[inline(always)]
fn poisson(bits: u64) -> f64 {
    let mut count = 0_u64;
    for threshold in THRESHOLDS {
        count += u64::from(bits >= threshold);
    }
    count as f64
}

/// The counts of [`row_bootstrap`](crate::bolasso::row_bootstrap): those of `rows` rows of an episode from its row `first` on (replicates x rows).
pub fn poisson_counts(seed: u64, episode: EpisodeId, first: usize, rows: usize, replicates: usize) -> Mat<f64> {
    let stride = PoissonCounts::stride(replicates);
    let mut counts = vec![0.0; rows * stride];
    PoissonCounts::new(seed, episode).fill(&(0..rows).collect::<Vec<_>>(), first, stride, &mut counts);
    Mat::from_fn(replicates, rows, |replicate, row| counts[row * stride + replicate])
}

/// The counts of [`block_bootstrap`](crate::bolasso::block_bootstrap): how often each of `units` is drawn in `units` draws with replacement, for this replicate.
pub fn multinomial_counts(seed: u64, replicate: usize, units: usize) -> Vec<f64> {
    let key = number(mix(seed).wrapping_add(DRAWS), replicate as u64);
    let mut counts = vec![0.0; units];
    for draw in 0..units {
        let unit = (u128::from(number(key, draw as u64)) * units as u128) >> 64;
        counts[unit as usize] += 1.0;
    }
    counts
}

/// A random half of `units` (1 and 0), rounded down, and an equal number of the others: complementary halves.
pub(crate) fn halves(seed: u64, pair: usize, units: usize) -> [Vec<f64>; 2] {
    let key = number(mix(seed).wrapping_add(HALVES), pair as u64);
    let mut order: Vec<(u64, usize)> = (0..units).map(|unit| (number(key, unit as u64), unit)).collect();
    order.sort_unstable();
    let half = units / 2;
    let members = |from: usize| {
        let mut weights = vec![0.0; units];
        order[from..from + half].iter().for_each(|&(_, unit)| weights[unit] = 1.0);
        weights
    };
    [members(0), members(half)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const ID: EpisodeId = EpisodeId(0x1234_5678_9abc_def0_0fed_cba9_8765_4321);

    /// Upper quantile 1e-6 of the chi-square distribution with k degrees of freedom (Wilson and Hilferty 1931).
    fn limit(k: f64) -> f64 {
        k * (1.0 - 2.0 / (9.0 * k) + 4.753 * (2.0 / (9.0 * k)).sqrt()).powi(3)
    }

    /// Distance of frequencies from probabilities that need not sum to 1: what is left is one more class.
    fn chi_square(counts: &[f64], probabilities: &[f64], n: f64) -> f64 {
        counts.iter().zip(probabilities).map(|(count, p)| (count - n * p).powi(2) / (n * p)).sum()
    }

    fn poisson_probabilities() -> Vec<f64> {
        let mut p = vec![(-1.0_f64).exp()];
        (1..20).for_each(|k| p.push(p[k - 1] / k as f64));
        p
    }

    #[test]
    fn counts_are_independent_poisson() {
        let (rows, b) = (20_000, 32);
        let mut counts = vec![0.0; rows * b];
        PoissonCounts::new(7, ID).fill(&(0..rows).collect::<Vec<_>>(), 0, b, &mut counts);
        let p = poisson_probabilities();
        let classes = 8;
        let class = |count: f64| (count as usize).min(classes - 1);
        let mut probability = p[..classes].to_vec();
        probability[classes - 1] = p[classes - 1..].iter().sum();
        let mut single = vec![0.0; classes];
        counts.iter().for_each(|&count| single[class(count)] += 1.0);
        let n = (rows * b) as f64;
        assert!(chi_square(&single, &probability, n) < limit(7.0), "{single:?}");
        // Neighbours along the replicates, along the rows, and the two halves of one random number.
        for (name, step) in [("replicate", 1), ("row", b), ("half", BLOCK / 2)] {
            let mut pairs = vec![0.0; classes * classes];
            let mut total = 0.0;
            for at in 0..counts.len() - step {
                pairs[class(counts[at]) * classes + class(counts[at + step])] += 1.0;
                total += 1.0;
            }
            let joint: Vec<f64> = probability.iter().flat_map(|a| probability.iter().map(move |b| a * b)).collect();
            assert!(chi_square(&pairs, &joint, total) < limit(63.0), "{name}");
        }
    }

    #[test]
    fn thresholds_are_the_distribution_function() {
        let mut sum = 0.0;
        for (threshold, p) in THRESHOLDS.iter().zip(poisson_probabilities()) {
            sum += p;
            assert!((*threshold as f64 - sum * 2.0_f64.powi(32)).abs() <= 0.5 + 1e-5);
        }
        let beyond = 1.0 - sum - poisson_probabilities()[LARGEST];
        assert!(beyond * 2.0_f64.powi(32) < 0.5, "the counts left out are rarer than the resolution");
        assert_eq!(poisson(0), 0.0);
        assert_eq!(poisson(0xffff_ffff), LARGEST as f64);
    }

    #[test]
    fn counts_depend_on_row_and_replicate() {
        let counts = PoissonCounts::new(1, ID);
        let mut all = vec![0.0; 50 * 48];
        counts.fill(&(0..50).collect::<Vec<_>>(), 100, 48, &mut all);
        let mut some = vec![0.0; 2 * 16];
        counts.fill(&[3, 17], 110, 16, &mut some);
        assert_eq!(some[..16], all[13 * 48..13 * 48 + 16]);
        assert_eq!(some[16..], all[27 * 48..27 * 48 + 16]);
        let mut other = vec![0.0; 50 * 48];
        PoissonCounts::new(2, ID).fill(&(0..50).collect::<Vec<_>>(), 100, 48, &mut other);
        assert_ne!(all, other);
        PoissonCounts::new(1, EpisodeId(ID.0 + (1 << 64))).fill(&(0..50).collect::<Vec<_>>(), 100, 48, &mut other);
        assert_ne!(all, other);
    }

    #[test]
    fn draws_are_multinomial_and_halves_are_complementary() {
        let units = 40;
        let mut sums = vec![0.0; units];
        for replicate in 0..2000 {
            let counts = multinomial_counts(5, replicate, units);
            assert_eq!(counts.iter().sum::<f64>(), units as f64);
            sums.iter_mut().zip(&counts).for_each(|(sum, count)| *sum += count);
        }
        assert!(chi_square(&sums, &vec![1.0 / units as f64; units], 2000.0 * units as f64) < limit(39.0));
        let mut together = 0.0;
        for pair in 0..2000 {
            let [a, b] = halves(5, pair, 7);
            assert_eq!((a.iter().sum::<f64>(), b.iter().sum::<f64>()), (3.0, 3.0));
            assert!(a.iter().zip(&b).all(|(a, b)| a * b == 0.0));
            together += a[0] * a[1];
        }
        // Two given units of seven share a half of three with the probability 3/7 * 2/6 = 1/7: six standard deviations.
        assert!((together / 2000.0 - 1.0 / 7.0).abs() < 6.0 * (6.0_f64 / 49.0 / 2000.0).sqrt());
    }
}

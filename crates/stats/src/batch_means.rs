//! Batch means: how many of the rows of a log count as independent.

use fleetfoot_data::EpisodeId;

/// The residual's sums over chunks, one entry a target.
///
/// Rows of a log are correlated over tau of them, so that n rows say as much as n / tau. In blocks much longer than that, the expected square of a block's
/// sum of residuals is `tau` times the sum of their squares; the ratio of the two, over all blocks, estimates tau. Chunks may be shorter, so neighbours are
/// joined two by two, as long as there are `LEAST` blocks and the ratio still grows by more than two of its own standard errors (blocking: Flyvbjerg and
/// Petersen 1989).
#[derive(Debug, Clone, PartialEq)]
pub struct BatchMeans {
    targets: usize,
    /// Episode, weight, and the sums of the residuals.
    chunks: Vec<(EpisodeId, f64, Vec<f64>)>,
}

/// Blocks that a longer estimate needs.
const LEAST: usize = 16;

impl BatchMeans {
    /// No chunks yet, of residuals of `targets` targets.
    pub fn new(targets: usize) -> Self {
        Self { targets, chunks: Vec::new() }
    }

    /// Adds a chunk, in the order of episode and chunk: the sum of its row weights, and the weighted mean of every target's residual. A chunk without rows
    /// leaves no trace.
    ///
    /// # Panics
    /// When there is not one mean a target.
    pub fn add(&mut self, episode: EpisodeId, weight: f64, mean: &[f64]) {
        assert_eq!(mean.len(), self.targets, "one mean a target");
        if weight > 0.0 {
            self.chunks.push((episode, weight, mean.iter().map(|mean| weight * mean).collect()));
        }
    }

    /// Rows that count as independent, `weight / tau` with the largest tau of the targets, but not less than 2: `weight` is the sum of all rows'
    /// weights, `error` the sum of squared residuals of every target. One chunk says nothing: then it is `weight`.
    pub fn effective_weight(&self, weight: f64, error: &[f64]) -> f64 {
        let tau = (0..self.targets).map(|target| self.correlation(target, error[target])).fold(1.0, f64::max);
        if self.chunks.len() < 2 { weight } else { (weight / tau).max(2.0) }
    }

    /// tau of a target, in rows; at least 1.
    fn correlation(&self, target: usize, error: f64) -> f64 {
        if error.is_nan() || error <= 0.0 || self.chunks.len() < 2 {
            return 1.0;
        }
        let mut blocks: Vec<(EpisodeId, f64)> =
            self.chunks.iter().map(|(episode, _, sums)| (*episode, sums[target])).collect();
        let ratio = |blocks: &[(EpisodeId, f64)]| blocks.iter().map(|(_, sum)| sum * sum).sum::<f64>() / error;
        let mut tau = ratio(&blocks);
        loop {
            blocks = joined(&blocks);
            if blocks.len() < LEAST {
                return tau.max(1.0);
            }
            let longer = ratio(&blocks);
            // The deviation of a mean of n squares of normal numbers is sqrt(2 / n) of it.
            if longer <= tau * (1.0 + 2.0 * (2.0 / blocks.len() as f64).sqrt()) {
                return tau.max(1.0);
            }
            tau = longer;
        }
    }
}

/// Neighbours of one episode two by two; an odd one at its end stays alone.
fn joined(blocks: &[(EpisodeId, f64)]) -> Vec<(EpisodeId, f64)> {
    let mut found = Vec::with_capacity(blocks.len() / 2 + 1);
    let mut k = 0;
    while k < blocks.len() {
        let pair = blocks.get(k + 1).filter(|next| next.0 == blocks[k].0);
        found.push((blocks[k].0, blocks[k].1 + pair.map_or(0.0, |next| next.1)));
        k += 1 + usize::from(pair.is_some());
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An autoregressive series, x' = a x + noise, has tau = (1 + a) / (1 - a).
    #[test]
    fn an_autoregressive_series_has_its_correlation_time() {
        // Long chunks, and chunks shorter than the correlation time.
        for (chunk, chunks) in [(500, 400), (5, 40_000)] {
            let a = 0.9;
            let mut state = 0.0;
            let mut counter = 0_u64;
            let mut noise = || {
                // Sum of uniform numbers from a counter: any independent numbers of mean zero serve.
                (0..4)
                    .map(|_| {
                        counter += 1;
                        fleetfoot_data::mix(counter) as f64 / u64::MAX as f64 - 0.5
                    })
                    .sum::<f64>()
            };
            let (mut means, mut square) = (BatchMeans::new(1), 0.0);
            for _ in 0..chunks {
                let mut sum = 0.0;
                for _ in 0..chunk {
                    state = a * state + noise();
                    sum += state;
                    square += state * state;
                }
                means.add(EpisodeId(1), f64::from(chunk), &[sum / f64::from(chunk)]);
            }
            let rows = f64::from(chunk * chunks);
            let tau = rows / means.effective_weight(rows, &[square]);
            // 19, less what the ends of chunks cut off (2 %), within three deviations of a variance from 400 numbers (21 %).
            assert!((14.5..23.5).contains(&tau), "{chunk}: {tau}");
        }
        assert_eq!(BatchMeans::new(1).effective_weight(10.0, &[1.0]), 10.0);
    }

    #[test]
    fn episodes_are_not_joined() {
        let mut means = BatchMeans::new(1);
        (0..64).for_each(|e| means.add(EpisodeId(e), 10.0, &[1.0]));
        assert_eq!(means.effective_weight(640.0, &[640.0]), 64.0);
    }
}

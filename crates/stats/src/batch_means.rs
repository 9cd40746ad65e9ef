//! Batch means: effective number of independent rows of a log.

use fleetfoot_data::EpisodeId;

/// The residual's sums over chunks, one entry a target.
///
/// Rows of a log are correlated over tau of them, so that n rows say as much as n / tau. In blocks much longer than that, the expected square of a block's
/// sum of residuals is `tau` times the sum of their squares; the ratio of the two, over all blocks, estimates tau. Chunks may be shorter, so neighbours are
/// joined two by two, as long as there are `LEAST` blocks and the ratio still grows by more than two of its own standard errors (blocking: Flyvbjerg and
/// Petersen 1989).
///
/// Joining goes along as chunks come, like the carries of a binary counter: of every length of blocks, sums and one block that waits for its neighbour are kept, and no chunk.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchMeans {
    targets: usize,
    /// The episode of the chunks so far that are not closed.
    episode: Option<EpisodeId>,
    /// Of chunks, of pairs of them, of pairs of these; as many as pairs were found. Beyond the last one nothing was ever joined, so that it stands for all longer ones.
    levels: Vec<Level>,
}

/// Blocks of one length, in chunks; shorter ones where an episode ends.
#[derive(Debug, Clone, PartialEq)]
struct Level {
    /// Blocks that have left for the next level, and of these, for every target, the sums of squares.
    blocks: usize,
    squares: Vec<f64>,
    /// Sums of their sums by their weights, and of squared weights: what the squares become when a mean is taken away.
    products: Vec<f64>,
    weights: f64,
    /// A block that waits for its neighbour.
    open: Option<Batch>,
}

/// Consecutive chunks of an episode: weight, and the sums of the residuals.
#[derive(Debug, Clone, PartialEq)]
struct Batch {
    weight: f64,
    sums: Vec<f64>,
}

/// Blocks that a longer estimate needs.
const LEAST: usize = 16;

impl Level {
    fn new(targets: usize) -> Self {
        Self { blocks: 0, squares: vec![0.0; targets], products: vec![0.0; targets], weights: 0.0, open: None }
    }

    fn count(&mut self, block: &Batch) {
        self.blocks += 1;
        self.weights += block.weight * block.weight;
        for ((square, product), sum) in self.squares.iter_mut().zip(&mut self.products).zip(&block.sums) {
            *square += sum * sum;
            *product += sum * block.weight;
        }
    }
}

impl Batch {
    fn joined(self, next: &Self) -> Self {
        let sums = self.sums.iter().zip(&next.sums).map(|(sum, next)| sum + next).collect();
        Self { weight: self.weight + next.weight, sums }
    }
}

impl BatchMeans {
    /// No chunks yet, of residuals of `targets` targets.
    pub fn new(targets: usize) -> Self {
        Self { targets, episode: None, levels: vec![Level::new(targets)] }
    }

    /// Adds a chunk, in the order of episode and chunk: the sum of its row weights, and the weighted mean of every target's residual. A chunk without rows
    /// leaves no trace.
    ///
    /// # Panics
    /// When there is not one mean a target.
    pub fn add(&mut self, episode: EpisodeId, weight: f64, mean: &[f64]) {
        assert_eq!(mean.len(), self.targets, "one mean a target");
        if weight > 0.0 {
            if self.episode != Some(episode) {
                self.close();
                self.episode = Some(episode);
            }
            self.push(0, Batch { weight, sums: mean.iter().map(|mean| weight * mean).collect() });
        }
    }

    /// A block of a level: waits, or is joined to the one that does.
    fn push(&mut self, mut at: usize, mut block: Batch) {
        while let Some(first) = self.levels[at].open.take() {
            if at + 1 == self.levels.len() {
                // Whatever has left this level so far left it alone.
                self.levels.push(self.levels[at].clone());
            }
            let level = &mut self.levels[at];
            level.count(&first);
            level.count(&block);
            block = first.joined(&block);
            at += 1;
        }
        self.levels[at].open = Some(block);
    }

    /// Ends an episode: on every level an odd block stays alone.
    fn close(&mut self) {
        let mut at = 0;
        while at < self.levels.len() {
            if let Some(alone) = self.levels[at].open.take() {
                self.levels[at].count(&alone);
                if at + 1 < self.levels.len() {
                    self.push(at + 1, alone);
                }
            }
            at += 1;
        }
    }

    /// Rows that count as independent, `weight / tau` with the largest tau of the targets, but not less than 2: `weight` is the sum of all rows'
    /// weights, `error` the sum of squared residuals of every target. One chunk says nothing: then it is `weight`.
    pub fn effective_weight(&self, weight: f64, error: &[f64]) -> f64 {
        self.effective_weight_about(&vec![0.0; self.targets], weight, error)
    }

    /// The same where residuals are what was added less a mean of every target, which is known now; so are the squares in `error`.
    pub fn effective_weight_about(&self, mean: &[f64], weight: f64, error: &[f64]) -> f64 {
        let mut all = self.clone();
        all.close();
        let tau = (0..all.targets).map(|t| correlation(&all.levels, t, mean[t], error[t])).fold(1.0, f64::max);
        if all.levels[0].blocks < 2 { weight } else { (weight / tau).max(2.0) }
    }
}

/// tau of a target, in rows; at least 1.
fn correlation(levels: &[Level], target: usize, mean: f64, error: f64) -> f64 {
    if error.is_nan() || error <= 0.0 || levels[0].blocks < 2 {
        return 1.0;
    }
    let ratio = |level: &Level| {
        let squares = level.squares[target] - 2.0 * mean * level.products[target] + mean * mean * level.weights;
        squares / error
    };
    let mut tau = ratio(&levels[0]);
    for level in &levels[1..] {
        let longer = ratio(level);
        // The deviation of a mean of n squares of normal numbers is sqrt(2 / n) of it.
        if level.blocks < LEAST || longer <= tau * (1.0 + 2.0 * (2.0 / level.blocks as f64).sqrt()) {
            break;
        }
        tau = longer;
    }
    tau.max(1.0)
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

    /// The definition: all chunks kept, and joined anew for every length.
    fn tau_of_all(chunks: &[(u128, f64, f64)], error: f64) -> f64 {
        let mut blocks: Vec<(u128, f64)> =
            chunks.iter().map(|&(episode, weight, mean)| (episode, weight * mean)).collect();
        let ratio = |blocks: &[(u128, f64)]| blocks.iter().map(|(_, sum)| sum * sum).sum::<f64>() / error;
        let mut tau = ratio(&blocks);
        loop {
            let mut joined: Vec<(u128, f64)> = Vec::new();
            let mut rest = &blocks[..];
            while let Some((first, after)) = rest.split_first() {
                let pair = after.first().filter(|next| next.0 == first.0);
                joined.push((first.0, pair.map_or(first.1, |next| first.1 + next.1)));
                rest = &after[usize::from(pair.is_some())..];
            }
            blocks = joined;
            let longer = ratio(&blocks);
            if blocks.len() < LEAST || longer <= tau * (1.0 + 2.0 * (2.0 / blocks.len() as f64).sqrt()) {
                return tau.max(1.0);
            }
            tau = longer;
        }
    }

    #[test]
    fn incremental_batches_equal_batches_at_the_end() {
        let mut key = 0_u64;
        let mut uniform = || {
            key += 1;
            fleetfoot_data::mix(key) as f64 / u64::MAX as f64
        };
        let mut grew = 0;
        for run in 0..200_u32 {
            let (mut state, mut chunks) = (0.0, Vec::new());
            for episode in 0..u128::from(1 + run % 7) {
                for _ in 0..(200.0 * uniform().powi(3)) as usize + usize::from(episode == 0) * 3 {
                    state = 0.95 * state + uniform() - 0.5;
                    chunks.push((episode, (4.0 * uniform()).ceil(), state));
                }
            }
            let weight: f64 = chunks.iter().map(|chunk| chunk.1).sum();
            let mean = chunks.iter().map(|chunk| chunk.1 * chunk.2).sum::<f64>() / weight;
            let error: f64 = chunks.iter().map(|chunk| chunk.1 * chunk.2 * chunk.2).sum();
            let around: Vec<_> =
                chunks.iter().map(|&(episode, weight, value)| (episode, weight, value - mean)).collect();
            let spread: f64 = around.iter().map(|chunk| chunk.1 * chunk.2 * chunk.2).sum();
            let mut means = BatchMeans::new(1);
            chunks.iter().for_each(|&(episode, weight, mean)| means.add(EpisodeId(episode), weight, &[mean]));
            let expected = (weight / tau_of_all(&chunks, error)).max(2.0);
            assert_eq!(
                means.effective_weight(weight, &[error]),
                expected,
                "to the bit: the same sums in the same order"
            );
            let (effective, expected) = (
                means.effective_weight_about(&[mean], weight, &[spread]),
                (weight / tau_of_all(&around, spread)).max(2.0),
            );
            // The mean is taken from sums instead of from rows: rounding of some hundred numbers of like size.
            assert!((effective / expected - 1.0).abs() < 1e-9, "run {run}: {effective} {expected}");
            grew += usize::from(expected < 0.3 * weight);
            assert!(means.levels.len() < 10, "no more than there are bits in the number of chunks");
        }
        assert!(grew > 50, "blocks were joined: {grew}");
    }

    #[test]
    fn episodes_are_not_joined() {
        let mut means = BatchMeans::new(1);
        (0..64).for_each(|e| means.add(EpisodeId(e), 10.0, &[1.0]));
        assert_eq!(means.effective_weight(640.0, &[640.0]), 64.0);
    }
}

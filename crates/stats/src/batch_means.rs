//! Batch means: how many of the rows of a log count as independent.

/// Sums over chunks of the squared sums of a residual, one entry a target.
///
/// Rows of a log are correlated over tau of them, so that n rows say as much as n / tau. With chunks much longer than that, the expected square of a
/// chunk's sum of residuals is `tau` times the sum of their squares; the ratio of the two, over all chunks, estimates tau.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchMeans {
    spread: Vec<f64>,
    chunks: usize,
}

impl BatchMeans {
    /// No chunks yet, of residuals of `targets` targets.
    pub fn new(targets: usize) -> Self {
        Self { spread: vec![0.0; targets], chunks: 0 }
    }

    /// Adds a chunk: the sum of its row weights, and the weighted mean of every target's residual. A chunk without rows leaves no trace.
    ///
    /// # Panics
    /// When there is not one mean a target.
    pub fn add(&mut self, weight: f64, mean: &[f64]) {
        assert_eq!(mean.len(), self.spread.len(), "one mean a target");
        if weight > 0.0 {
            self.chunks += 1;
            self.spread.iter_mut().zip(mean).for_each(|(spread, mean)| *spread += weight * weight * mean * mean);
        }
    }

    /// Rows that count as independent, `weight / tau` with the largest tau of the targets, but not less than 2: `weight` is the sum of all rows'
    /// weights, `error` the sum of squared residuals of every target. One chunk says nothing: then it is `weight`.
    pub fn effective_weight(&self, weight: f64, error: &[f64]) -> f64 {
        if self.chunks < 2 {
            return weight;
        }
        let ratio = |(spread, error): (&f64, &f64)| if *error > 0.0 { spread / error } else { 1.0 };
        let tau = self.spread.iter().zip(error).map(ratio).fold(1.0, f64::max);
        (weight / tau).max(2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::BatchMeans;

    /// An autoregressive series, x' = a x + noise, has tau = (1 + a) / (1 - a).
    #[test]
    fn an_autoregressive_series_has_its_correlation_time() {
        let (a, chunk, chunks) = (0.9, 500, 400);
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
            means.add(f64::from(chunk), &[sum / f64::from(chunk)]);
        }
        let rows = f64::from(chunk * chunks);
        let tau = rows / means.effective_weight(rows, &[square]);
        // 19, less what the ends of chunks cut off (2 %), within three deviations of a variance from 400 numbers (21 %).
        assert!((14.5..23.5).contains(&tau), "{tau}");
        assert_eq!(BatchMeans::new(1).effective_weight(10.0, &[1.0]), 10.0);
    }
}

//! Whether a filter's deviations are what its errors are: normalised squares and their bands.

use fleetfoot_data::EpisodeId;
use fleetfoot_stats::BatchMeans;

/// Rows of which the correlation of squares is found together.
const CHUNK: usize = 16;

/// The 95 % band of a chi-square distribution.
///
/// By bisection of the regularised incomplete gamma function, whose series converges for all arguments (Abramowitz and Stegun, equation 6.5.29).
pub fn chi_square_band(freedom: usize) -> [f64; 2] {
    let quantile = |p: f64| {
        let (mut low, mut high) = (0.0, 10.0 * freedom as f64 + 100.0);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if chi_square(middle, freedom) < p { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    };
    [quantile(0.025), quantile(0.975)]
}

/// The probability of a chi-square number below `x`.
fn chi_square(x: f64, freedom: usize) -> f64 {
    let (a, half) = (0.5 * freedom as f64, 0.5 * x);
    if half <= 0.0 {
        return 0.0;
    }
    // ln Gamma(a + 1), from Gamma(1) or Gamma(1/2) upwards.
    let (mut logarithm, mut at) =
        if freedom.is_multiple_of(2) { (0.0, 1.0) } else { (0.5 * std::f64::consts::PI.ln(), 0.5) };
    while at < a + 0.75 {
        logarithm += f64::ln(at);
        at += 1.0;
    }
    let first = (a * half.ln() - half - logarithm).exp();
    let (mut term, mut sum, mut k) = (first, first, 1.0);
    while term > 1e-17 * sum && k < 10_000.0 {
        term *= half / (a + k);
        sum += term;
        k += 1.0;
    }
    sum.min(1.0)
}

/// Squares that are chi-square numbers of so many degrees of freedom where a filter is consistent: of innovations (NIS) or of errors (NEES).
#[derive(Debug, Clone)]
pub struct Consistency {
    freedom: usize,
    band: [f64; 2],
    inside: u64,
    /// By episode, in the order of rows.
    values: Vec<(EpisodeId, Vec<f64>)>,
}

/// The mean of normalised squares, by its degrees of freedom: 1 where a filter is consistent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanBand {
    /// The mean.
    pub mean: f64,
    /// Where 95 % of the means of a consistent filter lie, for as many independent rows as the squares' own correlation leaves.
    pub band: [f64; 2],
}

impl MeanBand {
    /// Whether the mean lies in its band.
    pub fn holds(&self) -> bool {
        (self.band[0]..=self.band[1]).contains(&self.mean)
    }
}

impl Consistency {
    /// No numbers yet.
    pub fn new(freedom: usize) -> Self {
        Self { freedom, band: chi_square_band(freedom.max(1)), inside: 0, values: Vec::new() }
    }

    /// Degrees of freedom of a number.
    pub fn freedom(&self) -> usize {
        self.freedom
    }

    /// Adds the squares of an episode in their order; what is no number is left out.
    pub fn add(&mut self, episode: EpisodeId, squares: impl IntoIterator<Item = f64>) {
        let own: Vec<f64> = squares.into_iter().filter(|square| square.is_finite()).collect();
        self.inside += own.iter().filter(|square| (self.band[0]..=self.band[1]).contains(*square)).count() as u64;
        self.values.push((episode, own));
    }

    /// Rows.
    pub fn rows(&self) -> u64 {
        self.values.iter().map(|(_, own)| own.len() as u64).sum()
    }

    /// The share of rows in the 95 % band of a single row; NaN of none.
    pub fn share(&self) -> f64 {
        self.inside as f64 / self.rows() as f64
    }

    /// The mean, and its band; `None` of no rows.
    pub fn mean(&self) -> Option<MeanBand> {
        let rows = self.rows() as f64;
        if rows == 0.0 {
            return None;
        }
        let mean = self.values.iter().flat_map(|(_, own)| own).sum::<f64>() / rows;
        let mut means = BatchMeans::new(1);
        let mut error = 0.0;
        for (episode, own) in &self.values {
            error += own.iter().map(|square| (square - mean).powi(2)).sum::<f64>();
            for chunk in own.chunks(CHUNK) {
                let rows = chunk.len() as f64;
                means.add(*episode, rows, &[chunk.iter().sum::<f64>() / rows - mean]);
            }
        }
        let independent = means.effective_weight(rows, &[error]);
        // The variance of a chi-square number is twice its degrees of freedom.
        let freedom = self.freedom as f64;
        let half = 1.96 * (2.0 / (freedom * independent)).sqrt();
        Some(MeanBand { mean: mean / freedom, band: [1.0 - half, 1.0 + half] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_those_of_tables() {
        for (freedom, low, high) in [
            (1, 0.000982, 5.0239),
            (2, 0.0506, 7.3778),
            (3, 0.2158, 9.3484),
            (10, 3.2470, 20.4832),
            (30, 16.7908, 46.9792),
        ] {
            let [a, b] = chi_square_band(freedom);
            assert!((a - low).abs() < 6e-5 && (b - high).abs() < 6e-5, "{freedom}: {a} {b}");
        }
    }
}

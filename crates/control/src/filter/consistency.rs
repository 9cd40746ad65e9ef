//! Consistency of a filter: normalised squares of its errors, and their bands.

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

/// Squares that are chi-square numbers of so many degrees of freedom if a filter is consistent: of innovations (NIS) or
/// of errors (NEES). Memory does not grow with the rows.
#[derive(Debug, Clone)]
pub struct Consistency {
    freedom: usize,
    band: [f64; 2],
    inside: u64,
    rows: u64,
    sum: f64,
    /// Sums of the squares less the degrees of freedom, which are their mean if the filter is consistent, and sums of
    /// the squares of that. The subtraction keeps digits that a large mean would cost.
    off: f64,
    spread: f64,
    /// Means of chunks, less the degrees of freedom.
    means: BatchMeans,
    chunk: Chunk,
}

/// Rows of an episode that are no whole chunk yet.
#[derive(Debug, Clone, Copy)]
struct Chunk {
    episode: EpisodeId,
    rows: usize,
    sum: f64,
}

impl Chunk {
    /// Begins an episode, or the next chunk of one.
    fn new(episode: EpisodeId) -> Self {
        Self { episode, rows: 0, sum: 0.0 }
    }

    fn close(self, means: &mut BatchMeans) {
        if self.rows > 0 {
            let rows = self.rows as f64;
            means.add(self.episode, rows, &[self.sum / rows]);
        }
    }
}

/// The mean of normalised squares, by its degrees of freedom: 1 where a filter is consistent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanBand {
    /// The mean.
    pub mean: f64,
    /// The 95 % band of the means of a consistent filter, for as many independent rows as the squares' correlation
    /// leaves.
    pub band: [f64; 2],
}

impl MeanBand {
    /// Returns true if the mean lies in its band.
    pub fn holds(&self) -> bool {
        (self.band[0]..=self.band[1]).contains(&self.mean)
    }
}

impl Consistency {
    /// No numbers yet.
    pub fn new(freedom: usize) -> Self {
        Self {
            freedom,
            band: chi_square_band(freedom.max(1)),
            inside: 0,
            rows: 0,
            sum: 0.0,
            off: 0.0,
            spread: 0.0,
            means: BatchMeans::new(1),
            chunk: Chunk::new(EpisodeId(0)),
        }
    }

    /// Degrees of freedom of a number.
    pub fn freedom(&self) -> usize {
        self.freedom
    }

    /// Adds squares of an episode in their order, all at once or some at a time; NaN is left out.
    pub fn add(&mut self, episode: EpisodeId, squares: impl IntoIterator<Item = f64>) {
        if self.chunk.episode != episode {
            std::mem::replace(&mut self.chunk, Chunk::new(episode)).close(&mut self.means);
        }
        for square in squares.into_iter().filter(|square| square.is_finite()) {
            let off = square - self.freedom as f64;
            self.rows += 1;
            self.inside += u64::from((self.band[0]..=self.band[1]).contains(&square));
            self.sum += square;
            self.off += off;
            self.spread += off * off;
            self.chunk.rows += 1;
            self.chunk.sum += off;
            if self.chunk.rows == CHUNK {
                std::mem::replace(&mut self.chunk, Chunk::new(episode)).close(&mut self.means);
            }
        }
    }

    /// Rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// The share of rows in the 95 % band of a single row; NaN of none.
    pub fn share(&self) -> f64 {
        self.inside as f64 / self.rows() as f64
    }

    /// The mean, and its band; `None` of no rows.
    pub fn mean(&self) -> Option<MeanBand> {
        let rows = self.rows as f64;
        if rows == 0.0 {
            return None;
        }
        let mut means = self.means.clone();
        self.chunk.close(&mut means);
        let off = self.off / rows;
        let error = self.spread - rows * off * off;
        let independent = means.effective_weight_about(&[off], rows, &[error]);
        // The variance of a chi-square number is twice its degrees of freedom.
        let freedom = self.freedom as f64;
        let half = 1.96 * (2.0 / (freedom * independent)).sqrt();
        Some(MeanBand { mean: self.sum / rows / freedom, band: [1.0 - half, 1.0 + half] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_agree_with_tables() {
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

    /// The band by its definition, from all squares at once.
    fn half_of_all(episodes: &[Vec<f64>], freedom: f64) -> f64 {
        let all: Vec<f64> = episodes.iter().flatten().copied().filter(|square| square.is_finite()).collect();
        let (rows, mean) = (all.len() as f64, all.iter().sum::<f64>() / all.len() as f64);
        let mut means = BatchMeans::new(1);
        for (at, squares) in episodes.iter().enumerate() {
            let finite: Vec<f64> = squares.iter().copied().filter(|square| square.is_finite()).collect();
            for chunk in finite.chunks(CHUNK) {
                let rows = chunk.len() as f64;
                means.add(EpisodeId(at as u128), rows, &[chunk.iter().sum::<f64>() / rows - mean]);
            }
        }
        let error = all.iter().map(|square| (square - mean).powi(2)).sum();
        1.96 * (2.0 / (freedom * means.effective_weight(rows, &[error]))).sqrt()
    }

    #[test]
    fn sums_do_not_depend_on_the_batch_size() {
        let uniform = |key: usize| fleetfoot_data::mix(key as u64 + 1) as f64 / u64::MAX as f64;
        for size in [1.0, 1e4] {
            let (mut state, mut episodes) = (0.0, Vec::new());
            for (at, rows) in [700, 5, 3001].into_iter().enumerate() {
                let squares = (0..rows).map(|row| {
                    state = 0.97 * state + uniform(7919 * at + row) - 0.5;
                    if row % 97 == 5 { f64::NAN } else { size * (3.0 + state * state) }
                });
                episodes.push(squares.collect::<Vec<f64>>());
            }
            let half = |at_a_time: usize| {
                let mut consistency = Consistency::new(3);
                for (at, squares) in episodes.iter().enumerate() {
                    squares
                        .chunks(at_a_time)
                        .for_each(|part| consistency.add(EpisodeId(at as u128), part.iter().copied()));
                }
                (consistency.mean().expect("rows"), consistency.rows(), consistency.share())
            };
            let whole = half(10_000);
            for at_a_time in [1, 16, 17, 500] {
                assert_eq!(half(at_a_time), whole, "{at_a_time} at a time");
            }
            let half = 0.5 * (whole.0.band[1] - whole.0.band[0]);
            // The squares are of like size as their deviation: rounding of some thousand sums.
            assert!((half / half_of_all(&episodes, 3.0) - 1.0).abs() < 1e-9, "{half}");
        }
    }
}

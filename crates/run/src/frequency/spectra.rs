//! Frequency response by averaged spectra (P. D. Welch, The use of fast Fourier transform for the estimation of power
//! spectra, 1967), with coherence and intervals (J. S. Bendat, A. G. Piersol, Random Data, 4th ed., section 9.2).

use std::f64::consts::{PI, TAU};

use super::{Line, Response};

/// Correlation of neighbouring half-overlapping Hann segments: `sum w[n] w[n + L/2] / sum w^2`.
const OVERLAP: f64 = 1.0 / 6.0;
/// Inputs below this share of the largest power at a frequency do not excite it.
pub(super) const EXCITED: f64 = 1e-3;

/// Sums over segments, one entry a frequency.
pub(super) struct Spectra {
    length: usize,
    segments: usize,
    lost: usize,
    input: Vec<f64>,
    output: Vec<f64>,
    cross: Vec<[f64; 2]>,
    window: Vec<f64>,
}

impl Spectra {
    /// `length` samples a segment, a power of two.
    pub(super) fn new(length: usize) -> Self {
        let lines = length / 2 + 1;
        let window = (0..length).map(|n| 0.5 - 0.5 * (TAU * n as f64 / length as f64).cos()).collect();
        Self {
            length,
            segments: 0,
            lost: 0,
            input: vec![0.0; lines],
            output: vec![0.0; lines],
            cross: vec![[0.0; 2]; lines],
            window,
        }
    }

    /// Adds the segments of an episode, which overlap by half; those with a missing value are left out.
    pub(super) fn add(&mut self, input: &[f64], output: &[f64]) {
        let (length, half) = (self.length, self.length / 2);
        let starts = (0..).map(|at| at * half).take_while(|start| start + length <= input.len());
        for start in starts {
            let (u, y) = (&input[start..start + length], &output[start..start + length]);
            if u.iter().chain(y).any(|value| !value.is_finite()) {
                self.lost += 1;
                continue;
            }
            let (u, y) = (self.transformed(u), self.transformed(y));
            self.segments += 1;
            for line in 0..=half {
                let ([a, b], [c, d]) = (u[line], y[line]);
                self.input[line] += a * a + b * b;
                self.output[line] += c * c + d * d;
                // Conjugate of the input times the output.
                self.cross[line][0] += a * c + b * d;
                self.cross[line][1] += a * d - b * c;
            }
        }
    }

    fn transformed(&self, values: &[f64]) -> Vec<[f64; 2]> {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let mut all: Vec<[f64; 2]> =
            values.iter().zip(&self.window).map(|(value, window)| [(value - mean) * window, 0.0]).collect();
        transform(&mut all);
        all
    }

    /// The response; `None` without a segment.
    pub(super) fn finish(&self, period: f64) -> Option<Response> {
        if self.segments == 0 {
            return None;
        }
        let count = self.segments as f64;
        let averages = count / (1.0 + 2.0 * OVERLAP * OVERLAP * (count - 1.0) / count);
        let freedom = 2.0 * averages - 2.0;
        let largest = self.input.iter().skip(1).copied().fold(0.0, f64::max);
        // Power a hertz, one-sided.
        let scale = 2.0 * period / (self.window.iter().map(|w| w * w).sum::<f64>() * count);
        let line = |at: usize| {
            let (input, output, [real, imaginary]) = (self.input[at], self.output[at], self.cross[at]);
            let coherence = ((real * real + imaginary * imaginary) / (input * output)).min(1.0);
            let factor = if freedom > 0.0 { 0.05f64.powf(-2.0 / freedom) - 1.0 } else { f64::NAN };
            Line {
                frequency: at as f64 / (self.length as f64 * period),
                value: [real / input, imaginary / input],
                radius: (factor * (1.0 - coherence) * output / input).sqrt(),
                coherence,
                input: input * scale,
                output: output * scale,
                excited: input > EXCITED * largest,
            }
        };
        // The mean is taken off every segment, so that there is nothing at zero.
        let lines = (1..=self.length / 2).map(line).collect();
        Some(Response { lines, averages, parts: self.segments, lost: self.lost, distortion: None })
    }
}

/// Fourier transform in place, `sum x[n] exp(-i 2 pi k n / N)`, of a power of two of values.
fn transform(values: &mut [[f64; 2]]) {
    let length = values.len();
    let bits = length.trailing_zeros();
    for at in 0..length {
        let other = at.reverse_bits() >> (usize::BITS - bits.max(1));
        if bits > 0 && at < other {
            values.swap(at, other);
        }
    }
    let mut size = 2;
    while size <= length {
        let turns: Vec<[f64; 2]> =
            (0..size / 2).map(|k| -2.0 * PI * k as f64 / size as f64).map(|angle| [angle.cos(), angle.sin()]).collect();
        for block in values.chunks_exact_mut(size) {
            let (low, high) = block.split_at_mut(size / 2);
            for ((a, b), [cosine, sine]) in low.iter_mut().zip(high).zip(&turns) {
                let turned = [b[0] * cosine - b[1] * sine, b[0] * sine + b[1] * cosine];
                *b = [a[0] - turned[0], a[1] - turned[1]];
                *a = [a[0] + turned[0], a[1] + turned[1]];
            }
        }
        size *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::transform;
    use std::f64::consts::TAU;

    #[test]
    fn transforms_equal_their_sums() {
        for length in [1, 2, 8, 64] {
            let values: Vec<f64> = (0..length).map(|n| (n as f64 * 1.7).sin() + 0.1 * n as f64).collect();
            let mut transformed: Vec<[f64; 2]> = values.iter().map(|value| [*value, 0.0]).collect();
            transform(&mut transformed);
            for (k, [real, imaginary]) in transformed.iter().enumerate() {
                let sum = |of: fn(f64) -> f64| -> f64 {
                    let angle = |n: usize| TAU * ((k * n) % length) as f64 / length as f64;
                    values.iter().enumerate().map(|(n, value)| value * of(angle(n))).sum()
                };
                assert!((real - sum(f64::cos)).abs() < 1e-11 && (imaginary + sum(f64::sin)).abs() < 1e-11);
            }
        }
    }
}
